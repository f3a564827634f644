//! Seconds and counts of a training.

use crate::left_out::LeftOut;
use render_core::budget::Ledger;
use std::sync::Mutex;
use std::sync::atomic::AtomicU64;

/// Seconds of work in each part: of all threads together where a part runs on several.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Seconds {
    pub(super) draw: f64,
    pub(super) march: f64,
    pub(super) encode: f64,
    pub(super) networks: f64,
    pub(super) proposals: f64,
    pub(super) scatter: f64,
    pub(super) optimise: f64,
    pub(super) occupancy: f64,
}

/// Counts for the table of skips.
#[derive(Debug, Default)]
pub(super) struct Skipped {
    /// Training samples kept, placed, and those a march without the occupancy grid would have placed.
    pub(super) kept: AtomicU64,
    /// Those of them that the moving part was evaluated at, and all since it is there.
    pub(super) moving: AtomicU64,
    pub(super) beside_moving: AtomicU64,
    pub(super) placed: AtomicU64,
    pub(super) dense: AtomicU64,
    /// Intervals that proposals weighed.
    pub(super) proposed: AtomicU64,
    /// Training pixels that were not rendered.
    pub(super) left_out: LeftOut,
    /// What renders skipped.
    pub(super) renders: Mutex<Ledger>,
}
