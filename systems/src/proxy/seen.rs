//! What pixels of a photo see of a field.

use crate::views::outside::PhotoPixels;
use crate::views::start::Place;
use engine::render::plain_query;
use engine::system::System;
use glam::DVec2;

/// What pixels of a photo see, at the median depth of the field; those that see nothing, or nothing at any distance, are left out.
pub(super) fn seen(field: &dyn System, photo: &PhotoPixels) -> Vec<Place> {
    let PhotoPixels { camera, pixels } = photo;
    let w = (camera.width as usize).max(1);
    let centre = |i: usize| DVec2::new((i % w) as f64 + 0.5, (i / w) as f64 + 0.5);
    let (colours, rays): (Vec<_>, Vec<_>) =
        pixels.iter().filter_map(|&(i, rgb)| Some((rgb, camera.ray(centre(i))?))).unzip();
    let layers = field.render(&rays, &plain_query([0.0; 3], 0.0));
    let depths = colours.iter().zip(&rays).zip(&layers.median_depth);
    depths
        .filter_map(|((&rgb, ray), &t)| {
            let x = ray.at(f64::from(t));
            x.is_finite().then(|| Place { x, pixel: f64::from(t) / camera.fx, rgb })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::splats::Cloud;
    use engine::system::Splats;
    use glam::DVec3;
    use render_core::camera::{Camera, Pose};
    use splat_core::{Gaussians, RasterSettings};

    /// A wall across the left half of the picture, at depth 4.
    fn wall() -> Cloud {
        let mut wall = Gaussians::new(1, 0).unwrap();
        (wall.mean[0], wall.mean[2]) = (-41.0, 4.0);
        wall.log_scale = vec![20.0_f32.ln(), 20.0_f32.ln(), 1e-3_f32.ln()];
        wall.logit.fill(9.0);
        Cloud::exact(Splats { gaussians: wall, rules: RasterSettings::DEFAULT })
    }

    #[test]
    fn pixels_see_the_surface_at_its_depth_as_large_as_they_are_there() {
        let mut opaque = wall();
        let mut gaussians = opaque.gaussians();
        gaussians.mean[0] = 0.0;
        opaque = Cloud::exact(Splats { gaussians, rules: RasterSettings::DEFAULT });
        let camera = Camera::pinhole(16, 8, 160.0, 160.0, 8.0, 4.0, Pose::IDENTITY);
        let pixels = [(0, [0.1; 3]), (4 * 16 + 8, [0.9; 3])];
        let points = seen(&opaque, &PhotoPixels { camera, pixels: pixels.to_vec() });
        assert_eq!(points.len(), 2);
        for (point, (i, rgb)) in points.iter().zip(pixels) {
            let expected = [(i % 16) as f64 + 0.5 - 8.0, (i / 16) as f64 + 0.5 - 4.0].map(|u| u / 160.0 * 4.0);
            assert!(point.x.distance(DVec3::new(expected[0], expected[1], 4.0)) < 2e-2, "{}", point.x);
            assert!((point.pixel - point.x.length() / 160.0).abs() < 1e-6 && point.rgb == rgb);
        }
    }

    #[test]
    fn pixels_that_see_nothing_are_left_out() {
        let camera = Camera::pinhole(16, 8, 16.0, 16.0, 8.0, 4.0, Pose::IDENTITY);
        assert!(seen(&wall(), &PhotoPixels { camera, pixels: vec![(15, [0.5; 3])] }).is_empty());
        assert!(seen(&wall(), &PhotoPixels { camera, pixels: Vec::new() }).is_empty());
    }
}
