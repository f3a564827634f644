//! A run: one folder that holds everything about one training.
//!
//! ```text
//! config.toml        what determines the result, with every setting the plan decided
//! heldout.txt        names of the held-out frames, one a line
//! validation.txt     names of the frames measured in their place, where `--validation` was given
//! schedule.json      when the training stops and is measured: what `--resume` goes on with
//! metrics.csv        a row an interval (see `log`)
//! checkpoint/        see `checkpoint`
//! photo_points.safetensors   points found in the photos, where the dataset has none (see `photo_points`)
//! eval.json eval.csv scores of the held-out views
//! eval_views.json    views measured so far, while an evaluation goes on or was stopped
//! renders/           held-out views: render, truth, error map, depth
//! appearance/        one view in the appearance of a few training photos, where the system has several
//! masks/             static masks of a few training photos, where the system finds them
//! summary.json       plan, time per part, memory, skip table: what the report is made of
//! report.html        all of it, self-contained
//! finished.json      written last: the step that all of this is of
//! .lock              held by the process that writes here (see `lock`)
//! ```

mod capture;
mod create;
mod datasets;
mod filmed;
mod host;
mod keeper;
mod kept;
mod mask_meaning;
mod measure;
mod measured;
mod memory;
mod open;
mod outside;
mod parts;
mod patience;
mod planned;
mod showcase;
mod training;
mod whole;
mod writer;

pub use mask_meaning::{MaskMeaning, mask_meaning};
pub use outside::HeldOutViews;
pub use parts::{Build, Choose, DefaultSystem, Load, Parts, disk_parts};
pub use planned::{planned_schedule, planned_stop};

use crate::data::Dataset;
use crate::folder::{FolderLock, Home};
use crate::halt::Halt;
use crate::memory::ExpectedMemory;
use crate::options::{EvalAppearance, RunConfig};
use crate::system::System;
use scene_io::Scene;
use std::path::PathBuf;

/// An open run.
pub struct Run<'a> {
    parts: Parts<'a>,
    /// The run folder.
    pub folder: PathBuf,
    /// What determines the result.
    pub config: RunConfig,
    /// What the plan decided, a line each.
    pub plan: Vec<String>,
    /// The scene.
    pub scene: Scene,
    /// Views trained on.
    pub train: Dataset,
    /// Views held out.
    pub held_out: Dataset,
    /// The method.
    pub system: Box<dyn System>,
    /// Steps done.
    pub step: u64,
    /// Training seconds.
    pub seconds: f64,
    /// Error budget of renders.
    error_budget: f32,
    /// In which appearance held-out views are measured.
    eval_appearance: Option<EvalAppearance>,
    /// Step the run was resumed at.
    resumed_at: Option<u64>,
    dataset: String,
    /// Memory it will need.
    expected: ExpectedMemory,
    /// The right to write into the folder, where this run has taken it.
    lock: Option<FolderLock>,
    /// Which folder it is.
    home: Home,
    /// Ends pictures early.
    pub(crate) halt: Halt,
}
