//! The views of a run: those trained on and those held out.

use crate::data::Dataset;
use crate::error::RunError;
use crate::options::DataOptions;
use scene_io::{ImageStore, Scene, Split, StoreOptions};
use std::sync::Arc;

/// The training and the held-out views. A dataset without a test split is measured on its validation split.
pub(super) fn datasets(scene: &Scene, data: &DataOptions) -> Result<(Dataset, Dataset), RunError> {
    let options = StoreOptions { longest_side: data.longest_side, budget_bytes: data.image_bytes() };
    let store = Arc::new(ImageStore::new(&scene.frames, options)?);
    let train: Vec<usize> = scene.split(Split::Train).collect();
    if train.is_empty() {
        return Err(RunError::Untrainable(format!(
            "`{}` has no training views ({} frames in all): check the split or give `--holdout none`",
            scene.name,
            scene.frames.len()
        )));
    }
    let mut held_out: Vec<usize> = scene.split(Split::Test).collect();
    if held_out.is_empty() {
        held_out = scene.split(Split::Val).collect();
    }
    let scales = data.scales.unwrap_or(1);
    let smallest = train.iter().map(|&f| store.camera(f)).map(|c| c.width.min(c.height)).min().unwrap_or(0);
    if scales == 0 || smallest.checked_shr(scales - 1).unwrap_or(0) == 0 {
        return Err(RunError::Option(format!(
            "`--scales {scales}`: the smallest side is {smallest} pixels; the smallest scale needs one at least"
        )));
    }
    Ok((Dataset::with_levels(scene, store.clone(), train, 0..scales)?, Dataset::new(scene, store, held_out)?))
}
