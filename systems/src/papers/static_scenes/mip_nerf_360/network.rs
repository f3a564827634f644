//! Two networks: a small one that proposes where density may be, asked in every proposal round, and the final one.

use super::config::NetworksConfig;
use crate::limits::refusal;
use crate::networks::parts::{self, Part};
use crate::settings::together;
use engine::system::SystemError;
use field_core::encoding::frequency::{Base, Frequency, Identity};
use field_core::encoding::integrated::{Integrated, Projection, icosahedron};
use field_core::init::Init;
use field_core::mlp::{Activation, Mlp, MlpConfig, Packed};
use field_core::rng::Rng;
use field_core::tape::{EncodingOp, Node, Tape, TapeError};
use float_core::Simd;

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
    parts: [Part<'a>; 5],
}

/// Settings of the layers.
const SIZES: &str = "width, depth, proposal_width, proposal_depth, bottleneck, view_width";

impl Shapes {
    pub(super) fn new(config: &NetworksConfig) -> Result<Self, SystemError> {
        let basis = icosahedron(TESSELLATION);
        let position =
            Integrated::new(basis.len(), config.octaves).map_err(|e| refusal("octaves", config.octaves, e))?;
        let direction = Frequency::new(3, config.direction_octaves, Base::One, Identity::Include)
            .map_err(|e| refusal("direction_octaves", config.direction_octaves, e))?;
        let mlp = |inputs, hidden: Vec<usize>, outputs, output_activation, skips| {
            Mlp::new(
                &MlpConfig::new(inputs, hidden, outputs).with_output_activation(output_activation).with_skips(skips),
            )
            .map_err(|e| together(SIZES, config, e))
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

    /// Parameters of the proposal network; those of the final one follow.
    pub(super) fn proposal_params(&self) -> usize {
        self.proposal.param_count()
    }

    /// Parameters of both.
    pub(super) fn param_count(&self) -> usize {
        parts::param_count(self.mlps())
    }

    /// He-uniform weights, zero biases.
    pub(super) fn init(&self, rng: Rng, params: &mut [f32]) {
        parts::init(self.mlps(), Init::HeUniform, rng, params);
    }

    pub(super) fn pack(&self, params: &[f32], packed: &mut PackedNetworks) {
        parts::pack(self.mlps(), params, &mut packed.0);
    }

    pub(super) fn ops<'a>(&'a self, simd: Simd, packed: &'a PackedNetworks) -> Ops<'a> {
        Ops {
            position: EncodingOp::new(self.position, simd),
            direction: EncodingOp::new(self.direction, simd),
            parts: parts::ops(self.mlps(), &packed.0, 0, simd),
        }
    }
}

impl<'a> Ops<'a> {
    /// Density of the proposal network, `[1 x n]`: `x` `[42 x n]` means and variances along the directions.
    pub(super) fn proposal(&'a self, tape: &mut Tape<'a>, x: Node) -> Result<Node, TapeError> {
        let features = tape.custom(&self.position, &[x])?;
        let raw = self.parts[0].apply(tape, features)?;
        tape.softplus(raw, -1.0)
    }

    /// Trunk of the final network and its density, `[1 x n]`.
    pub(super) fn density(&'a self, tape: &mut Tape<'a>, x: Node) -> Result<(Node, Node), TapeError> {
        let features = tape.custom(&self.position, &[x])?;
        let h = self.parts[1].apply(tape, features)?;
        let raw = self.parts[2].apply(tape, h)?;
        Ok((h, tape.softplus(raw, -1.0)?))
    }

    /// Density `[1 x n]` and colour `[3 x n]` of the final network; `d` `[3 x n]` unit directions.
    pub(super) fn record(&'a self, tape: &mut Tape<'a>, x: Node, d: Node) -> Result<(Node, Node), TapeError> {
        let (h, sigma) = self.density(tape, x)?;
        let direction = tape.custom(&self.direction, &[d])?;
        let bottleneck = self.parts[3].apply(tape, h)?;
        let features = tape.concat(&[bottleneck, direction])?;
        Ok((sigma, self.parts[4].apply(tape, features)?))
    }
}
