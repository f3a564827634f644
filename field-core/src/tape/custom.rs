//! The hook through which other function pairs enter the tape.

use super::{Node, Shape, Tape, TapeError};

/// Most inputs a custom operation can have.
pub const MAX_INPUTS: usize = 8;

/// A matrix to read: `rows` features by `cols` samples, row by row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View<'v> {
    /// Features.
    pub rows: usize,
    /// Samples.
    pub cols: usize,
    /// `[rows][cols]`.
    pub data: &'v [f32],
}

impl<'v> View<'v> {
    /// Row `r`, one number a sample.
    ///
    /// # Panics
    /// When there is no such row, or `data` ends before it does.
    #[must_use]
    pub fn row(&self, r: usize) -> &'v [f32] {
        assert!(r < self.rows, "row {r} of a matrix of {} rows", self.rows);
        &self.data[r * self.cols..(r + 1) * self.cols]
    }

    /// Rows and columns.
    #[must_use]
    pub fn shape(&self) -> Shape {
        Shape::new(self.rows, self.cols)
    }
}

/// Gradient of the loss with respect to one input of a custom operation: add to it.
#[derive(Debug)]
pub struct Bar<'b> {
    /// As the input, `[rows][cols]`. Where `demand` is [`Demand::Ignored`] it holds anything and is never read.
    pub data: &'b mut [f32],
    /// Whether the gradient is used.
    pub demand: Demand,
}

/// Whether the gradient of an input is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Demand {
    /// It has to be added.
    Wanted,
    /// The input is a constant: the work can be skipped; what is written is not read.
    Ignored,
}

/// What the backward pass of a custom operation reads.
#[derive(Clone, Copy, Debug)]
pub struct BackwardArgs<'v> {
    /// The inputs of the forward pass.
    pub inputs: &'v [View<'v>],
    /// Its output, `[rows][cols]`.
    pub out: &'v [f32],
    /// What it kept, [`CustomOp::saved_len`] numbers.
    pub saved: &'v [f32],
    /// Gradient of the loss with respect to the output, `[rows][cols]`.
    pub out_bar: &'v [f32],
}

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
