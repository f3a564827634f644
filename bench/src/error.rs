//! Why a benchmark stopped.

use engine::RunError;
use std::error::Error;
use std::path::{Path, PathBuf};

/// A failure, in one line.
#[derive(Debug, thiserror::Error)]
pub(crate) enum BenchError {
    /// A file could not be written or read.
    #[error("`{}`: {source}", path.display())]
    File { path: PathBuf, source: std::io::Error },
    /// A measured number is NaN or infinite: nothing that is published may be.
    #[error("{table}: {column} of `{row}` is {value}, which is not a result")]
    NonFinite { table: String, column: String, row: String, value: f64 },
    /// A plot could not be drawn.
    #[error("plot `{0}`: {1}")]
    Plot(String, String),
    /// A training failed.
    #[error(transparent)]
    Run(#[from] RunError),
    /// A part refused its configuration; a bug of the benchmark.
    #[error("{0}")]
    Part(String),
}

impl BenchError {
    /// For `map_err` on file operations.
    pub(crate) fn file(path: &Path) -> impl FnOnce(std::io::Error) -> Self + use<'_> {
        move |source| Self::File { path: path.into(), source }
    }

    /// Any failure of a part, by what it says.
    pub(crate) fn part(error: impl std::fmt::Display) -> Self {
        Self::Part(error.to_string())
    }

    /// The failure and its causes in one line.
    pub(crate) fn line(&self) -> String {
        let mut line = self.to_string();
        let mut source = self.source();
        while let Some(cause) = source {
            let text = cause.to_string();
            // Some errors already say what their cause says.
            if !line.contains(&text) {
                line = format!("{line}: {text}");
            }
            source = cause.source();
        }
        line.split_whitespace().collect::<Vec<_>>().join(" ")
    }
}
