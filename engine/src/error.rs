//! Failures of a system and of a run: files, checkpoints, options. The fact is in the message, the reason in [`source`].
//!
//! [`source`]: std::error::Error::source

use scene_io::one_line;
use std::io;
use std::path::{Path, PathBuf};

/// A failure inside a system.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SystemError {
    /// More steps had non-finite gradients than a run may have.
    #[error(
        "{bad} of {steps} steps had NaN or infinite gradients, more than the {share_percent} % a run may have: \
         lower the learning rate (`--set lr=...`) or check the images for NaN pixels"
    )]
    NonFinite {
        /// Steps with non-finite gradients.
        bad: u64,
        /// Steps so far.
        steps: u64,
        /// Share allowed, in percent.
        share_percent: f64,
    },
    /// A checkpoint lacks an array or holds one of another shape.
    #[error("checkpoint: `{name}`: {problem}")]
    State {
        /// The array.
        name: String,
        /// What is wrong with it.
        problem: String,
    },
    /// A configuration value that cannot work.
    #[error("`{field}` = {value}: {problem}")]
    Config {
        /// The field as the user writes it in `--set`.
        field: &'static str,
        /// What it holds.
        value: String,
        /// Why that cannot work, and what would.
        problem: String,
    },
    /// A picture of a cloud cannot be drawn, compared or learnt from.
    #[error("no picture can be made of the Gaussians: {problem}")]
    Picture {
        /// Why, and what to look at.
        problem: String,
    },
    /// Reading an image failed.
    #[error(transparent)]
    Scene(#[from] scene_io::SceneError),
}

impl From<optim::TooManyNonFinite> for SystemError {
    fn from(e: optim::TooManyNonFinite) -> Self {
        Self::NonFinite { bad: e.bad_steps, steps: e.steps, share_percent: 100.0 * e.allowed as f64 / e.steps as f64 }
    }
}

/// A failure of a run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// A file or folder could not be written.
    #[error("cannot write `{}`", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A file or folder could not be read.
    #[error("cannot read `{}`", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A file of the run holds something else than it should.
    #[error("{}", one_line(&format!("`{}`: {problem}", path.display())))]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what to do.
        problem: String,
    },
    /// There is no checkpoint where one is needed.
    #[error("`{}` holds no checkpoint: train into it first (`train SCENE --out {}`)", .0.display(), .0.display())]
    NoCheckpoint(PathBuf),
    /// Checkpoints are there and none can be used.
    #[error(
        "none of the {} checkpoints of `{}` can be used: {}",
        problems.len(), folder.display(), one_line(&problems.join("; "))
    )]
    AllCheckpointsBroken {
        /// The run folder.
        folder: PathBuf,
        /// One problem a checkpoint, newest first.
        problems: Vec<String>,
    },
    /// The output folder already holds a run.
    #[error(
        "`{}` already holds a run at step {step}: continue it with `--resume` or choose another `--out`",
        folder.display()
    )]
    RunExists {
        /// The run folder.
        folder: PathBuf,
        /// Step of its newest checkpoint.
        step: u64,
    },
    /// Another process writes into the run folder.
    #[error(
        "`{}` is in use: {holder} is training into it or measuring it; wait for its end, stop it, or choose another folder",
        folder.display()
    )]
    Busy {
        /// The run folder.
        folder: PathBuf,
        /// Who: `process 1234`.
        holder: String,
    },
    /// The output folder holds files that are not a run's.
    #[error(
        "`{}` is not a run folder and not empty: it holds `{}`; choose another `--out`, one that is empty or not there yet",
        folder.display(), name.display()
    )]
    ForeignFiles {
        /// The folder.
        folder: PathBuf,
        /// One of the files.
        name: PathBuf,
    },
    /// A resumed run was given an option that differs from the run's.
    #[error(
        "`{option} {given}` differs from the run's `{option} {run}`: a resumed run keeps its configuration; leave the \
         option out, or start a new run with another `--out`"
    )]
    ResumeDiffers {
        /// The option on the command line.
        option: String,
        /// Value of the run.
        run: String,
        /// Value given now.
        given: String,
    },
    /// The dataset is not the one the run was trained on.
    #[error(
        "the dataset has changed since the run started (it was {run}, it is {now}): restore the files, or start a new \
         run with another `--out`"
    )]
    DatasetChanged {
        /// Hash in the checkpoint.
        run: String,
        /// Hash now.
        now: String,
    },
    /// Files that a finished run has are not there.
    #[error(
        "`{}` is incomplete, missing: {}; `train --resume --out {}` makes what can be made again",
        folder.display(), listed(files), folder.display()
    )]
    Missing {
        /// The run folder.
        folder: PathBuf,
        /// Names in it.
        files: Vec<String>,
    },
    /// Results are known and could not be written.
    #[error("the results printed above could not be saved in `{}`: {}", folder.display(), listed(problems))]
    Unwritten {
        /// The run folder.
        folder: PathBuf,
        /// A line for each file.
        problems: Vec<String>,
    },
    /// An array of a checkpoint cannot be used.
    #[error("`{}`: {source}", path.display())]
    State {
        /// The file of the arrays.
        path: PathBuf,
        /// Which array, and why.
        source: SystemError,
    },
    /// An option that cannot work.
    #[error("{0}")]
    Option(String),
    /// There is nothing to train on.
    #[error("{0}")]
    Untrainable(String),
    /// An error of the system.
    #[error(transparent)]
    System(#[from] SystemError),
    /// An error of the dataset.
    #[error(transparent)]
    Scene(#[from] scene_io::SceneError),
}

/// The first few of many.
fn listed(names: &[String]) -> String {
    const SHOWN: usize = 4;
    let more = names.len().saturating_sub(SHOWN);
    let shown = names[..names.len() - more].join(", ");
    if more > 0 { format!("{shown} and {more} more") } else { shown }
}

impl RunError {
    /// Whether a file could not be written because a disk, or the user's share of it, is full.
    pub(crate) fn is_full(&self) -> bool {
        let full = [io::ErrorKind::StorageFull, io::ErrorKind::QuotaExceeded];
        matches!(self, Self::Write { source, .. } if full.contains(&source.kind()))
    }

    /// The line with what the system said.
    pub(crate) fn with_reason(&self) -> String {
        match self {
            Self::Write { source, .. } | Self::Read { source, .. } => format!("{self}: {source}"),
            _ => self.to_string(),
        }
    }

    /// For `map_err`: writing `path` failed.
    pub fn write(path: impl AsRef<Path>) -> impl FnOnce(io::Error) -> Self {
        let path = path.as_ref().to_path_buf();
        move |source| Self::Write { path, source }
    }

    /// For `map_err`: reading `path` failed.
    pub fn read(path: impl AsRef<Path>) -> impl FnOnce(io::Error) -> Self {
        let path = path.as_ref().to_path_buf();
        move |source| Self::Read { path, source }
    }
}
