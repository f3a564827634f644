//! Numbers that no scene can have: finite, and so large that systems would lose them.

use crate::Problem;
use glam::DVec3;
use render_core::camera::Camera;
use std::path::Path;

/// Largest coordinate, world units: that of [`Camera::check`]. Its cube fits `f32`.
pub(crate) const FARTHEST: f64 = 1e12;

/// Whether a point can be one of a scene.
pub(crate) fn is_point(x: DVec3) -> bool {
    x.is_finite() && x.abs().max_element() <= FARTHEST
}

/// Whether a depth range says anything: from above 0, not beyond what a scene can hold.
pub(crate) fn is_depth_range([near, far]: [f64; 2]) -> bool {
    near >= 1.0 / FARTHEST && far >= near && far <= FARTHEST
}

/// Refuses a camera with numbers that no camera can have. `file` and `place` say where it is listed.
pub(crate) fn check_camera(camera: &Camera, file: &Path, place: &str) -> Result<(), Problem> {
    camera.check().map_err(|error| {
        let field = |name: &str| if place.is_empty() { name.to_owned() } else { format!("{place}: {name}") };
        let remedy = "correct the value, or remove the frame";
        match error.parameter() {
            Some((name, value)) => Problem::new(file, format!("no camera can have this: {error}"), remedy)
                .field(field(name))
                .value(format!("{value:e}")),
            None => Problem::new(file, format!("no camera can have this: {error}"), remedy).field(field("camera")),
        }
    })
}
