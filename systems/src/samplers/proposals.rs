//! Proposals: small density fields that say where along a ray the field needs samples.
//!
//! A ray is cut into intervals evenly in normalised distance; the first proposal weighs them, the ray is cut anew where the
//! weight is, the next proposal weighs those, and the field sees the last cut alone (`proposed.rs`). Proposals learn to
//! bound the weights that the field finds (the interlevel loss); no other loss reaches them, and theirs reaches nothing
//! else.
//!
//! Sources: Barron, Mildenhall, Verbin, Srinivasan, Hedman, "Mip-NeRF 360", 2022, section 3; hash grids for proposals as in
//! Tancik et al., "Nerfstudio", 2023 (nerfacto).

use crate::fields::{FeatureSource, Features, Names, Part, fold_gradients, xavier};
use crate::schedule::Done;
use crate::space::SpaceKind;
use engine::system::{SystemError, Tensor, TensorMap, f32_tensor, push_adam, take_adam, take_numbers};
use field_core::mlp::{Bias, Mlp, MlpConfig, Packed};
use field_core::rng::Rng;
use float_core::Simd;
use optim::{Adam, AdamConfig, Decay};
use render_core::proposal::{annealing_exponent, dilation};
use render_core::ray_distance::RaySpacing;
use serde::{Deserialize, Serialize};

/// Stream of random numbers of the initial parameters.
const INIT: u64 = 0x7072_6f70;
/// Steps in which the weights' exponent rises from 0 to 1, and how steeply it starts.
const ANNEAL_STEPS: f32 = 1000.0;
const ANNEAL_SLOPE: f32 = 10.0;
/// Half width by which a histogram is widened before it is cut: what remains, and what shrinks with the number of intervals.
const DILATION_BIAS: f32 = 0.0025;
const DILATION: f32 = 0.5;

/// Rounds of proposals at most, and intervals of a ray in each.
const MAX_PROPOSALS: usize = 3;
const MAX_INTERVALS: usize = 1024;

/// Settings of proposals.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProposalConfig {
    /// Intervals of a ray that each proposal weighs, one proposal for each number.
    pub proposal_samples: Vec<usize>,
    /// Samples of a ray after the proposals.
    pub final_samples: usize,
}

impl Default for ProposalConfig {
    fn default() -> Self {
        Self { proposal_samples: vec![64, 48], final_samples: 32 }
    }
}

impl ProposalConfig {
    /// Check the ranges.
    ///
    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    pub fn check(&self) -> Result<(), SystemError> {
        let counts = 2..=MAX_INTERVALS;
        let rounds = (1..=MAX_PROPOSALS).contains(&self.proposal_samples.len());
        let refuse = |field, value, problem| Err(SystemError::Config { field, value, problem });
        if !rounds || !self.proposal_samples.iter().all(|n| counts.contains(n)) {
            let problem = format!("must be 1 to {MAX_PROPOSALS} numbers in 2..={MAX_INTERVALS}");
            return refuse("proposal_samples", format!("{:?}", self.proposal_samples), problem);
        }
        if !counts.contains(&self.final_samples) {
            let problem = format!("must be in 2..={MAX_INTERVALS}");
            return refuse("final_samples", self.final_samples.to_string(), problem);
        }
        Ok(())
    }
}

/// All proposals of a field.
pub(crate) struct Proposals {
    /// One for each round.
    pub(crate) fields: Vec<ProposalField>,
    /// Intervals of each round, and those of the field.
    counts: Vec<usize>,
    /// What is spread evenly along a ray.
    pub(crate) warp: RaySpacing,
}

/// A density field: features and a network of one hidden layer. Positions are in the grid's `[0, 1]^3`.
pub(crate) struct ProposalField {
    pub(crate) features: Box<dyn Features>,
    pub(crate) mlp: Mlp,
    pub(crate) mlp_params: Vec<f32>,
    pub(crate) packed: Packed,
    density_bias: f32,
    pub(crate) mlp_adam: Adam,
    mlp_grad: Vec<f32>,
}

/// What the networks of proposals share with those of the field.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ProposalNetwork {
    /// Added to the raw log-density.
    pub(crate) density_bias: f32,
    /// L2 penalty on the weights.
    pub(crate) weight_decay: f64,
}

/// Width of a proposal's hidden layer.
const WIDTH: usize = 16;

impl Proposals {
    /// One proposal for each round, with features that suit those of the field.
    ///
    /// # Errors
    /// [`SystemError::Config`] for sizes that cannot work.
    pub(crate) fn new(
        config: &ProposalConfig,
        features: &dyn FeatureSource,
        kind: SpaceKind,
        network: ProposalNetwork,
        seed: u64,
    ) -> Result<Self, SystemError> {
        let rng = Rng::new(seed, INIT);
        let field = |i| ProposalField::new(&*features.proposal(i), network, rng.substream(i as u64));
        let fields = (0..config.proposal_samples.len()).map(field).collect::<Result<_, _>>()?;
        let counts = config.proposal_samples.iter().copied().chain([config.final_samples]).collect();
        let warp = if kind == SpaceKind::Contracted { RaySpacing::Piecewise } else { RaySpacing::Linear };
        Ok(Self { fields, counts, warp })
    }

