//! What all sections share: how large everything is, the threads, the folder of the datasets.

use crate::cli::Cli;
use crate::error::BenchError;
use crate::measure::{Effort, Pools};
use crate::page::Section;
use float_core::Simd;
use std::io::Write;
use std::path::PathBuf;
use std::time::Duration;

/// How large everything is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Extent {
    /// Seconds a section.
    Quick,
    /// Minutes, and the protocols.
    Full,
}

/// What all sections share.
pub(crate) struct Bench {
    pub(crate) extent: Extent,
    pub(crate) effort: Effort,
    pub(crate) pools: Pools,
    /// The fastest level here.
    pub(crate) simd: Simd,
    /// Folder of the datasets, if there is one.
    pub(crate) data: Option<PathBuf>,
    /// Protocols wanted; empty for all.
    pub(crate) protocols: Vec<String>,
    /// Training seconds of a protocol or a row, where something is said.
    pub(crate) seconds: Option<f64>,
    /// Training steps of a row, where something is said.
    pub(crate) steps: Option<u64>,
    /// Whether the held-out views of moving scenes are measured at the end of a row alone.
    pub(crate) at_end: bool,
    /// Views of datasets that are measured in the place of the test views, a word of `--validation`.
    pub(crate) validation: Option<String>,
}

/// Puts what a section has so far on the disk, so that a run that is stopped keeps what it has.
pub(crate) type Keep<'a> = dyn Fn(&Section) -> Result<(), BenchError> + 'a;

impl Bench {
    pub(crate) fn new(cli: &Cli) -> Result<Self, BenchError> {
        let threads =
            cli.threads.map_or_else(|| std::thread::available_parallelism().map_or(1, usize::from), usize::from);
        let extent = if cli.quick { Extent::Quick } else { Extent::Full };
        let (repetitions, least) = match extent {
            Extent::Quick => (5, Duration::from_millis(12)),
            Extent::Full => (15, Duration::from_millis(60)),
        };
        let data = match &cli.data {
            Some(folder) if !folder.is_dir() => {
                return Err(BenchError::Part(format!("`--data {}`: no such folder", folder.display())));
            }
            Some(folder) => Some(folder.clone()),
            None => testkit::golden::data_dir(env!("CARGO_MANIFEST_DIR")),
        };
        Ok(Self {
            extent,
            effort: Effort { repetitions, least },
            pools: Pools::new(threads).map_err(BenchError::part)?,
            simd: Simd::best(),
            data,
            protocols: cli.protocol.clone(),
            seconds: cli.seconds,
            steps: cli.steps,
            at_end: cli.at_end,
            validation: cli.validation.clone(),
        })
    }

    /// Whether a protocol was asked for.
    pub(crate) fn wants(&self, protocol: &str) -> bool {
        self.protocols.is_empty() || self.protocols.iter().any(|w| w == protocol)
    }

    /// The one or the other size.
    pub(crate) fn pick<T>(&self, quick: T, full: T) -> T {
        if self.extent == Extent::Quick { quick } else { full }
    }
}

/// Below tables of quick runs.
pub(crate) const QUICK: &str = "A quick run: of the embedded scene only, small, and too few steps to compare anything.";

/// A line of progress.
pub(crate) fn say(text: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{text}");
}
