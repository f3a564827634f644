//! The layer of canonical points: what of the scene at rest each ray sees.
//!
//! A ray's point is where its transmittance passes one half, at [`Layers::median_depth`]; [`System::canonical`] says which
//! point of the canonical scene that is. Pixels of two pictures that show the same canonical point show the same point of a
//! thing, wherever it has moved in between.

use crate::system::{Canonical, Layers, NOWHERE, Query, System};
use render_core::ray::Ray;

/// Fill [`Layers::canonical`] of rays whose depths are known, if the query asks for it.
///
/// # Shapes and units
/// * `rays`   `[n]` in the scene's frame
/// * `layers` of these rays; `canonical` `[n]` out, the scene's frame, world units, [`NOWHERE`] where nothing was hit
///
/// # Panics
/// If there are fewer depths than rays.
pub fn add_canonical(system: &dyn System, rays: &[Ray], query: &Query, layers: &mut Layers) {
    if query.layers.canonical == Canonical::Skip {
        return;
    }
    let hit: Vec<usize> = (0..rays.len()).filter(|&i| layers.median_depth[i].is_finite()).collect();
    let points: Vec<[f64; 3]> = hit.iter().map(|&i| rays[i].at(f64::from(layers.median_depth[i])).to_array()).collect();
    let mut there = vec![NOWHERE; points.len()];
    system.canonical(&points, query.time, &mut there);
    layers.canonical = vec![NOWHERE; rays.len()];
    for (&i, &point) in hit.iter().zip(&there) {
        layers.canonical[i] = point;
    }
}
