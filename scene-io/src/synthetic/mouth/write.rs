//! The mouth in files, in D-NeRF's form, with what is known about it beside.

use super::{Mouth, MouthOptions, mouth, mouth_views};
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
/// As [`mouth`].
pub fn write_mouth(options: &MouthOptions, folder: &Path) -> Result<(), SceneError> {
    write_blender(&mouth(options), folder)?;
    let drawn = Mouth::new(options.seed);
    let about = json!({
        "scene": "mouth", "seed": options.seed, "rays_per_pixel": options.rays * options.rays,
    });
    write_truth(|time| drawn.at(time), &mouth_views(options), &about, folder)
}
