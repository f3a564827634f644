//! What is wrong with the capture itself, before any training.

use crate::data::Dataset;
use crate::error::RunError;
use rayon::prelude::*;
use scene_io::capture::{Thumb, find_problems, without_pictures};
use scene_io::{Problem, Scene, SceneError};

/// Findings about the training photos. Pictures are not examined where they do not fit in memory at one time.
pub(super) fn problems(scene: &Scene, train: &Dataset) -> Result<Vec<Problem>, RunError> {
    if !train.fits() {
        return Ok(without_pictures(scene));
    }
    train.decode()?;
    let mut thumbs = vec![None; scene.frames.len()];
    let views: Vec<usize> = (0..train.len()).filter(|&i| train.view(i).level == 0).collect();
    let found: Result<Vec<(usize, Thumb)>, SceneError> =
        views.par_iter().map(|&i| Ok((train.view(i).frame, Thumb::of(&*train.image(i)?)))).collect();
    for (frame, thumb) in found? {
        thumbs[frame] = Some(thumb);
    }
    Ok(find_problems(scene, &thumbs))
}
