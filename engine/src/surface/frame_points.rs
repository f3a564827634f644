//! The surface that one photo's camera sees at its time step, as points: rendered depth, smoothed without its edges.
//!
//! ```text
//! D = depth of the render, D' = bilateral(D)          X = o + d D' / (d . axis)
//! ```
//!
//! Pixels that are mostly transparent, and depths at the ends of their range, are left out (EndoNeRF, export of point
//! clouds; its range of depths is 64 where depths are around 1, a plain blur).

use crate::data::View;
use crate::render::render;
use crate::surface::{POINT_OPACITY, own_colour};
use crate::system::{LayerRequest, Query, System};
use render_core::bilateral::Bilateral;
use render_core::bounds::percentile;
use scene_io::export::PointCloud;

/// Depths beyond these shares of all are left out.
const ENDS: [f64; 2] = [0.001, 0.999];
/// The filter: pixels to each side, its deviation in the picture, and in depth as a share of the range.
const RADIUS: usize = 6;
const SIGMA_PIXELS: f32 = 3.0;
const SIGMA_RANGE: f64 = 0.05;

/// What `view` sees, with confidence (opacity); `smooth` filters its depth.
///
/// # Panics
/// As [`render`].
pub fn frame_points(system: &dyn System, view: &View, query: &Query, smooth: bool) -> PointCloud {
    let query = Query { time: view.time, layers: LayerRequest::default(), ..query.clone() };
    let picture = render(system, &view.camera, &query);
    let (width, layers, axis) = (view.camera.width, &picture.layers, view.camera.optical_axis());
    let ray = |k: usize| view.ray(k as u32 % width, k as u32 / width);
    let z = |k: usize| {
        let t = f64::from(layers.median_depth[k]);
        let seen = layers.opacity[k] >= POINT_OPACITY && t.is_finite();
        ray(k).filter(|_| seen).map_or(0.0, |ray| (t * ray.d.dot(axis)) as f32)
    };
    let mut depth: Vec<f32> = (0..layers.rgb.len()).map(z).collect();
    let mut known: Vec<f64> = depth.iter().filter(|&&z| z > 0.0).map(|&z| f64::from(z)).collect();
    known.sort_unstable_by(f64::total_cmp);
    let [Some(near), Some(far)] = ENDS.map(|share| percentile(&known, share)) else {
        return PointCloud::default();
    };
    depth.iter_mut().filter(|z| !(near..=far).contains(&f64::from(**z))).for_each(|z| *z = 0.0);
    if smooth {
        // Depths that are all the same have no range.
        let sigma_r = (SIGMA_RANGE * (far - near).max(1e-3 * far)) as f32;
        let filter = Bilateral { radius: RADIUS, sigma_s: SIGMA_PIXELS, sigma_r };
        let found = depth.clone();
        let size = [width as usize, view.camera.height as usize];
        // A range too small for a number: nothing to smooth.
        if filter.apply(&found, size, &mut depth).is_err() {
            depth = found;
        }
    }
    let mut cloud = PointCloud::default();
    for (k, &z) in depth.iter().enumerate() {
        let Some(ray) = ray(k).filter(|_| z > 0.0) else { continue };
        cloud.positions.push((ray.o + ray.d * (f64::from(z) / ray.d.dot(axis))).to_array());
        cloud.colours.push(own_colour(layers.rgb[k], layers.opacity[k], query.background));
        cloud.confidence.push(layers.opacity[k].min(1.0));
    }
    cloud
}
