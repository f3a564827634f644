//! What a run will need: the line that is printed before the start.

use super::{available_bytes, human, limit, resident_bytes};
use std::fmt;

/// Bytes a pixel of a held-out view takes while it is measured: its layers, pictures, and the planes of PSNR and SSIM.
const MEASURED_PIXEL: u64 = 48;
/// The same for LPIPS: what the layers of its network hold.
const LPIPS_PIXEL: u64 = 420;
/// Bytes a pixel of a photo takes in a pre-pass over it: its ray, what the field shows there, twice, and what is made of it.
const PREPASS_PIXEL: u64 = 240;
/// Bytes of the report's pictures, of its animation, and of files while they are written.
const REPORT: u64 = 6 << 20;

/// Scratch of a system that has not trained yet, as a share of what it holds: of `ngp` at its usual sizes.
const SCRATCH: (u64, u64) = (3, 2);
/// A rehearsal sees some steps, not all: what it saw is divided by this, and added.
const HEADROOM: u64 = 6;

/// What a run will need, by part. All in bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ExpectedMemory {
    /// Decoded photos, training and held-out, that are held at one time.
    pub photos: u64,
    /// Parameters, gradients, moments and scratch of the system.
    pub system: u64,
    /// Pictures and planes while a held-out view is measured, and the report.
    pub evaluation: u64,
    /// The program itself, the scene, what decoding and planning took, and what a checkpoint takes while it is written.
    pub rest: u64,
}

/// What the parts are made of.
#[derive(Clone, Copy, Debug, Default)]
pub struct Needs {
    /// Decoded training photos that are held at one time.
    pub(crate) photos: u64,
    /// Held-out photos that will come on top.
    pub(crate) held_out: u64,
    /// Pixels of the largest held-out view; 0 where none is measured.
    pub(crate) pixels: u64,
    /// Pixels of the largest photo that a pre-pass between steps covers; 0 where the system has none.
    pub(crate) prepass: u64,
    /// LPIPS will be measured.
    pub(crate) lpips: bool,
    /// What the system holds (after a rehearsal: with its scratch), and what it may hold later on top.
    pub(crate) system: u64,
    pub(crate) growth: u64,
    /// Bytes of its state: a checkpoint holds a copy while it is written.
    pub(crate) state: u64,
}

impl Needs {
    fn evaluation(&self) -> u64 {
        let pixel = MEASURED_PIXEL + if self.lpips { LPIPS_PIXEL } else { 0 };
        // One after the other.
        REPORT + (self.pixels * pixel).max(self.prepass * PREPASS_PIXEL)
    }
}

impl ExpectedMemory {
    /// From formulas: nothing was tried yet. `held` bytes are held by the process now, the system as it was made among them.
    pub(crate) fn by_formula(needs: &Needs, held: u64) -> Self {
        Self {
            photos: needs.photos + needs.held_out,
            system: needs.system + needs.system * SCRATCH.0 / SCRATCH.1 + needs.growth,
            evaluation: needs.evaluation(),
            rest: held.saturating_sub(needs.system) + needs.state,
        }
    }

    /// After a rehearsal with a copy of the system: the process has held `peak` bytes with the photos, the system as it was made
    /// and its copy. The pages of the run's own moments and gradients are empty until it trains: the copy stands for them.
    pub(crate) fn by_rehearsal(needs: &Needs, peak: u64) -> Self {
        let photos = needs.photos + needs.held_out;
        let seen = peak + peak / HEADROOM + needs.state + needs.growth + needs.held_out;
        // What it may hold by its formulas, of what was seen.
        let system = (needs.system + needs.growth).min(seen.saturating_sub(photos));
        let rest = seen.saturating_sub(photos + system);
        Self { photos, system, evaluation: needs.evaluation(), rest }
    }

    /// All parts together.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.photos + self.system + self.evaluation + self.rest
    }

    /// The bytes it needs beyond what the process may still take; `None` where it fits, or where the machine does not say.
    #[must_use]
    pub fn excess(&self) -> Option<u64> {
        let held = resident_bytes().map_or(0, |held| held.now);
        let more = self.total().saturating_sub(held);
        available_bytes().and_then(|available| more.checked_sub(available)).filter(|&excess| excess > 0)
    }
}

impl fmt::Display for ExpectedMemory {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "memory: {} at most (photos {}, system {}, evaluation {}, program and rest {})",
            human(self.total()),
            human(self.photos),
            human(self.system),
            human(self.evaluation),
            human(self.rest)
        )?;
        match (limit(), available_bytes()) {
            (Some(limit), _) => write!(f, ", {} allowed", human(limit)),
            (None, Some(available)) => write!(f, ", {} available", human(available)),
            (None, None) => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_comes_after_a_rehearsal_is_added() {
        let needs =
            Needs { photos: 100, held_out: 5, pixels: 0, prepass: 0, lpips: false, system: 600, growth: 7, state: 30 };
        let expected = ExpectedMemory::by_rehearsal(&needs, 2000);
        assert_eq!(expected.total(), 2000 + 2000 / HEADROOM + 30 + 7 + 5 + REPORT);
        assert_eq!((expected.photos, expected.system), (105, 607));
    }

    #[test]
    fn the_parts_add_up_and_are_named() {
        let parts = ExpectedMemory { photos: 1_000_000, system: 2_000_000, evaluation: 3_000_000, rest: 4_000_000 };
        let line = parts.to_string();
        assert!(
            line.starts_with(
                "memory: 10.0 MB at most (photos 1.0 MB, system 2.0 MB, evaluation 3.0 MB, program and rest 4.0 MB)"
            ),
            "{line}"
        );
    }
}
