//! What pixels of a photo see of a field.

use crate::views::outside::PhotoPixels;
use crate::views::start::Place;
use engine::render::plain_query;
use engine::system::System;
use glam::DVec2;

/// Error budget of a ray: more than nothing, so that it stops, and colours are hardly asked for; less than a half, so that it does not
/// stop before its transmittance has passed that. Its median depth is the same to the bit as without.
pub(super) const BUDGET: f32 = 0.4;

/// What pixels of a photo see, at the median depth of the field; those that see nothing, or nothing at any distance, are left out.
pub(super) fn seen(field: &dyn System, photo: &PhotoPixels) -> Vec<Place> {
    let PhotoPixels { camera, pixels } = photo;
    let w = (camera.width as usize).max(1);
    let centre = |i: usize| DVec2::new((i % w) as f64 + 0.5, (i / w) as f64 + 0.5);
    let (colours, rays): (Vec<_>, Vec<_>) =
        pixels.iter().filter_map(|&(i, rgb)| Some((rgb, camera.ray(centre(i))?))).unzip();
    let layers = field.render(&rays, &plain_query([0.0; 3], BUDGET));
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
    fn what_rays_leave_out_changes_no_median_depth() {
        use crate::plan::made;
        use engine::options::RunOptions;
        let (scene, data) = made::capture(made::Points::None);
        let set = toml::toml! {
            log2_table = 12
            occupancy = 16
        };
        let run = RunOptions { seed: 3, background: None, error_budget: None, stop: None, set };
        let (mut field, _) = crate::registry::build("ngp", &scene, &data, &run).unwrap();
        for step in 0..40 {
            field.step(&data, step).unwrap();
        }
        let camera = data.view(0).camera;
        let (w, h) = (camera.width as usize, camera.height as usize);
        let centre = |i: usize| DVec2::new((i % w) as f64 + 0.5, (i / w) as f64 + 0.5);
        let rays: Vec<_> = (0..w * h).filter_map(|i| camera.ray(centre(i))).collect();
        let [all, less] = [0.0, BUDGET].map(|budget| field.render(&rays, &plain_query([0.0; 3], budget)));
        assert_eq!(all.median_depth, less.median_depth);
        assert!(all.median_depth.iter().any(|t| t.is_finite()) && all.rgb != less.rgb, "something was left out");
    }

    #[test]
    fn pixels_that_see_nothing_are_left_out() {
        let camera = Camera::pinhole(16, 8, 16.0, 16.0, 8.0, 4.0, Pose::IDENTITY);
        assert!(seen(&wall(), &PhotoPixels { camera, pixels: vec![(15, [0.5; 3])] }).is_empty());
        assert!(seen(&wall(), &PhotoPixels { camera, pixels: Vec::new() }).is_empty());
    }
}
