//! The network that moves points, in front of the network of the canonical scene: where in that scene a point of a time is.
//!
//! ```text
//! Psi(x, t) = after(gamma(x), before(gamma(x), gamma(t)))
//! dx = Psi(x, t) - Psi(x, 0)                  tied: nothing moves at t = 0, and next to nothing right after it
//! dx = Psi(x, t) for t != 0, 0 for t = 0      exact: nothing ties what is right after t = 0 to it
//! x' = x + dx
//! ```
//!
//! At `t = 0` nothing is evaluated for either origin: points keep their bits, and the network has no gradient.

use super::parts::{self, Part};
use super::when::When;
use crate::limits::refusal;
use engine::system::SystemError;
use field_core::encoding::frequency::{Base, Frequency, Identity};
use field_core::init::Init;
use field_core::mlp::{Activation, Mlp, MlpConfig, Packed};
use field_core::rng::Rng;
use field_core::tape::{EncodingOp, Node, Tape, TapeError};
use float_core::Simd;
use serde::{Deserialize, Serialize};

/// Layers before the encoded point comes in once more: it is seen by the sixth, as in the network of the canonical scene. The time
/// does not come in again.
const BEFORE: usize = 5;
/// Largest weight that the last layer begins with: points start where they are.
const SMALL: f32 = 1e-4;

/// What happens at `t = 0`, where nothing moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Origin {
    /// The displacement is the network's less that of `t = 0`: continuous in time. Two evaluations a point.
    Tied,
    /// The displacement is the network's, but for `t = 0` itself: it jumps there.
    Exact,
}

/// What a displacement is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DisplacementShape {
    /// What happens at `t = 0`.
    pub(crate) origin: Origin,
    /// Octaves of the point, with the point itself.
    pub(crate) octaves: usize,
    /// Octaves of the time, with the time itself.
    pub(crate) time_octaves: usize,
    /// Width of the layers.
    pub(crate) width: usize,
    /// Layers before the one that gives the displacement.
    pub(crate) depth: usize,
}

/// The layers of a displacement; coarse and fine network share them.
pub(super) struct Displacement {
    origin: Origin,
    point: Frequency,
    time: Frequency,
    before: Mlp,
    after: Mlp,
}

/// Its parameters as the kernels read them.
#[derive(Default)]
pub(super) struct PackedDisplacement([Packed; 2]);

/// Its tape operations.
pub(super) struct DisplacementOps<'a> {
    origin: Origin,
    point: EncodingOp<Frequency>,
    time: EncodingOp<Frequency>,
    /// Whether the second part sees the encoded point besides what the first one gives.
    skips: bool,
    parts: [Part<'a>; 2],
}

/// Points that were moved, on the tape.
#[derive(Clone, Copy)]
pub(super) struct Displaced {
    /// What the network sees of the points where they are.
    gamma: Node,
    when: When,
    /// `[3 x n]`, how far they move.
    delta: Node,
    /// `[3 x n]`, where they are in the canonical scene.
    pub(super) x: Node,
}

impl Displacement {
    /// # Errors
    /// [`SystemError::Config`] for encodings and layers that cannot be.
    pub(super) fn new(shape: DisplacementShape) -> Result<Self, SystemError> {
        let DisplacementShape { origin, octaves, time_octaves, width, depth } = shape;
        let gamma = |field, dims, octaves| {
            Frequency::new(dims, octaves, Base::One, Identity::Include).map_err(|e| refusal(field, octaves, e))
        };
        let (point, time) = (gamma("warp_octaves", 3, octaves)?, gamma("time_octaves", 1, time_octaves)?);
        let first = depth.clamp(1, BEFORE);
        let seen = if depth > BEFORE { point.out_rows() + width } else { width };
        let before = MlpConfig::new(point.out_rows() + time.out_rows(), vec![width; first - 1], width)
            .with_output_activation(Activation::Relu);
        let after = MlpConfig::new(seen, vec![width; depth.saturating_sub(BEFORE)], 3);
        let [before, after] = [before, after].map(|config| {
            Mlp::new(&config).map_err(|e| refusal("warp_width, warp_depth", format!("{width}, {depth}"), e))
        });
        Ok(Self { origin, point, time, before: before?, after: after? })
    }

