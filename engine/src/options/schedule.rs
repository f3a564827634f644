//! When training ends, and what happens on the way.

use std::time::Duration;

/// When training ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stop {
    /// After this many steps, counted from the start of the run, resumed or not.
    Steps(u64),
    /// After this much training time, resumed or not.
    Seconds(f64),
}

impl Stop {
    /// The stop of as much work on a machine of speed 1, where this one's is `speed`.
    #[must_use]
    pub fn at_speed(self, speed: f64) -> Self {
        match self {
            Self::Steps(n) => Self::Steps(n),
            Self::Seconds(s) => Self::Seconds(s * speed),
        }
    }

    /// Whether a run at `step` after `seconds` is done.
    pub fn reached(self, step: u64, seconds: f64) -> bool {
        match self {
            Self::Steps(n) => step >= n,
            Self::Seconds(s) => seconds >= s,
        }
    }
}

/// What happens when.
#[derive(Clone, Debug, PartialEq)]
pub struct Schedule {
    /// When training ends.
    pub stop: Stop,
    /// Evaluate at these training seconds.
    pub eval_at: Vec<f64>,
    /// Steps between evaluations; `None`: none on the way.
    pub eval_every: Option<u64>,
    /// Wall time between checkpoints; there is always one at the end.
    pub checkpoint_every: Duration,
    /// Training seconds between rows of `metrics.csv`.
    pub row_every: f64,
    /// How long what a run ends with is tried to be written where that fails: a full disk may have room again.
    pub disk_wait: Duration,
}

impl Schedule {
    /// Evaluation at the end only, a checkpoint every 5 minutes, a row a second.
    pub fn new(stop: Stop) -> Self {
        Self {
            stop,
            eval_at: Vec::new(),
            eval_every: None,
            checkpoint_every: Duration::from_secs(300),
            row_every: 1.0,
            disk_wait: Duration::from_secs(60),
        }
    }
}
