//! Drawn scenes that move and are known exactly at every time.

use super::{Mouth, Orbit, Snapshot};

/// A drawn scene that moves: everything is known of it at every time.
#[derive(Clone, Debug)]
pub enum Drawn {
    /// Things that turn, travel, swing, breathe, bend and twist.
    Orbit(Orbit),
    /// A mouth that opens, splits and closes again.
    Mouth(Mouth),
}

impl Drawn {
    /// The scene at a time, usually in `[0, 1]`.
    #[must_use]
    pub fn at(&self, time: f64) -> Snapshot {
        match self {
            Self::Orbit(orbit) => orbit.at(time),
            Self::Mouth(mouth) => mouth.at(time),
        }
    }
}
