//! The camera of a frame.

use crate::data::Dataset;
use crate::error::RunError;
use crate::names;
use crate::picture::limited;
use render_core::camera::Camera;
use scene_io::Scene;

/// The camera of a frame as it is, no larger than the training views; lens and all, so that it can be laid beside the photo.
pub(super) fn held(name: &str, scene: &Scene, data: &Dataset) -> Result<Camera, RunError> {
    let names: Vec<&str> = scene.frames.iter().map(|f| f.name.as_str()).collect();
    let frame = names::find_part(&names, name, &format!("`--path hold:{name}`"))?;
    let known = data.views().iter().find(|v| v.frame == frame && v.level == 0);
    Ok(known.map_or_else(|| limited(&scene.frames[frame].camera, data.longest_side()), |v| v.camera))
}
