//! A mouth that opens, whose lower lip splits in two, and that closes again: its surface is one piece, then two, then three, and
//! in the end one again.
//!
//! The closed mouth is a block with round edges, cut into an upper lip and two halves of a lower one. Closed, the pieces touch
//! without a gap and nothing of the cuts can be seen: the pictures are those of the whole block, and its pattern goes on across
//! them. Each lip moves rigidly, so truth is as exact as that of [`Orbit`](super::Orbit); but what is one surface at one time is
//! several at another, with flesh between them that came from nowhere. No continuous motion of points explains that: it is what
//! ambient coordinates are for (HyperNeRF).
//!
//! | times | what the mouth does |
//! | --- | --- |
//! | 0 to 0.06 | closed |
//! | 0.06 to 0.30 | opens |
//! | 0.32 to 0.47 | the lower lip splits, and its halves part |
//! | 0.53 to 0.68 | they come together |
//! | 0.70 to 0.94 | closes |
//! | 0.94 to 1 | closed, at time 1 as at time 0 |
//!
//! The head bows meanwhile and comes up again. Behind it stands a board with a few knobs, which never moves. Pictures are RGBA;
//! beside the board there is nothing.

mod lips;
mod views;
mod write;

pub use views::{MouthOptions, mouth, mouth_views};
pub use write::write_mouth;

use crate::Bounds;
use crate::synthetic::snapshot::Snapshot;
use glam::DVec3;
use lips::Thing;

/// The mouth, how it moves, and the board behind it: x is right and z up for who stands before it, y goes away.
#[derive(Clone, Debug)]
pub struct Mouth {
    things: Vec<Thing>,
}

impl Mouth {
    /// The mouth of a seed, which varies its colours: shape and motion are always the same.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self { things: lips::things(seed) }
    }

    /// A box that holds everything at all times.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        Bounds { min: DVec3::new(-1.01, -0.45, -1.01), max: DVec3::new(1.01, 0.77, 1.01) }
    }

    /// The mouth at a time, usually in `[0, 1]`.
    #[must_use]
    pub fn at(&self, time: f64) -> Snapshot {
        Snapshot::new(time, self.things.iter().map(|thing| thing.posed(time)).collect())
    }
}

#[cfg(test)]
mod tests;
