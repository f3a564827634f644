//! A network of a deformation, with the kernels' copy of its parameters.

use field_core::mlp::{Mlp, Packed};
use field_core::tape::{BackwardArgs, Bar, CustomOp, MlpOp, Node, Shape, Tape, TapeError, View, layers};
use float_core::Simd;
use std::ops::Range;

/// A network whose parameters lie in those of a deformation.
pub(crate) struct Network {
    op: Op,
    range: Range<usize>,
}

/// [`MlpOp`] that owns its network: a deformation is recorded on many tapes.
struct Op {
    mlp: Mlp,
    packed: Packed,
    simd: Simd,
}

impl Network {
    pub(super) fn new(mlp: Mlp, range: Range<usize>, simd: Simd) -> Self {
        Self { op: Op { mlp, packed: Packed::default(), simd }, range }
    }

    /// The outputs of the network for inputs `[rows x n]`, one matrix above the other.
    ///
    /// # Errors
    /// [`TapeError`] for another number of rows.
    pub(crate) fn of<'a>(&'a self, tape: &mut Tape<'a>, inputs: &[Node]) -> Result<Node, TapeError> {
        let input = tape.concat(inputs)?;
        let params = tape.param(self.range.start, self.range.len(), 1)?;
        tape.custom(&self.op, &[input, params])
    }

    /// New parameters of the deformation.
    pub(super) fn renew(&mut self, params: &[f32]) {
        self.op.mlp.pack(&params[self.range.clone()], &mut self.op.packed);
    }
}

impl Op {
    fn borrowed(&self) -> MlpOp<'_> {
        MlpOp { mlp: &self.mlp, packed: &self.packed, simd: self.simd }
    }
}

impl CustomOp for Op {
    fn name(&self) -> &'static str {
        "mlp"
    }

    fn shape(&self, inputs: &[Shape]) -> Result<Shape, TapeError> {
        self.borrowed().shape(inputs)
    }

    fn saved_len(&self, inputs: &[Shape]) -> usize {
        self.borrowed().saved_len(inputs)
    }

    fn scratch_len(&self, inputs: &[Shape]) -> usize {
        self.borrowed().scratch_len(inputs)
    }

    fn forward(&self, inputs: &[View<'_>], out: &mut [f32], saved: &mut [f32]) -> Result<(), TapeError> {
        self.borrowed().forward(inputs, out, saved)
    }

    fn backward(&self, args: BackwardArgs<'_>, scratch: &mut [f32], bars: &mut [Bar<'_>]) -> Result<(), TapeError> {
        self.borrowed().backward(args, scratch, bars)
    }

    /// As that of [`MlpOp`].
    fn tangent<'a>(
        &'a self,
        tape: &mut Tape<'a>,
        inputs: &[Node],
        input_tangents: &[Option<Node>],
        _output: Node,
    ) -> Result<Node, TapeError> {
        let y = layers(tape, &self.mlp, inputs[0], inputs[1])?;
        let seeds = inputs.iter().zip(input_tangents).filter_map(|(&input, dot)| dot.map(|dot| (input, dot)));
        let [y_dot] = tape.jvp([y], &seeds.collect::<Vec<_>>())?;
        Ok(y_dot)
    }
}
