//! The views of a run: those trained on and those held out.
//!
//! Measured are the test views; with `--validation` the views that it takes from those trained on, and then nothing reads a
//! test view. Every file about a split is written before the first step.

use crate::data::Dataset;
use crate::error::RunError;
use crate::eval::Measured;
use crate::folder::{HELD_OUT, VALIDATION};
use crate::options::DataOptions;
use scene_io::{ImageStore, Scene, Split, StoreOptions};
use std::path::Path;
use std::sync::Arc;

/// The files that say which frames are held out: names and content.
pub(super) fn name_files(
    scene: &Scene,
    data: &DataOptions,
    measured: &Dataset,
) -> Result<Vec<(&'static str, String)>, RunError> {
    let lines = |names: &mut dyn Iterator<Item = &str>| names.map(|name| format!("{name}\n")).collect::<String>();
    let names = lines(&mut measured.views().iter().map(|view| view.name.as_str()));
    let held_out = match data.validation()? {
        None => names.clone(),
        Some(_) => lines(&mut scene.split(Split::Test).map(|i| scene.frames[i].name.as_str())),
    };
    let mut files = vec![(HELD_OUT, held_out)];
    if Measured::of(measured) == Measured::Validation {
        files.push((VALIDATION, names));
    }
    Ok(files)
}

/// How a run's dataset is read again: names that were in files as the run wrote them down, wherever the files have gone.
pub(super) fn as_named(folder: &Path, data: &DataOptions) -> DataOptions {
    let mut data = data.clone();
    for (word, file) in [(&mut data.holdout, HELD_OUT), (&mut data.validation, VALIDATION)] {
        let names = folder.join(file);
        if word.as_ref().is_some_and(|word| word.starts_with("names:")) && names.exists() {
            *word = Some(format!("names:{}", names.display()));
        }
    }
    data
}

/// The training views, and those that are measured. A dataset without a test split is measured on its validation split.
pub(super) fn datasets(scene: &Scene, data: &DataOptions) -> Result<(Dataset, Dataset), RunError> {
    let options = StoreOptions::default().with_longest_side(data.longest_side).with_budget_bytes(data.image_bytes());
    let store = Arc::new(ImageStore::new(&scene.frames, options)?);
    store.check_sizes()?;
    let train: Vec<usize> = scene.split(Split::Train).collect();
    if train.is_empty() {
        return Err(RunError::Untrainable(format!(
            "`{}` has no training views ({} frames in all): check the split or give `--holdout none`",
            scene.name,
            scene.frames.len()
        )));
    }
    let validated = data.validation()?.is_some();
    let mut held_out: Vec<usize> = if validated { Vec::new() } else { scene.split(Split::Test).collect() };
    if held_out.is_empty() {
        held_out = scene.split(Split::Val).collect();
    }
    if validated && held_out.is_empty() {
        return Err(RunError::Option(format!("`--validation`: `{}` has no validation views", scene.name)));
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
