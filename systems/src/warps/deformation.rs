//! A deformation as its paper writes it: equations on the tape.

use super::ambient::Ambient;
use super::at::{At, Moved};
use super::motion::{Origin, Warp};
use super::planes::TimePlanes;
use field_core::tape::{Tape, TapeError};

/// Weights of octaves, 0 where a window is closed.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Windows<'a> {
    /// Of the point that the warp sees.
    pub(crate) warp: &'a [f32],
    /// Of the ambient coordinates that the density network sees.
    pub(crate) ambient: &'a [f32],
}

impl<'a> Windows<'a> {
    /// Those of the parts that are there.
    pub(crate) fn of(warp: Option<&'a Warp>, ambient: Option<&'a Ambient>) -> Self {
        Self { warp: warp.map_or(&[], |warp| warp.octaves.window()), ambient: ambient.map_or(&[], Ambient::window) }
    }
}

/// Where the point that is at `x` at a time lies in the canonical scene, and what else its density depends on.
///
/// The parts of a deformation own their networks; parameters lie in one vector, which the tape reads.
pub(crate) trait Deformation: Send + Sync {
    /// The equations of the paper.
    ///
    /// # Errors
    /// [`TapeError`] for shapes that do not fit: a mistake in a deformation.
    fn record<'a>(&'a self, tape: &mut Tape<'a>, at: At<'_>) -> Result<Moved, TapeError>;

    /// Whether points are moved at all: whether [`Moved::x`] is there where points move.
    fn warps(&self) -> bool;

    /// Rows of [`Moved::seen`].
    fn seen_rows(&self) -> usize;

    /// What happens at `t = 0`.
    fn origin(&self) -> Origin {
        Origin::Free
    }

    /// Windows as of now.
    fn windows(&self) -> Windows<'_> {
        Windows::default()
    }

    /// Planes of place and time, which come with a loss and a learning rate of their own.
    fn planes(&self) -> Option<&TimePlanes> {
        None
    }

    /// New parameters, once the share `done` of the schedule is over: copies of them and windows follow.
    fn renew(&mut self, params: &[f32], done: f64);

    /// Other windows until the next step.
    #[cfg(test)]
    fn set_windows(&mut self, _warp: &[f32], _ambient: &[f32]) {}
}
