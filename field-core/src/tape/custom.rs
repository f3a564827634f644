//! The hook through which other function pairs enter the tape.

use super::args::{BackwardArgs, Bar, View};
use super::error::TapeError;
use super::shape::{Node, Shape};
use super::state::Tape;

/// A function pair as a node of the tape. Crates can write pairs without depending on the tape; this trait connects them.
///
/// Settings and data of the pair (ray offsets, interval lengths) are fields of the implementing type, which has to be
/// declared before the tape: the tape borrows it. Of two inputs that share memory one is copied, so the bars
/// never overlap.
pub trait CustomOp: Sync {
    /// Name in errors.
    fn name(&self) -> &'static str;

    /// Shape of the output.
    ///
    /// # Errors
    /// Any [`TapeError`] when the inputs do not fit; [`TapeError::Custom`] carries a reason.
    fn shape(&self, inputs: &[Shape]) -> Result<Shape, TapeError>;

    /// Numbers that `forward` saves for `backward` besides the output, such as hidden activations.
    ///
    /// # Panics
    /// May do so for inputs that [`shape`](Self::shape) refuses.
    fn saved_len(&self, inputs: &[Shape]) -> usize {
        let _ = inputs;
        0
    }

    /// Length of the scratch that `backward` needs.
    ///
    /// # Panics
    /// May do so for inputs that [`shape`](Self::shape) refuses.
    fn scratch_len(&self, inputs: &[Shape]) -> usize {
        let _ = inputs;
        0
    }

    /// Write the output, `[rows][cols]`, and `saved`, [`saved_len`](Self::saved_len) numbers. `out` starts as zeros,
    /// `saved` holds anything.
    ///
    /// # Errors
    /// The errors of the pair.
    ///
    /// # Panics
    /// May do so for inputs that [`shape`](Self::shape) refuses, and for slices of other lengths than these.
    fn forward(&self, inputs: &[View<'_>], out: &mut [f32], saved: &mut [f32]) -> Result<(), TapeError>;

    /// Add the gradient of each input to `bars`, one for each input. `scratch` holds
    /// [`scratch_len`](Self::scratch_len) numbers of any value.
    ///
    /// # Errors
    /// The errors of the pair.
    ///
    /// # Panics
    /// May do so for inputs that [`shape`](Self::shape) refuses, and for slices of other lengths than these.
    fn backward(&self, args: BackwardArgs<'_>, scratch: &mut [f32], bars: &mut [Bar<'_>]) -> Result<(), TapeError>;

    /// Record the tangent of the output, in ordinary tape operations (custom ones included), from the tangents of the
    /// inputs; `None` stands for zero, and at least one is not. The result must have the shape of the output.
    ///
    /// # Errors
    /// [`TapeError::NoTangent`] unless the operation has a tangent rule.
    ///
    /// # Panics
    /// May do so for inputs that [`shape`](Self::shape) refuses.
    fn tangent<'a>(
        &'a self,
        tape: &mut Tape<'a>,
        inputs: &[Node],
        input_tangents: &[Option<Node>],
        output: Node,
    ) -> Result<Node, TapeError> {
        let _ = (tape, inputs, input_tangents, output);
        Err(TapeError::NoTangent { op: self.name() })
    }
}
