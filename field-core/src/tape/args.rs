//! What a custom operation reads and writes.

use super::shape::Shape;

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
    /// What it kept, [`CustomOp::saved_len`](super::CustomOp::saved_len) numbers.
    pub saved: &'v [f32],
    /// Gradient of the loss with respect to the output, `[rows][cols]`.
    pub out_bar: &'v [f32],
}
