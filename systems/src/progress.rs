//! What a run tells the people (or programs) that watch it.

use crate::train::Progress;
use std::path::Path;

/// Something happened.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Event<'a> {
    /// A line worth reading.
    Note(&'a str),
    /// A line worth acting on.
    Warning(&'a str),
    /// A step was done. Comes after every step.
    Step(&'a Progress),
    /// A held-out view was rendered.
    View {
        /// Views done.
        done: usize,
        /// Views in all.
        of: usize,
    },
    /// The held-out views were measured.
    Evaluated {
        /// Steps trained.
        step: u64,
        /// Training seconds.
        seconds: f64,
        /// Mean PSNR, dB.
        psnr: Option<f64>,
    },
    /// A checkpoint was written.
    Saved {
        /// Steps trained.
        step: u64,
        /// Its JSON file.
        path: &'a Path,
    },
}

/// Watches a run.
pub trait Observer {
    /// Called as things happen; returns quickly.
    fn event(&mut self, event: Event<'_>);
}

/// Watches nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Observer for Silent {
    fn event(&mut self, _: Event<'_>) {}
}
