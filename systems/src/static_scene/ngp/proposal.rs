//! Proposals: small density fields that tell the field where along a ray to look.
//!
//! A ray is cut into intervals evenly in normalised distance; the first proposal weighs them, the ray is cut anew where the
//! weight is, the next proposal weighs those, and the field sees the last cut alone (`proposed.rs`). Proposals learn to
//! bound the weights that the field finds (the interlevel loss); no other loss reaches them, and theirs reaches nothing
//! else.
//!
//! Sources: Barron, Mildenhall, Verbin, Srinivasan, Hedman, "Mip-NeRF 360", 2022, section 3; hash grids for proposals as in
//! Tancik et al., "Nerfstudio", 2023 (nerfacto).

use super::NgpConfig;
use crate::fields::{Features, HashGridFeatures, Part, fold_gradients, xavier};
use crate::space::SpaceKind;
use engine::system::SystemError;
use field_core::mlp::{Mlp, Packed};
use field_core::rng::Rng;
use float_core::Simd;
use optim::{Adam, AdamConfig, Decay};
use render_core::proposal::{annealing_exponent, dilation};
use render_core::ray_distance::Warp;

/// Stream of random numbers of the initial parameters.
const INIT: u64 = 0x7072_6f70;
/// Steps in which the weights' exponent rises from 0 to 1, and how steeply it starts.
const ANNEAL_STEPS: f32 = 1000.0;
const ANNEAL_SLOPE: f32 = 10.0;
/// Half width by which a histogram is widened before it is cut: what remains, and what shrinks with the number of intervals.
const DILATION_BIAS: f32 = 0.0025;
const DILATION: f32 = 0.5;

/// All proposals of a field.
pub(super) struct Proposals {
    /// One for each round.
    pub(super) fields: Vec<ProposalField>,
    /// Intervals of each round, and those of the field.
    counts: Vec<usize>,
    /// What is spread evenly along a ray.
    pub(super) warp: Warp,
}

/// A density field: features and a network of one hidden layer. Positions are in the grid's `[0, 1]^3`.
pub(super) struct ProposalField {
    pub(super) features: Box<dyn Features>,
    pub(super) mlp: Mlp,
    pub(super) mlp_params: Vec<f32>,
    pub(super) packed: Packed,
    density_bias: f32,
    pub(super) mlp_adam: Adam,
    mlp_grad: Vec<f32>,
}

impl Proposals {
    /// # Errors
    /// [`SystemError::Config`] for sizes that cannot work.
    pub(super) fn new(config: &NgpConfig, seed: u64) -> Result<Self, SystemError> {
        let rng = Rng::new(seed, INIT);
        let rounds = 0..config.proposal_samples.len();
        let fields =
            rounds.map(|i| ProposalField::new(config, i, rng.substream(i as u64))).collect::<Result<_, _>>()?;
        let counts = config.proposal_samples.iter().copied().chain([config.final_samples]).collect();
        let warp = if config.space == SpaceKind::Contracted { Warp::Piecewise } else { Warp::Linear };
        Ok(Self { fields, counts, warp })
    }

    /// Intervals of each proposal's round.
    pub(super) fn rounds(&self) -> &[usize] {
        &self.counts[..self.fields.len()]
    }

    /// Intervals that the field sees.
    pub(super) fn last(&self) -> usize {
        self.counts[self.fields.len()]
    }

    /// Half width of the dilation on the way into round `round`, in normalised distance.
    pub(super) fn dilation(&self, round: usize) -> f32 {
        if round == 0 { 0.0 } else { dilation(DILATION_BIAS, DILATION, &self.counts[..round]) }
    }

    /// Exponent of the weights in training step `step`.
    pub(super) fn exponent(step: u64) -> f32 {
        annealing_exponent(step as f32 / ANNEAL_STEPS, ANNEAL_SLOPE)
    }

    /// Number of parameters.
    pub(super) fn parameter_count(&self) -> usize {
        self.fields.iter().map(|f| f.features.parameters().len() + f.mlp_params.len()).sum()
    }
}

impl ProposalField {
    fn new(config: &NgpConfig, round: usize, rng: Rng) -> Result<Self, SystemError> {
        let features = HashGridFeatures::new(config.proposal_grid(round), rng.substream(0))?;
        let mlp = config.proposal_mlp()?;
        let mlp_params = xavier(&mlp, rng.substream(1));
        let networks = AdamConfig { decay: Decay::L2(f64::from(config.weight_decay)), ..AdamConfig::NGP };
        let mut field = Self {
            mlp_adam: Adam::new(mlp_params.len(), networks),
            mlp_grad: vec![0.0; mlp_params.len()],
            packed: Packed::default(),
            density_bias: config.density_bias,
            features: Box::new(features),
            mlp,
            mlp_params,
        };
        field.pack();
        Ok(field)
    }

    /// Renew the packed parameters.
    pub(super) fn pack(&mut self) {
        self.mlp.pack(&self.mlp_params, &mut self.packed);
    }

    /// Features of a position.
    pub(super) fn rows(&self) -> usize {
        self.features.rows()
    }

    /// Density of a raw output: `exp`, finite.
    #[inline(always)]
    pub(super) fn density_of(&self, raw: f32) -> f32 {
        (raw + self.density_bias).clamp(-80.0, 80.0).exp()
    }

    /// One step of grid and network. Returns the count of non-finite gradients.
    pub(super) fn step<'g>(
        &mut self,
        simd: Simd,
        lr: f64,
        parts: &[Part<'_>],
        mlp_grads: impl Iterator<Item = &'g [f32]>,
        packed_grad: &mut Vec<f32>,
    ) -> usize {
        let bad = self.features.step(lr, parts);
        fold_gradients(&self.mlp, mlp_grads, packed_grad, &mut self.mlp_grad);
        let bad = bad + self.mlp_adam.step(simd, lr, &mut self.mlp_params, &self.mlp_grad);
        self.pack();
        bad
    }
}
