//! Two networks: a small one that proposes where to look, asked in every proposal round, and the final one.

use super::MipNerf360Config;
use super::config::bad;
use crate::system::SystemError;
use field_core::encoding::frequency::{Base, Frequency, Identity};
use field_core::encoding::integrated::{Integrated, Projection, icosahedron};
use field_core::init::Init;
use field_core::mlp::{Activation, Bias, Mlp, MlpConfig, Packed};
use field_core::rng::Rng;
use field_core::tape::{EncodingOp, MlpOp, Node, Tape, TapeError};
use float_core::Simd;
use std::ops::Range;

/// An icosahedron's edges are cut in two: 21 directions.
const TESSELLATION: usize = 2;

/// Shapes of both networks.
pub(super) struct Shapes {
    pub(super) basis: Vec<[f64; 3]>,
    pub(super) projection: Projection,
    position: Integrated,
    direction: Frequency,
    proposal: Mlp,
    trunk: Mlp,
    density: Mlp,
    bottleneck: Mlp,
    colour: Mlp,
}

/// Parameters as the kernels read them.
#[derive(Default)]
pub(super) struct PackedNetworks([Packed; 5]);

/// Tape operations of both networks.
pub(super) struct Ops<'a> {
    position: EncodingOp<Integrated>,
    direction: EncodingOp<Frequency>,
    parts: [(MlpOp<'a>, Range<usize>); 5],
}

impl Shapes {
    pub(super) fn new(config: &MipNerf360Config) -> Result<Self, SystemError> {
        let refuse = |e: String| bad("octaves, width, depth", "", &e);
        let basis = icosahedron(TESSELLATION);
        let position = Integrated::new(basis.len(), config.octaves).map_err(|e| refuse(e.to_string()))?;
        let direction = Frequency::new(3, config.direction_octaves, Base::One, Identity::Include)
            .map_err(|e| refuse(e.to_string()))?;
        let mlp = |inputs, hidden: Vec<usize>, outputs, output_activation, skips| {
            Mlp::new(&MlpConfig {
                inputs,
                hidden,
                outputs,
                bias: Bias::Zero,
                hidden_activation: Activation::Relu,
                output_activation,
                skips,
            })
            .map_err(|e| refuse(e.to_string()))
        };
        let (w, d, rows) = (config.width, config.depth, position.out_rows());
        // As in NeRF: the encoding comes in again at the sixth layer.
        let skips = if d > 5 { vec![5] } else { vec![] };
        let proposal = vec![config.proposal_width; config.proposal_depth];
        Ok(Self {
            proposal: mlp(rows, proposal, 1, Activation::None, vec![])?,
            trunk: mlp(rows, vec![w; d - 1], w, Activation::Relu, skips)?,
            density: mlp(w, vec![], 1, Activation::None, vec![])?,
            bottleneck: mlp(w, vec![], config.bottleneck, Activation::None, vec![])?,
            colour: mlp(
                config.bottleneck + direction.out_rows(),
                vec![config.view_width],
                3,
                Activation::Logistic { pad: 1e-3 },
                vec![],
            )?,
            projection: Projection::new(&basis),
            basis,
            position,
            direction,
        })
    }

    fn mlps(&self) -> [&Mlp; 5] {
        [&self.proposal, &self.trunk, &self.density, &self.bottleneck, &self.colour]
    }

    /// Where each part's parameters lie.
    fn ranges(&self) -> [Range<usize>; 5] {
        let mut at = 0;
        self.mlps().map(|m| {
            at += m.param_count();
            at - m.param_count()..at
        })
    }

    /// Parameters of the proposal network; those of the final one follow.
    pub(super) fn proposal_params(&self) -> usize {
        self.proposal.param_count()
    }

    /// Parameters of both.
    pub(super) fn param_count(&self) -> usize {
        self.mlps().iter().map(|m| m.param_count()).sum()
    }

    /// He-uniform weights, zero biases.
    pub(super) fn init(&self, rng: Rng, params: &mut [f32]) {
        params.fill(0.0);
        let mut stream = 0;
        for (mlp, range) in self.mlps().into_iter().zip(self.ranges()) {
            let params = &mut params[range];
            for l in mlp.layers() {
                let weights = &mut params[l.weights.clone()];
                Init::HeUniform.fill(rng.substream(stream), l.inputs, l.outputs, weights);
                stream += 1;
            }
        }
    }

    pub(super) fn pack(&self, params: &[f32], packed: &mut PackedNetworks) {
        for ((mlp, range), packed) in self.mlps().into_iter().zip(self.ranges()).zip(&mut packed.0) {
            mlp.pack(&params[range], packed);
        }
    }

    pub(super) fn ops<'a>(&'a self, simd: Simd, packed: &'a PackedNetworks) -> Ops<'a> {
        let mut parts = self.mlps().into_iter().zip(&packed.0).zip(self.ranges());
        Ops {
            position: EncodingOp::new(self.position, simd),
            direction: EncodingOp::new(self.direction, simd),
            parts: std::array::from_fn(|_| {
                let ((mlp, packed), range) = parts.next().expect("five parts");
                (MlpOp { mlp, packed, simd }, range)
            }),
        }
    }
}

impl<'a> Ops<'a> {
    fn apply(&'a self, tape: &mut Tape<'a>, part: usize, x: Node) -> Result<Node, TapeError> {
        let (op, range) = &self.parts[part];
        let params = tape.param(range.start, range.len(), 1)?;
        tape.custom(op, &[x, params])
    }

    /// Density of the proposal network, `[1 x n]`: `x` `[42 x n]` means and variances along the directions.
    pub(super) fn proposal(&'a self, tape: &mut Tape<'a>, x: Node) -> Result<Node, TapeError> {
        let features = tape.custom(&self.position, &[x])?;
        let raw = self.apply(tape, 0, features)?;
        tape.softplus(raw, -1.0)
    }

    /// Trunk of the final network and its density, `[1 x n]`.
    pub(super) fn density(&'a self, tape: &mut Tape<'a>, x: Node) -> Result<(Node, Node), TapeError> {
        let features = tape.custom(&self.position, &[x])?;
        let h = self.apply(tape, 1, features)?;
        let raw = self.apply(tape, 2, h)?;
        Ok((h, tape.softplus(raw, -1.0)?))
    }

    /// Density `[1 x n]` and colour `[3 x n]` of the final network; `d` `[3 x n]` unit directions.
    pub(super) fn record(&'a self, tape: &mut Tape<'a>, x: Node, d: Node) -> Result<(Node, Node), TapeError> {
        let (h, sigma) = self.density(tape, x)?;
        let direction = tape.custom(&self.direction, &[d])?;
        let bottleneck = self.apply(tape, 3, h)?;
        let features = tape.concat(&[bottleneck, direction])?;
        Ok((sigma, self.apply(tape, 4, features)?))
    }
}
