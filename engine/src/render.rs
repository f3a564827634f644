//! A camera to a picture: whole images of layers, strip by strip.

use crate::halt::Halt;
use crate::system::{Appearance, LayerRequest, Layers, Query, System};
use glam::{DVec2, Vec3};
use render_core::camera::Camera;
use render_core::ray::Ray;
use std::ops::Range;

/// Rays of one call to [`System::render_cones`]: enough work for many threads, little memory.
const STRIP: usize = 1 << 14;

/// The layers of a whole image, row by row; pixels the lens has no ray for show the background and nothing else.
#[derive(Clone, Debug, PartialEq)]
pub struct Rendered {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// One entry a pixel.
    pub layers: Layers,
}

/// Render what `camera` sees. Once the query's [`Halt`] is raised the rest of the picture shows nothing.
///
/// # Panics
/// If the system gives fewer values than rays.
pub fn render(system: &dyn System, camera: &Camera, query: &Query) -> Rendered {
    let (width, height) = (camera.width, camera.height);
    if let Some(layers) = system.render_view(camera, query) {
        return Rendered { width, height, layers };
    }
    let pixels = width as usize * height as usize;
    let mut layers = Layers::nothing(pixels, query);
    let prepared = camera.prepare();
    let side = system.rays_per_side().max(1);
    let k = (side * side) as usize;
    // Where a pixel's rays go through it.
    let places: Vec<DVec2> = (0..side * side)
        .map(|j| DVec2::new(f64::from(j % side) + 0.5, f64::from(j / side) + 0.5) / f64::from(side))
        .collect();
    let mut rays: Vec<Ray> = Vec::with_capacity(STRIP + k);
    let mut radii: Vec<f32> = Vec::with_capacity(STRIP + k);
    let mut seen: Vec<usize> = Vec::with_capacity(STRIP / k + 1);
    for pixel in 0..pixels {
        if rays.is_empty() && query.halt.raised() {
            break;
        }
        let corner = DVec2::new((pixel % width as usize) as f64, (pixel / width as usize) as f64);
        let before = rays.len();
        rays.extend(places.iter().filter_map(|&place| prepared.ray(corner + place)));
        if rays.len() == before + k {
            // Each ray stands for its share of the pixel.
            let radius = prepared.cone_radius(corner + 0.5).unwrap_or(0.0) / f64::from(side);
            radii.resize(rays.len(), radius as f32);
            seen.push(pixel);
        } else {
            rays.truncate(before);
        }
        if rays.len() >= STRIP || pixel + 1 == pixels {
            let strip = system.render_cones(&rays, &radii, query);
            for (i, &pixel) in seen.iter().enumerate() {
                average(&strip, i * k..(i + 1) * k, &mut layers, pixel);
            }
            rays.clear();
            radii.clear();
            seen.clear();
        }
    }
    Rendered { width, height, layers }
}

/// The layers of a pixel from those of its rays.
fn average(strip: &Layers, rays: Range<usize>, layers: &mut Layers, pixel: usize) {
    let k = rays.len();
    if k == 1 {
        let ray = rays.start;
        layers.rgb[pixel] = strip.rgb[ray];
        layers.opacity[pixel] = strip.opacity[ray];
        layers.depth[pixel] = strip.depth[ray];
        layers.median_depth[pixel] = strip.median_depth[ray];
        if let (Some(to), Some(from)) = (layers.normal.get_mut(pixel), strip.normal.get(ray)) {
            *to = *from;
        }
        if let (Some(to), Some(from)) = (layers.canonical.get_mut(pixel), strip.canonical.get(ray)) {
            *to = *from;
        }
        return;
    }
    let share = 1.0 / k as f32;
    let opacity = &strip.opacity[rays.clone()];
    layers.rgb[pixel] = [0, 1, 2].map(|c| share * strip.rgb[rays.clone()].iter().map(|rgb| rgb[c]).sum::<f32>());
    layers.opacity[pixel] = share * opacity.iter().sum::<f32>();
    // Of what was hit, as each ray's depth is.
    let hits = || strip.depth[rays.clone()].iter().zip(opacity).filter(|(depth, _)| depth.is_finite());
    let weight: f32 = hits().map(|(_, a)| a).sum();
    layers.depth[pixel] = if weight > 0.0 { hits().map(|(d, a)| d * a).sum::<f32>() / weight } else { f32::INFINITY };
    // One of them, not a mean over an edge.
    let mut by_depth: Vec<usize> = rays.clone().collect();
    by_depth.sort_by(|&a, &b| strip.median_depth[a].total_cmp(&strip.median_depth[b]));
    let middle = by_depth[(k - 1) / 2];
    layers.median_depth[pixel] = strip.median_depth[middle];
    if let (Some(to), Some(from)) = (layers.canonical.get_mut(pixel), strip.canonical.get(middle)) {
        // What that ray sees: a mean over an edge would be on neither side of it.
        *to = *from;
    }
    if let (Some(to), Some(from)) = (layers.normal.get_mut(pixel), strip.normal.get(rays)) {
        let sum = from.iter().fold(Vec3::ZERO, |sum, &n| sum + Vec3::from(n));
        *to = sum.normalize_or_zero().to_array();
    }
}

/// A query for colour, opacity and depth.
pub fn plain_query(background: [f32; 3], error_budget: f32) -> Query {
    Query {
        background,
        layers: LayerRequest::default(),
        error_budget,
        appearance: Appearance::Mean,
        time: 0.0,
        halt: Halt::NEVER,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::NOWHERE;

    #[test]
    fn the_canonical_point_of_a_pixel_is_that_of_the_ray_whose_depth_it_has() {
        let query = plain_query([0.0; 3], 0.0);
        let mut strip = Layers::nothing(8, &query);
        strip.median_depth = vec![5.0, 1.0, 3.0, 2.0, f32::INFINITY, f32::INFINITY, f32::INFINITY, 4.0];
        strip.canonical =
            (0..8).map(|i| if strip.median_depth[i].is_finite() { [i as f64; 3] } else { NOWHERE }).collect();
        let mut layers = Layers { canonical: vec![NOWHERE; 2], ..Layers::nothing(2, &query) };
        average(&strip, 0..4, &mut layers, 0);
        average(&strip, 4..8, &mut layers, 1);
        assert_eq!(layers.median_depth, [2.0, f32::INFINITY]);
        assert_eq!(layers.canonical, [[3.0; 3], NOWHERE]);
        average(&strip, 7..8, &mut layers, 1);
        assert_eq!(layers.canonical[1], [7.0; 3]);
        // Not asked for.
        let mut plain = Layers::nothing(2, &query);
        average(&Layers { canonical: Vec::new(), ..strip }, 0..4, &mut plain, 0);
        assert!(plain.canonical.is_empty() && plain.median_depth[0] == 2.0);
    }
}
