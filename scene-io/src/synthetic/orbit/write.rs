//! The stage in files, in D-NeRF's form, with what is known about it beside.

use super::{Orbit, OrbitOptions, orbit, orbit_views};
use crate::SceneError;
use crate::synthetic::snapshot::write::write_truth;
use crate::synthetic::write_blender;
use serde_json::json;
use std::path::Path;

/// Write the pictures of some options as D-NeRF's data (see [`write_blender`]), and the truth about the training pictures
/// under `truth/`: depth, normals, flow to the next picture, where its points are at time 0. A `README.md` there says what is
/// what.
///
/// # Errors
/// Files that cannot be written.
///
/// # Panics
/// As [`orbit`].
pub fn write_orbit(options: &OrbitOptions, folder: &Path) -> Result<(), SceneError> {
    write_blender(&orbit(options), folder)?;
    let stage = Orbit::new(options.seed, options.motion);
    let about = json!({
        "scene": "orbit", "seed": options.seed, "motion": format!("{:?}", options.motion),
        "camera": format!("{:?}", options.camera), "rays_per_pixel": options.rays * options.rays,
    });
    write_truth(|time| stage.at(time), &orbit_views(options), &about, folder)
}