    fn mlps(&self) -> [&Mlp; 2] {
        [&self.before, &self.after]
    }

    pub(super) fn param_count(&self) -> usize {
        parts::param_count(self.mlps())
    }

    /// Glorot-uniform weights but for the last layer's, which are next to nothing; zero biases.
    pub(super) fn init(&self, rng: Rng, params: &mut [f32]) {
        parts::init(self.mlps(), Init::XavierUniform, rng, params);
        let [_, after] = parts::ranges(self.mlps(), 0);
        if let Some(last) = self.after.layers().last() {
            let weights = &mut params[after][last.weights.clone()];
            Init::Uniform(SMALL).fill(rng.substream(u64::MAX), last.inputs, last.outputs, weights);
        }
    }

    /// Take new parameters.
    pub(super) fn pack(&self, params: &[f32], packed: &mut PackedDisplacement) {
        parts::pack(self.mlps(), params, &mut packed.0);
    }

    /// Its operations, for parameters that begin at `at` of those of the tape.
    pub(super) fn ops<'a>(&'a self, simd: Simd, packed: &'a PackedDisplacement, at: usize) -> DisplacementOps<'a> {
        DisplacementOps {
            origin: self.origin,
            point: EncodingOp::new(self.point, simd),
            time: EncodingOp::new(self.time, simd),
            skips: self.after.inputs() > self.before.outputs(),
            parts: parts::ops(self.mlps(), &packed.0, at, simd),
        }
    }
}

impl<'a> DisplacementOps<'a> {
    /// Record where points `x` `[3 x n]` are in the canonical scene.
    pub(super) fn displaced(&'a self, tape: &mut Tape<'a>, x: Node, when: When) -> Result<Displaced, TapeError> {
        let gamma = tape.custom(&self.point, &[x])?;
        let delta = self.delta(tape, gamma, when)?;
        Ok(Displaced { gamma, when, delta, x: tape.add(x, delta)? })
    }

    /// `|dx(t) - dx(t')|^2` of each sample, `[1 x n]`, for other times `t'`; 0 where nothing moves.
    pub(super) fn variation(
        &'a self,
        tape: &mut Tape<'a>,
        displaced: Displaced,
        other: When,
    ) -> Result<Node, TapeError> {
        let there = self.delta(tape, displaced.gamma, other)?;
        let difference = tape.sub(displaced.delta, there)?;
        let difference = match displaced.when.moves {
            Some(moves) => tape.mul_row(difference, moves)?,
            None => difference,
        };
        tape.dot(difference, difference)
    }

    /// `dx` `[3 x n]`.
    fn delta(&'a self, tape: &mut Tape<'a>, gamma: Node, when: When) -> Result<Node, TapeError> {
        let mut delta = self.psi(tape, gamma, when.t)?;
        if self.origin == Origin::Tied {
            let n = tape.shape(when.t)?.cols;
            let start = tape.fill(1, n, 0.0);
            let rest = self.psi(tape, gamma, start)?;
            delta = tape.sub(delta, rest)?;
        }
        match when.moves {
            Some(moves) => tape.mul_row(delta, moves),
            None => Ok(delta),
        }
    }

    /// `Psi(x, t)` `[3 x n]`.
    fn psi(&'a self, tape: &mut Tape<'a>, gamma: Node, t: Node) -> Result<Node, TapeError> {
        let [before, after] = &self.parts;
        let time = tape.custom(&self.time, &[t])?;
        let input = tape.concat(&[gamma, time])?;
        let hidden = before.apply(tape, input)?;
        let seen = if self.skips { tape.concat(&[gamma, hidden])? } else { hidden };
        after.apply(tape, seen)
    }
}
