//! A small stage with things that turn, travel, swing, breathe, bend and twist, filmed by one camera.
//!
//! Each picture has a pose and a time of its own: monocular, as D-NeRF's data. Things stand on a round stage under no sky
//! (pictures are RGBA). A crate travels along a circle and turns; an arm swings from shoulder and elbow; a ball becomes
//! flatter and higher; a bar bends and twists; the stage, a block, a post and a ring stay. Nothing touches, opens or joins:
//! there is no change of topology (that is [`Mouth`](super::Mouth)'s).
//!
//! What is known of each time is a [`Snapshot`]: colour belongs to the material, and its points can be followed.

mod stage;
mod views;
mod write;

pub use stage::OrbitMotion;
pub use views::{OrbitCamera, OrbitOptions, orbit, orbit_views};
pub use write::write_orbit;

use crate::Bounds;
use crate::synthetic::snapshot::Snapshot;
use glam::DVec3;
use stage::Thing;

/// The stage and how everything on it moves: z is up, the ground lies at `z = 0` and is a disc of radius 1.05.
#[derive(Clone, Debug)]
pub struct Orbit {
    things: Vec<Thing>,
}

impl Orbit {
    /// The stage of a seed.
    #[must_use]
    pub fn new(seed: u64, motion: OrbitMotion) -> Self {
        Self { things: stage::things(seed, motion) }
    }

    /// A box that holds everything at all times.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        Bounds { min: DVec3::new(-1.06, -1.06, -0.09), max: DVec3::new(1.06, 1.06, 1.02) }
    }

    /// The stage at a time, usually in `[0, 1]`.
    #[must_use]
    pub fn at(&self, time: f64) -> Snapshot {
        Snapshot::new(time, self.things.iter().map(|thing| thing.posed(time)).collect())
    }
}

#[cfg(test)]
mod tests;
