//! Sines and cosines of points, which come in coarse to fine.

use super::settings::refuse;
use super::window::Window;
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
    Frequency::new(dims, octaves, Base::One, identity)
        .map_err(|e| refuse("warp_octaves, time_octaves, ambient_octaves", format!("one of them is {octaves}"), e))
}

/// Sines and cosines with a weight for each octave (Nerfies, section 3.5).
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
