//! Encodings as tape operations.

use super::args::{BackwardArgs, Bar, Demand, View};
use super::custom::CustomOp;
use super::error::TapeError;
use super::shape::{Node, Shape};
use super::state::Tape;
use crate::FieldError;
use crate::encoding::EncodingBars;
use float_core::Simd;

/// An encoding: features of positions, their derivative along a direction, and the gradients of both. [`EncodingOp`] makes it a
/// tape operation.
///
/// # Shapes
/// `x`, `x_dot`, `x_bar` `[in_rows][n]`; `out`, `out_bar` `[out_rows][n]`; `table`, `table_bar` `[params_len]`, empty for an
/// encoding without parameters. Bars are added to; `None` skips one.
pub trait Encoder: Sync {
    /// Name in errors.
    const NAME: &'static str;
    /// Numbers encoded.
    fn in_rows(&self) -> usize;
    /// Features.
    fn out_rows(&self) -> usize;
    /// Learned numbers.
    fn params_len(&self) -> usize {
        0
    }
    /// Whether the features are linear in the table, as blends of its entries are and products of blends are not. Where they
    /// are not, there is no tangent along the table.
    fn is_linear(&self) -> bool {
        true
    }

    /// Features.
    ///
    /// # Errors
    /// The errors of the encoding.
    fn encode(&self, simd: Simd, table: &[f32], x: &[f32], out: &mut [f32]) -> Result<(), FieldError>;

    /// Gradients of the features.
    ///
    /// # Errors
    /// The errors of the encoding.
    ///
    /// # Panics
    /// May do so where lengths disagree.
    fn backward(
        &self,
        simd: Simd,
        table: &[f32],
        x: &[f32],
        out_bar: &[f32],
        bars: EncodingBars<'_>,
    ) -> Result<(), FieldError>;

    /// Derivative of the features along `x_dot`.
    ///
    /// # Errors
    /// The errors of the encoding.
    ///
    /// # Panics
    /// May do so where lengths disagree.
    fn tangent(
        &self,
        simd: Simd,
        table: &[f32],
        x: &[f32],
        x_dot: &[f32],
        out_dot: &mut [f32],
    ) -> Result<(), FieldError>;

    /// Gradients of [`tangent`](Self::tangent) with respect to the table and to `x`. With respect to `x_dot` it is
    /// [`backward`](Self::backward).
    ///
    /// # Errors
    /// The errors of the encoding.
    ///
    /// # Panics
    /// May do so where lengths disagree.
    fn tangent_backward(
        &self,
        simd: Simd,
        table: &[f32],
        x: &[f32],
        x_dot: &[f32],
        out_dot_bar: &[f32],
        bars: EncodingBars<'_>,
    ) -> Result<(), FieldError>;
}

/// Features of positions: inputs `[x]`, or `[x, table]` where the encoding has parameters (any shape of the right length).
///
/// Knows its tangent, and reverse mode through that. A tangent of the tangent exists along the direction only.
#[derive(Clone, Copy, Debug)]
pub struct EncodingOp<E> {
    dot: TangentOp<E>,
}

impl<E: Encoder> EncodingOp<E> {
    /// The operation, computed at a SIMD level.
    pub fn new(encoder: E, simd: Simd) -> Self {
        Self { dot: TangentOp { encoder, simd } }
    }
}

impl<E: Encoder> CustomOp for EncodingOp<E> {
    fn name(&self) -> &'static str {
        E::NAME
    }

    fn shape(&self, inputs: &[Shape]) -> Result<Shape, TapeError> {
        self.dot.shape_of(inputs, 1)
    }

    fn forward(&self, inputs: &[View<'_>], out: &mut [f32], _saved: &mut [f32]) -> Result<(), TapeError> {
        let TangentOp { encoder, simd } = &self.dot;
        Ok(encoder.encode(*simd, table(inputs, 1), inputs[0].data, out)?)
    }

    fn backward(&self, args: BackwardArgs<'_>, _scratch: &mut [f32], bars: &mut [Bar<'_>]) -> Result<(), TapeError> {
        let TangentOp { encoder, simd } = &self.dot;
        let BackwardArgs { inputs, out_bar, .. } = args;
        let (x_bar, table_bar) = bars.split_at_mut(1);
        let bars = EncodingBars { table: wanted(table_bar), x: wanted(x_bar) };
        Ok(encoder.backward(*simd, table(inputs, 1), inputs[0].data, out_bar, bars)?)
    }

    fn tangent<'a>(
        &'a self,
        tape: &mut Tape<'a>,
        inputs: &[Node],
        input_tangents: &[Option<Node>],
        output: Node,
    ) -> Result<Node, TapeError> {
        let table = inputs.get(1).copied();
        let along_x = match input_tangents[0] {
            Some(x_dot) => Some(self.dot.record(tape, inputs[0], x_dot, table)?),
            None => None,
        };
        let along_table = match input_tangents.get(1).copied().flatten() {
            Some(_) if !self.dot.encoder.is_linear() => return Err(TapeError::NoTangent { op: E::NAME }),
            Some(table_dot) => Some(tape.custom(self, &[inputs[0], table_dot])?),
            None => None,
        };
        sum_of(tape, along_x, along_table, output)
    }
}

