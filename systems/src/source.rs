//! Scenes by word: files, or one of the embedded synthetic scenes.

use crate::error::RunError;
use crate::options::DataOptions;
use scene_io::synthetic::{TabletopOptions, tabletop};
use scene_io::{Depth, Report, Scene};
use std::path::Path;

/// What embedded scenes begin with.
pub const SYNTHETIC: &str = "synthetic:";

/// The scene a word or path names: `synthetic:tabletop`, or a dataset.
///
/// # Errors
/// [`RunError::Scene`] for datasets that cannot be read, [`RunError::Option`] for words that mean nothing.
pub fn load(spec: &str, data: &DataOptions) -> Result<Scene, RunError> {
    match spec.strip_prefix(SYNTHETIC) {
        Some(name) => synthetic(name, data),
        None => Ok(scene_io::load(Path::new(spec), &data.load_options()?)?),
    }
}

/// What is in a dataset and what is wrong with it.
///
/// # Errors
/// [`RunError::Option`] for words that mean nothing. Everything wrong with the dataset is in the report.
pub fn check(spec: &str, data: &DataOptions, depth: Depth) -> Result<Report, RunError> {
    match spec.strip_prefix(SYNTHETIC) {
        Some(name) => Ok(Report::new(synthetic(name, data)?, Vec::new(), depth)),
        None => Ok(scene_io::check(Path::new(spec), &data.load_options()?, depth)),
    }
}

fn synthetic(name: &str, data: &DataOptions) -> Result<Scene, RunError> {
    if data.holdout.is_some() {
        return Err(RunError::Option(format!(
            "`--holdout`: `{SYNTHETIC}{name}` has a split of its own; leave the option out"
        )));
    }
    match name {
        "tabletop" => Ok(tabletop(&TabletopOptions::default())),
        other => {
            Err(RunError::Option(format!("there is no scene `{SYNTHETIC}{other}`; there is `{SYNTHETIC}tabletop`")))
        }
    }
}
