//! What a run is made with: how scenes are read, systems made and files written.

use crate::data::Dataset;
use crate::error::{RunError, SystemError};
use crate::options::{Choice, DataOptions, Plan, Purpose, RunOptions};
use crate::output::{Disk, Storage};
use crate::system::System;
use scene_io::Scene;

/// Reads the scene a word or path names.
pub type Load<'a> = dyn Fn(&str, &DataOptions) -> Result<Scene, RunError> + 'a;

/// Makes a system for a scene and says what it decided.
pub type Build<'a> = dyn Fn(&str, &Scene, &Dataset, &RunOptions) -> Result<(Box<dyn System>, Plan), SystemError> + 'a;

/// Takes a system for a scene: from the scene, the training data, the options and what the reconstruction is for.
pub type Choose = fn(&Scene, &Dataset, &RunOptions, Purpose) -> Result<Choice, SystemError>;

/// The system of a run where none is named.
#[derive(Clone, Copy, Debug)]
pub enum DefaultSystem<'a> {
    /// Always this one.
    Named(&'a str),
    /// Chosen from the scene.
    Chosen(Choose),
}

/// What a run is made with.
#[derive(Clone, Copy)]
pub struct Parts<'a> {
    /// Reads scenes.
    pub load: &'a Load<'a>,
    /// Makes systems.
    pub build: &'a Build<'a>,
    /// Where files go.
    pub storage: &'a dyn Storage,
    /// System taken when none is named.
    pub default_system: DefaultSystem<'a>,
}

/// Parts that read files and write to the disk; the system is up to `build`.
pub fn disk_parts<'a>(load: &'a Load<'a>, build: &'a Build<'a>, default_system: DefaultSystem<'a>) -> Parts<'a> {
    Parts { load, build, storage: &Disk, default_system }
}