/// Derivative of the features: inputs `[x, x_dot]` or `[x, x_dot, table]`.
#[derive(Clone, Copy, Debug)]
struct TangentOp<E> {
    encoder: E,
    simd: Simd,
}

impl<E: Encoder> TangentOp<E> {
    fn record<'a>(&'a self, tape: &mut Tape<'a>, x: Node, x_dot: Node, table: Option<Node>) -> Result<Node, TapeError> {
        match table {
            Some(table) => tape.custom(self, &[x, x_dot, table]),
            None => tape.custom(self, &[x, x_dot]),
        }
    }

    /// Output shape, given `points` inputs before the table.
    fn shape_of(&self, inputs: &[Shape], points: usize) -> Result<Shape, TapeError> {
        let len = self.encoder.params_len();
        let want = points + usize::from(len > 0);
        if inputs.len() != want {
            return Err(TapeError::Length { op: E::NAME, what: "inputs", want, got: inputs.len() });
        }
        let cols = inputs[0].cols;
        for &got in &inputs[..points] {
            let want = Shape::new(self.encoder.in_rows(), cols);
            if got != want {
                return Err(TapeError::Shape { op: E::NAME, what: "x", want, got });
            }
        }
        if let Some(table) = inputs.get(points)
            && table.len() != len
        {
            return Err(TapeError::Length { op: E::NAME, what: "table", want: len, got: table.len() });
        }
        Ok(Shape::new(self.encoder.out_rows(), cols))
    }
}

impl<E: Encoder> CustomOp for TangentOp<E> {
    fn name(&self) -> &'static str {
        E::NAME
    }

    fn shape(&self, inputs: &[Shape]) -> Result<Shape, TapeError> {
        self.shape_of(inputs, 2)
    }

    fn forward(&self, inputs: &[View<'_>], out: &mut [f32], _saved: &mut [f32]) -> Result<(), TapeError> {
        Ok(self.encoder.tangent(self.simd, table(inputs, 2), inputs[0].data, inputs[1].data, out)?)
    }

    fn backward(&self, args: BackwardArgs<'_>, _scratch: &mut [f32], bars: &mut [Bar<'_>]) -> Result<(), TapeError> {
        let BackwardArgs { inputs, out_bar, .. } = args;
        let (table, x) = (table(inputs, 2), inputs[0].data);
        let (x_bar, rest) = bars.split_at_mut(1);
        let (x_dot_bar, table_bar) = rest.split_at_mut(1);
        let bars = EncodingBars { table: wanted(table_bar), x: wanted(x_bar) };
        if bars.table.is_some() || bars.x.is_some() {
            self.encoder.tangent_backward(self.simd, table, x, inputs[1].data, out_bar, bars)?;
        }
        if let Some(x_dot_bar) = wanted(x_dot_bar) {
            self.encoder.backward(self.simd, table, x, out_bar, EncodingBars::x(x_dot_bar))?;
        }
        Ok(())
    }

    fn tangent<'a>(
        &'a self,
        tape: &mut Tape<'a>,
        inputs: &[Node],
        input_tangents: &[Option<Node>],
        output: Node,
    ) -> Result<Node, TapeError> {
        if input_tangents[0].is_some() {
            return Err(TapeError::NoTangent { op: E::NAME });
        }
        // Linear in the direction.
        let along_x_dot = match input_tangents[1] {
            Some(x_dot) => Some(self.record(tape, inputs[0], x_dot, inputs.get(2).copied())?),
            None => None,
        };
        let along_table = match input_tangents.get(2).copied().flatten() {
            Some(_) if !self.encoder.is_linear() => return Err(TapeError::NoTangent { op: E::NAME }),
            Some(table_dot) => Some(self.record(tape, inputs[0], inputs[1], Some(table_dot))?),
            None => None,
        };
        sum_of(tape, along_x_dot, along_table, output)
    }
}

fn table<'v>(inputs: &[View<'v>], points: usize) -> &'v [f32] {
    inputs.get(points).map_or(&[], |view| view.data)
}

pub(super) fn wanted<'s>(bars: &'s mut [Bar<'_>]) -> Option<&'s mut [f32]> {
    bars.first_mut().filter(|bar| bar.demand == Demand::Wanted).map(|bar| &mut *bar.data)
}

fn sum_of(tape: &mut Tape<'_>, a: Option<Node>, b: Option<Node>, like: Node) -> Result<Node, TapeError> {
    match (a, b) {
        (Some(a), Some(b)) => tape.add(a, b),
        (Some(only), None) | (None, Some(only)) => Ok(only),
        (None, None) => {
            let shape = tape.shape(like)?;
            Ok(tape.fill(shape.rows, shape.cols, 0.0))
        }
    }
}
