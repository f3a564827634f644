//! Networks made of several parts, whose parameters lie one after the other in one vector.

use field_core::init::Init;
use field_core::mlp::{Mlp, Packed};
use field_core::rng::Rng;
use field_core::tape::{MlpOp, Node, Tape, TapeError};
use float_core::Simd;
use std::ops::Range;

/// Where each part's parameters lie, the first from `at` on.
pub(crate) fn ranges<const N: usize>(mlps: [&Mlp; N], mut at: usize) -> [Range<usize>; N] {
    mlps.map(|m| {
        at += m.param_count();
        at - m.param_count()..at
    })
}

/// Parameters of all parts.
pub(crate) fn param_count<const N: usize>(mlps: [&Mlp; N]) -> usize {
    mlps.iter().map(|m| m.param_count()).sum()
}

/// Random weights, zero biases.
pub(crate) fn init<const N: usize>(mlps: [&Mlp; N], weights: Init, rng: Rng, params: &mut [f32]) {
    params.fill(0.0);
    let mut stream = 0;
    for (mlp, range) in mlps.into_iter().zip(ranges(mlps, 0)) {
        let params = &mut params[range];
        for l in mlp.layers() {
            weights.fill(rng.substream(stream), l.inputs, l.outputs, &mut params[l.weights.clone()]);
            stream += 1;
        }
    }
}

/// Give the kernels their copies of new parameters.
pub(crate) fn pack<const N: usize>(mlps: [&Mlp; N], params: &[f32], packed: &mut [Packed; N]) {
    for ((mlp, range), packed) in mlps.into_iter().zip(ranges(mlps, 0)).zip(packed) {
        mlp.pack(&params[range], packed);
    }
}

/// The tape operation of a part.
pub(crate) struct Part<'a> {
    op: MlpOp<'a>,
    range: Range<usize>,
}

/// The tape operations of all parts, whose parameters begin at `at` of those of the tape.
pub(crate) fn ops<'a, const N: usize>(
    mlps: [&'a Mlp; N],
    packed: &'a [Packed; N],
    at: usize,
    simd: Simd,
) -> [Part<'a>; N] {
    let ranges = ranges(mlps, at);
    std::array::from_fn(|i| Part { op: MlpOp { mlp: mlps[i], packed: &packed[i], simd }, range: ranges[i].clone() })
}

impl<'a> Part<'a> {
    /// Record the part.
    pub(crate) fn apply(&'a self, tape: &mut Tape<'a>, x: Node) -> Result<Node, TapeError> {
        let params = tape.param(self.range.start, self.range.len(), 1)?;
        tape.custom(&self.op, &[x, params])
    }
}
