//! Sines and cosines of points, which come in coarse to fine.

use super::settings::refuse;
use engine::system::SystemError;
use field_core::encoding::frequency::{Base, Frequency, Identity};
use field_core::encoding::window;
use field_core::tape::{EncodingOp, Node, Tape, TapeError, Windowed};
use float_core::Simd;

/// Octaves `1, 2, 4, ..` of numbers.
///
/// # Errors
/// [`SystemError::Config`] for numbers of octaves that cannot be.
pub(super) fn frequency(dims: usize, octaves: usize, identity: Identity) -> Result<Frequency, SystemError> {
    Frequency::new(dims, octaves, Base::One, identity).map_err(refuse)
}

/// When octaves come in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Window {
    /// All of them are there from the start.
    Open,
    /// One after the other.
    Over {
        /// Share of the schedule after which the first of them begins to come in.
        from: f64,
        /// Share of the schedule from then on until all are there.
        length: f64,
    },
}

impl Window {
    /// How far it is open once the share `done` of the schedule is over.
    fn open(self, done: f64) -> f64 {
        match self {
            Self::Open => 1.0,
            Self::Over { from, .. } if done < from => 0.0,
            Self::Over { from, length } if length > 0.0 => ((done - from) / length).min(1.0),
            Self::Over { .. } => 1.0,
        }
    }
}

/// Sines and cosines with a weight for each octave (Nerfies, equation 8).
pub(crate) struct Octaves {
    frequency: Frequency,
    opens: Window,
    simd: Simd,
    op: EncodingOp<Windowed<Vec<f32>>>,
    /// `[octaves]`, as of this step.
    window: Vec<f32>,
}

impl Octaves {
    /// Octaves of a matrix of `dims` rows, with these rows themselves or without.
    ///
    /// # Errors
    /// [`SystemError::Config`] for numbers of octaves that cannot be.
    pub(crate) fn new(
        dims: usize,
        octaves: usize,
        identity: Identity,
        opens: Window,
        simd: Simd,
    ) -> Result<Self, SystemError> {
        let frequency = frequency(dims, octaves, identity)?;
        let op = EncodingOp::new(Windowed { encoding: frequency, window: None }, simd);
        let mut new = Self { frequency, opens, simd, op, window: vec![0.0; octaves] };
        new.renew(0.0);
        Ok(new)
    }

    /// Rows of [`Octaves::of`].
    pub(crate) fn rows(&self) -> usize {
        self.frequency.out_rows()
    }

    /// Weights as of this step.
    pub(crate) fn window(&self) -> &[f32] {
        &self.window
    }

    /// Whether no octave has come in yet.
    pub(crate) fn is_closed(&self) -> bool {
        self.window.iter().all(|&w| w == 0.0)
    }

    /// The octaves of `x` `[dims x n]`: `[rows x n]`.
    ///
    /// # Errors
    /// [`TapeError`] for another number of rows.
    pub(crate) fn of<'a>(&'a self, tape: &mut Tape<'a>, x: Node) -> Result<Node, TapeError> {
        tape.custom(&self.op, &[x])
    }

    /// The weights once the share `done` of the schedule is over.
    pub(super) fn renew(&mut self, done: f64) {
        window::nerfies(self.opens.open(done) * self.window.len() as f64, &mut self.window);
        if self.opens != Window::Open {
            self.weigh();
        }
    }

    fn weigh(&mut self) {
        let windowed = Windowed { encoding: self.frequency, window: Some(self.window.clone()) };
        self.op = EncodingOp::new(windowed, self.simd);
    }

    /// Other weights until the next step.
    #[cfg(test)]
    pub(crate) fn set_window(&mut self, window: &[f32]) {
        self.window.copy_from_slice(window);
        self.weigh();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_open_by_shares_of_the_schedule() {
        let window = Window::Over { from: 0.2, length: 0.4 };
        let open = [0.0, 0.2, 0.3, 0.6, 1.0].map(|done| window.open(done));
        for (open, want) in open.iter().zip([0.0, 0.0, 0.25, 1.0, 1.0]) {
            assert!((open - want).abs() < 1e-12, "{open} {want}");
        }
        let at_once = Window::Over { from: 0.2, length: 0.0 };
        assert_eq!([0.0, 0.19, 0.2, 1.0].map(|done| at_once.open(done)), [0.0, 0.0, 1.0, 1.0]);
        assert_eq!(Window::Over { from: 0.0, length: 0.0 }.open(0.0), 1.0);
        assert_eq!(Window::Open.open(0.0), 1.0);
    }
}
