//! What a system says of its work: a step, a row of the table of skips.

/// What a step did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepStats {
    /// Mean training loss of the batch.
    pub loss: f64,
    /// Mean squared colour error of the batch, for the running training PSNR.
    pub mse: f64,
    /// Rays cast.
    pub rays: u64,
    /// Samples the field was evaluated at.
    pub samples: u64,
    /// Mean weight of what one photo alone shows, over the pixels that count; 0 without a transient part.
    pub transient: f64,
    /// Gradient entries that were NaN or infinite and were set to 0.
    pub nonfinite: u64,
}

/// One row of the skip table: work that was not done, and what that may cost.
#[derive(Clone, Debug, PartialEq)]
pub struct SkipRow {
    /// What is skipped: `empty space`, `early termination`, …
    pub what: &'static str,
    /// Units of work skipped.
    pub skipped: u64,
    /// Units of work there would have been.
    pub total: u64,
    /// Unit of the two counts: `samples`, `rays`, …
    pub unit: &'static str,
    /// Bound on the error of a pixel, colour units, as a sentence: `<= 1e-4 per pixel`.
    pub bound: String,
    /// Seconds that were saved, where that was measured.
    pub seconds_saved: Option<f64>,
    /// Largest and mean error over pixels, colour units, where that was measured.
    pub error: Option<[f64; 2]>,
}

impl SkipRow {
    /// A row of counts, not measured yet.
    #[must_use]
    pub fn counted(what: &'static str, skipped: u64, total: u64, unit: &'static str, bound: String) -> Self {
        Self { what, skipped, total, unit, bound, seconds_saved: None, error: None }
    }
}
