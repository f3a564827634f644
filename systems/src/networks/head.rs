//! The transient head of the fine network: what one photo alone shows. It sees the trunk's features and the code of the
//! photo, and says how dense, of which colour and how uncertain what stood there was (NeRF in the Wild, section 4.2).

use super::parts::{self, Part};
use crate::limits::refusal;
use engine::system::SystemError;
use field_core::init::Init;
use field_core::mlp::{Mlp, MlpConfig, Packed};
use field_core::rng::Rng;
use field_core::tape::{Node, Tape, TapeError};
use float_core::Simd;
use render_core::quadrature::two::Mixture;

/// Hidden layers, of half the trunk's width each.
const LAYERS: usize = 4;
/// Density, three colours, uncertainty.
const OUTPUTS: usize = 5;
/// Added to the raw density: transient matter starts thin, with a transmittance of nine tenths across the box of the scene.
const DENSITY_SHIFT: f32 = -3.0;

/// Shape of the head, and its parameters as the kernels read them.
pub(super) struct Head {
    mlp: Mlp,
    packed: [Packed; 1],
    /// Where its parameters begin in those of the fine level: behind the network's.
    at: usize,
    /// How the two parts share an interval.
    pub(super) mixture: Mixture,
}

/// What the head says about a set of samples.
pub(super) struct Transient {
    /// `[1 x n]`
    pub(super) sigma: Node,
    /// `[3 x n]`
    pub(super) rgb: Node,
    /// `[1 x n]`
    pub(super) beta: Node,
}

impl Head {
    /// For a trunk of `width` features and codes of `dims`; its parameters begin at `at`.
    pub(super) fn new(width: usize, dims: usize, at: usize, mixture: Mixture) -> Result<Self, SystemError> {
        let mlp = Mlp::new(&MlpConfig::new(width + dims, vec![width / 2; LAYERS], OUTPUTS))
            .map_err(|e| refusal("width", width, e))?;
        Ok(Self { at, packed: [Packed::default()], mlp, mixture })
    }

    pub(super) fn param_count(&self) -> usize {
        self.mlp.param_count()
    }

    /// Glorot-uniform weights, zero biases.
    pub(super) fn init(&self, rng: Rng, params: &mut [f32]) {
        parts::init([&self.mlp], Init::XavierUniform, rng, params);
    }

    /// Take new parameters.
    pub(super) fn pack(&mut self, params: &[f32]) {
        parts::pack([&self.mlp], params, &mut self.packed);
    }

    pub(super) fn op(&self, simd: Simd) -> Part<'_> {
        let [part] = parts::ops([&self.mlp], &self.packed, self.at, simd);
        part
    }

    /// Record the head, whose operation `op` is: `trunk` `[width x n]`, `code` `[dims x n]`.
    pub(super) fn record<'a>(
        op: &'a Part<'a>,
        tape: &mut Tape<'a>,
        trunk: Node,
        code: Node,
    ) -> Result<Transient, TapeError> {
        let x = tape.concat(&[trunk, code])?;
        let raw = op.apply(tape, x)?;
        let [sigma, rgb, beta] = [0..1, 1..4, 4..5].map(|rows| tape.slice(raw, rows));
        Ok(Transient {
            sigma: tape.softplus(sigma?, DENSITY_SHIFT)?,
            rgb: tape.logistic(rgb?)?,
            beta: tape.softplus(beta?, 0.0)?,
        })
    }
}