    /// Intervals of each proposal's round.
    pub(crate) fn rounds(&self) -> &[usize] {
        &self.counts[..self.fields.len()]
    }

    /// Intervals that the field sees.
    pub(crate) fn last(&self) -> usize {
        self.counts[self.fields.len()]
    }

    /// Half width of the dilation on the way into round `round`, in normalised distance.
    pub(crate) fn dilation(&self, round: usize) -> f32 {
        if round == 0 { 0.0 } else { dilation(DILATION_BIAS, DILATION, &self.counts[..round]) }
    }

    /// Exponent of the weights in training step `step`.
    pub(crate) fn exponent(step: u64) -> f32 {
        annealing_exponent(step as f32 / ANNEAL_STEPS, ANNEAL_SLOPE)
    }

    /// Everything the next step depends on.
    pub(crate) fn push_state<'a>(&'a self, out: &mut Vec<Tensor<'a>>) {
        for (i, proposal) in self.fields.iter().enumerate() {
            proposal.features.push_state(&names(i), out);
            out.push(f32_tensor(format!("proposal.{i}.network"), &proposal.mlp_params));
            push_adam(out, &format!("proposal.{i}.network"), &proposal.mlp_adam);
        }
    }

    /// The proposals of a checkpoint that was written when so much was done.
    ///
    /// # Errors
    /// [`SystemError::State`] naming the array that is missing or has another shape.
    pub(crate) fn read_state(&self, state: &TensorMap, done: Done) -> Result<Vec<ProposalState>, SystemError> {
        let read = |(i, old): (usize, &ProposalField)| {
            Ok(ProposalState {
                features: old.features.restored(&names(i), state, done)?,
                network: take_numbers(state, &format!("proposal.{i}.network"), old.mlp_params.len())?,
                network_adam: take_adam(state, &format!("proposal.{i}.network"), &old.mlp_adam)?,
            })
        };
        self.fields.iter().enumerate().map(read).collect()
    }

    /// Go on from what [`Proposals::read_state`] gave.
    pub(crate) fn restore(&mut self, state: Vec<ProposalState>) {
        for (field, state) in self.fields.iter_mut().zip(state) {
            (field.features, field.mlp_params, field.mlp_adam) = (state.features, state.network, state.network_adam);
            field.pack();
        }
    }

    /// Number of parameters.
    pub(crate) fn parameter_count(&self) -> usize {
        self.fields.iter().map(|f| f.features.parameters().len() + f.mlp_params.len()).sum()
    }
}

/// Parameters and moments of a proposal.
pub(crate) struct ProposalState {
    features: Box<dyn Features>,
    network: Vec<f32>,
    network_adam: Adam,
}

/// The names of a proposal's features in a checkpoint.
fn names(round: usize) -> Names {
    Names::new(format!("proposal.{round}.grid"), format!("proposal.{round}.grid"))
}

impl ProposalField {
    fn new(source: &dyn FeatureSource, network: ProposalNetwork, rng: Rng) -> Result<Self, SystemError> {
        let features = source.features(rng.substream(0))?;
        let mlp = Mlp::new(&MlpConfig::new(features.rows(), vec![WIDTH], 1).with_bias(Bias::None)).map_err(|e| {
            // Nothing that is set: how many features there are is the source's.
            SystemError::Config { field: "features", value: features.rows().to_string(), problem: e.to_string() }
        })?;
        let mlp_params = xavier(&mlp, rng.substream(1));
        let networks = AdamConfig::NGP.with_decay(Decay::L2(network.weight_decay));
        let mut field = Self {
            mlp_adam: Adam::new(mlp_params.len(), networks),
            mlp_grad: vec![0.0; mlp_params.len()],
            packed: Packed::default(),
            density_bias: network.density_bias,
            features,
            mlp,
            mlp_params,
        };
        field.pack();
        Ok(field)
    }

    /// Renew the packed parameters.
    pub(crate) fn pack(&mut self) {
        self.mlp.pack(&self.mlp_params, &mut self.packed);
    }

    /// Features of a position.
    pub(crate) fn rows(&self) -> usize {
        self.features.rows()
    }

    /// Density of a raw output: `exp`, finite.
    #[inline(always)]
    pub(crate) fn density_of(&self, raw: f32) -> f32 {
        (raw + self.density_bias).clamp(-80.0, 80.0).exp()
    }

    /// One step of grid and network. Returns the count of non-finite gradients.
    pub(crate) fn step<'g>(
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
