//! What can go wrong on the way from photos to cameras, each with what to do about it.

use scene_io::SceneError;
use std::io;
use std::path::{Path, PathBuf};

/// A failure of [`crate::prepare`] or [`crate::priors`](fn@crate::priors): one line for the person.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PrepareError {
    /// The input is not what is needed.
    #[error("{}: {what}; {remedy}", path.display())]
    Input {
        /// File or folder.
        path: PathBuf,
        /// What is wrong.
        what: String,
        /// What to do about it.
        remedy: String,
    },
    /// A program is needed and is not installed.
    #[error("{purpose} needs {program}, which is not on the PATH: {remedy}")]
    Missing {
        /// What it is needed for.
        purpose: &'static str,
        /// Name of the program, or names.
        program: &'static str,
        /// What to type.
        remedy: String,
    },
    /// A program ended with a failure. Its last lines were passed on as notes.
    #[error("{program} failed while it should {doing} ({status}): {remedy}; everything it said is in {}", log.display())]
    Tool {
        /// Name of the program.
        program: String,
        /// What it should do.
        doing: String,
        /// Its exit status.
        status: String,
        /// What to do about it.
        remedy: String,
        /// The log.
        log: PathBuf,
    },
    /// Poses could not be found.
    #[error("{what}; {remedy}")]
    NoCameras {
        /// What was found out.
        what: String,
        /// What to do about it.
        remedy: String,
    },
    /// A file or folder could not be read or written.
    #[error("{}: cannot {doing}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// Completes "cannot …".
        doing: &'static str,
        /// What the system said.
        source: io::Error,
    },
    /// A stop was asked for. The next call goes on with the first stage that is not complete.
    #[error("stopped; the same command goes on where it was")]
    Stopped,
    /// A picture or a model could not be read or written.
    #[error(transparent)]
    Scene(#[from] SceneError),
}

impl PrepareError {
    /// For `map_err`: a file operation on `path` failed.
    pub(crate) fn io(path: impl AsRef<Path>, doing: &'static str) -> impl FnOnce(io::Error) -> Self {
        let path = path.as_ref().to_path_buf();
        move |source| Self::Io { path, doing, source }
    }

    pub(crate) fn input(path: impl AsRef<Path>, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Input { path: path.as_ref().to_path_buf(), what: what.into(), remedy: remedy.into() }
    }
}
