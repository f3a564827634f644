//! Settings of the system, each with what it does; all of them can be given as `--set name=value`.

use super::occupy;
use crate::fields::{HashGridSettings, VoxelSettings};
use crate::space::SpaceKind;
use crate::terms::TermConfig;
use engine::system::{MOST_LAYERS, MOST_RAYS, MOST_SAMPLES, MOST_UNITS, SystemError, at_most};
use field_core::mlp::{Activation, Bias, Mlp, MlpConfig, Precision};
use losses::kernel::Kernel;
use render_core::quadrature::two::Mixture;
use serde::{Deserialize, Serialize};

/// How networks multiply.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum NetworkPrecision {
    /// 32-bit floats.
    #[default]
    F32,
    /// Factors rounded to bfloat16, sums and parameters 32-bit floats.
    Bf16,
}

impl NetworkPrecision {
    fn of(self, mlp: Mlp) -> Mlp {
        mlp.with_precision(match self {
            Self::F32 => Precision::F32,
            Self::Bf16 => Precision::Bf16,
        })
    }
}

/// What places samples along a ray.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Sampler {
    /// A march that skips what an occupancy grid knows to be empty.
    #[default]
    Occupancy,
    /// Small density fields that are asked first: a fixed number of samples a ray, however far space goes.
    Proposal,
}

/// Settings of [`Ngp`](super::Ngp). Lengths are in *internal* units: the radius of the scene is 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NgpConfig {
    /// How space is laid out: `box`, `contracted` or `ndc`.
    pub space: SpaceKind,
    /// Centre of the scene, world units.
    pub centre: [f64; 3],
    /// Internal length 1 in world units: half the side of a box scene, the inner region of an unbounded one.
    pub radius: f64,

    /// Levels of the hash grid.
    pub levels: usize,
    /// Features of a hash grid entry: 1, 2, 4 or 8.
    pub features: usize,
    /// Steps over which the levels come in, coarse to fine; 0: all from the start.
    pub levels_anneal: u64,
    /// Levels there are from the start, where the others come in later.
    pub levels_first: usize,
    /// Levels whose slopes lead what moves, the coarsest first: those of the finest say little about where to go.
    pub warp_levels: usize,
    /// Learning rate of the networks, a factor of that of the table.
    pub network_lr: f32,
    /// Hidden layers of the density network.
    pub density_layers: usize,
    /// Voxels along an axis, instead of a hash grid; 0: a hash grid. They begin with an eighth of them in all, and double in
    /// number three times.
    pub voxels: usize,
    /// Steps between one doubling and the next.
    pub voxels_every: u64,
    /// Each level has at most `2^log2_table` entries.
    pub log2_table: u32,
    /// Cells along an axis of the coarsest level.
    pub n_min: u32,
    /// Cells along an axis of the finest level.
    pub n_max: u32,
    /// How the networks multiply: `f32`, or `bf16` with sums in f32.
    pub precision: NetworkPrecision,
    /// Width of the hidden layers of both networks.
    pub width: usize,
    /// Hidden layers of the colour network.
    pub colour_layers: usize,
    /// Outputs of the density network: log-density first, all of them feed the colour network.
    pub geometry: usize,
    /// Degree of the spherical harmonics of the view direction, 1 to 4.
    pub sh_degree: usize,
    /// Added to the raw log-density: where the fog starts.
    pub density_bias: f32,

    /// What places samples: `occupancy` or `proposal`.
    pub sampler: Sampler,
    /// Intervals of a ray that each proposal weighs, one proposal for each number.
    pub proposal_samples: Vec<usize>,
    /// Samples of a ray after the proposals.
    pub final_samples: usize,

    /// Cells along an axis of the occupancy grid.
    pub occupancy: usize,
    /// Cubes of the occupancy grid, each twice the size of the one before.
    pub cascades: usize,
    /// A cell is empty below this optical thickness at the smallest step.
    pub occupancy_threshold: f32,
    /// Steps in which that threshold rises to its place, from half the thickness of a step through the initial field.
    pub occupancy_settle: u64,
    /// Steps between updates of the occupancy grid.
    pub occupancy_every: u64,

    /// Distance before which nothing is sampled.
    pub near: f32,
    /// Smallest step along the ray.
    pub step_min: f32,
    /// Step per distance from the camera; 0 keeps the step constant.
    pub step_cone: f32,

    /// A pixel is the mean of this many rays along each of its sides: 1 is a ray through its centre, 2 are four rays.
    pub rays_per_side: u32,
    /// A training ray ends where its transmittance falls below this; 0: it never does.
    pub train_stop: f32,
    /// Part of a ray's light that its faintest samples are left out with in training; 0: none of them is. Not where
    /// proposals learn from weights, or something else than the scene is looked for along a ray.
    pub train_faint: f32,
    /// Samples a ray may have on average in training: where there are more, steps grow until empty space is known.
    pub samples_per_ray: f32,
    /// Samples a batch aims at; the number of rays adapts.
    pub batch_samples: usize,
    /// Rays a batch has at most.
    pub batch_rays: usize,
    /// Learning rate at the start.
    pub lr: f32,
    /// Steps after which the learning rate starts to fall.
    pub lr_hold: u64,
    /// Learning rate at `lr_hold * 10` steps, as a part of `lr`; it falls as a power of the step, so that a run may go on
    /// for as long as it likes.
    pub lr_tenfold: f32,
    /// L2 penalty on the networks' weights (not on the grid).
    pub weight_decay: f32,
    /// What lies before the points that photos show is empty from the start.
    pub free_space: bool,
    /// Every ray ends in one more sample, at infinity: the sky, which is a colour for each direction. Only where space is
    /// contracted, with samples placed by the occupancy grid.
    pub sky: bool,
    /// Factor of the distortion loss, which draws the weight of a ray together; 0: none.
    pub distortion: f32,
    /// Factor of the prior `ln(1 + 2 sigma^2)` on static densities, mean over the samples of a ray; 0: none.
    pub sparsity: f32,
    /// Factor of the entropy of what reaches the background, mean over rays: each ends on something or nothing; 0: none.
    pub background_entropy: f32,
    /// Factor of the squared errors of the colours of single samples, by weight; mean over rays; 0: none.
    pub point_colour: f32,
    /// Huber threshold of the colour loss; 0 is the squared error.
    pub huber: f32,

    /// Width of the two hidden layers of the transient head, where a method has one.
    pub head_width: usize,
    /// Added to the head's raw density: how thin transient matter starts, 5 % of a ray's light at -3, less than 1 % at -5.
    pub head_bias: f32,
    /// How static and transient part share an interval: `paper` or `proportional`.
    pub mixture: MixtureKind,
}

/// How static and transient part share an interval.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MixtureKind {
    /// As published: each as if the other were not there, so that what both cover counts twice.
    #[default]
    Paper,
    /// In proportion to their densities: weights sum to 1.
    Proportional,
}

impl From<MixtureKind> for Mixture {
    fn from(kind: MixtureKind) -> Self {
        match kind {
            MixtureKind::Paper => Self::Paper,
            MixtureKind::Proportional => Self::Proportional,
        }
    }
}

/// Rounds of proposals at most, and intervals of a ray in each.
const MAX_PROPOSALS: usize = 3;
const MAX_INTERVALS: usize = 1024;

pub(super) fn bad(field: &'static str, value: impl ToString, problem: &str) -> SystemError {
    SystemError::Config { field, value: value.to_string(), problem: problem.into() }
}

impl NgpConfig {
    /// The hash grid.
    #[must_use]
    pub fn hash_grid(&self) -> HashGridSettings {
        let Self { levels, features, log2_table, n_min, n_max, levels_anneal, levels_first, warp_levels, .. } = *self;
        HashGridSettings { levels, features, log2_table, n_min, n_max, levels_anneal, levels_first, warp_levels }
    }

    /// The voxels.
    #[must_use]
    pub fn voxel_grid(&self) -> VoxelSettings {
        VoxelSettings { voxels: self.voxels, voxels_every: self.voxels_every, features: self.features }
    }

    /// The density network of so many inputs.
    ///
    /// # Errors
    /// [`SystemError::Config`] for an empty layer.
    ///
    /// # Panics
    /// If there is no memory for the layers; [`NgpConfig::check`] refuses them.
    pub fn density_mlp(&self, inputs: usize) -> Result<Mlp, SystemError> {
        Mlp::new(&MlpConfig {
            inputs,
            hidden: vec![self.width; self.density_layers],
            outputs: self.geometry,
            bias: Bias::None,
            hidden_activation: Activation::Relu,
            output_activation: Activation::None,
            skips: vec![],
        })
        .map(|mlp| self.precision.of(mlp))
        .map_err(|e| bad("width, geometry", "", &e.to_string()))
    }

    /// The colour network; `code` is the length of the appearance code it sees.
    ///
    /// # Errors
    /// [`SystemError::Config`] for an empty layer.
    ///
    /// # Panics
    /// As [`NgpConfig::density_mlp`].
    pub fn colour_mlp(&self, code: usize) -> Result<Mlp, SystemError> {
        Mlp::new(&MlpConfig {
            inputs: self.geometry + self.sh_degree * self.sh_degree + code,
            hidden: vec![self.width; self.colour_layers],
            outputs: 3,
            bias: Bias::None,
            hidden_activation: Activation::Relu,
            output_activation: Activation::LOGISTIC,
            skips: vec![],
        })
        .map(|mlp| self.precision.of(mlp))
        .map_err(|e| bad("width, colour_layers", "", &e.to_string()))
    }

    /// The hash grid of proposal `round`: small, and finer from round to round.
    #[must_use]
    pub fn proposal_grid(&self, round: usize) -> HashGridSettings {
        HashGridSettings {
            levels: 5,
            features: 2,
            log2_table: self.log2_table.min(17),
            n_min: 16,
            n_max: 128 << round.min(MAX_PROPOSALS),
            levels_anneal: 0,
            levels_first: 0,
            warp_levels: 0,
        }
    }

    /// The network of each proposal.
    ///
    /// # Errors
    /// None: its shape is fixed.
    pub fn proposal_mlp(&self) -> Result<Mlp, SystemError> {
        Mlp::new(&MlpConfig {
            inputs: 10,
            hidden: vec![16],
            outputs: 1,
            bias: Bias::None,
            hidden_activation: Activation::Relu,
            output_activation: Activation::None,
            skips: vec![],
        })
        .map_err(|e| bad("proposal_samples", format!("{:?}", self.proposal_samples), &e.to_string()))
    }

    /// Factors of the terms over whole rays.
    #[must_use]
    pub fn terms(&self) -> TermConfig {
        let Self { distortion, sparsity, background_entropy, point_colour, .. } = *self;
        TermConfig { distortion, sparsity, background_entropy, point_colour }
    }

    /// The colour loss.
    #[must_use]
    pub fn kernel(&self) -> Kernel {
        if self.huber > 0.0 { Kernel::Huber { delta: self.huber } } else { Kernel::Squared }
    }

    /// Learning rate of a step.
    #[must_use]
    pub fn learning_rate(&self, step: u64) -> f32 {
        let x = (step.max(1) as f64 / self.lr_hold.max(1) as f64).log10().max(0.0);
        (f64::from(self.lr) * f64::from(self.lr_tenfold).powf(x)).min(f32::MAX.into()) as f32
    }

    /// Check what the parts do not check themselves.
    ///
    /// # Errors
    /// [`SystemError::Config`] naming the field.
    pub fn check(&self) -> Result<(), SystemError> {
        let positive = |field, value: f64| {
            if value > 0.0 && value.is_finite() {
                Ok(())
            } else {
                Err(bad(field, value, "must be positive and finite"))
            }
        };
        at_most(&[
            ("width", self.width, MOST_UNITS),
            ("geometry", self.geometry, MOST_UNITS),
            ("head_width", self.head_width, MOST_UNITS),
            ("colour_layers", self.colour_layers, MOST_LAYERS),
            ("levels", self.levels, MOST_LAYERS),
            ("batch_rays", self.batch_rays, MOST_RAYS),
            ("batch_samples", self.batch_samples, MOST_SAMPLES),
        ])?;
        positive("radius", self.radius)?;
        positive("near", f64::from(self.near))?;
        if self.near > 1e6 {
            return Err(bad("near", self.near, "must be at most 1e6 radii"));
        }
        positive("step_min", f64::from(self.step_min))?;
        positive("lr", f64::from(self.lr))?;
        positive("network_lr", f64::from(self.network_lr))?;
        if !(1..=8).contains(&self.density_layers) {
            return Err(bad("density_layers", self.density_layers, "must be in 1..=8"));
        }
        positive("lr_tenfold", f64::from(self.lr_tenfold))?;
        positive("samples_per_ray", f64::from(self.samples_per_ray))?;
        positive("batch_samples", self.batch_samples as f64)?;
        positive("batch_rays", self.batch_rays as f64)?;
        positive("occupancy_every", self.occupancy_every as f64)?;
        positive("occupancy_threshold", f64::from(self.occupancy_threshold))?;
        if !(0.0..=1.0).contains(&self.step_cone) {
            return Err(bad("step_cone", self.step_cone, "must be in 0..=1"));
        }
        if !self.centre.iter().all(|c| c.is_finite()) {
            return Err(bad("centre", format!("{:?}", self.centre), "must be three finite numbers"));
        }
        if !(0.0..=10.0).contains(&self.huber) || !(0.0..=1.0).contains(&self.weight_decay) {
            return Err(bad("huber, weight_decay", format!("{}, {}", self.huber, self.weight_decay), "out of range"));
        }
        if !(1..=8).contains(&self.rays_per_side) {
            return Err(bad("rays_per_side", self.rays_per_side, "must be in 1..=8"));
        }
        if !(0.0..1.0).contains(&self.train_stop) {
            return Err(bad("train_stop", self.train_stop, "must be at least 0 and below 1"));
        }
        if !(0.0..1.0).contains(&self.train_faint) {
            return Err(bad("train_faint", self.train_faint, "must be at least 0 and below 1"));
        }
        if !(-20.0..=10.0).contains(&self.head_bias) {
            return Err(bad("head_bias", self.head_bias, "must be in -20..=10"));
        }
        self.terms().check()?;
        if !self.density_bias.is_finite() {
            return Err(bad("density_bias", self.density_bias, "must be finite"));
        }
        if !(1..=4).contains(&self.sh_degree) {
            return Err(bad("sh_degree", self.sh_degree, "must be 1, 2, 3 or 4"));
        }
        let counts = 2..=MAX_INTERVALS;
        let rounds = (1..=MAX_PROPOSALS).contains(&self.proposal_samples.len());
        if !rounds || !self.proposal_samples.iter().all(|n| counts.contains(n)) {
            let given = format!("{:?}", self.proposal_samples);
            let problem = format!("must be 1 to {MAX_PROPOSALS} numbers in 2..={MAX_INTERVALS}");
            return Err(bad("proposal_samples", given, &problem));
        }
        if !counts.contains(&self.final_samples) {
            return Err(bad("final_samples", self.final_samples, &format!("must be in 2..={MAX_INTERVALS}")));
        }
        if !(8..=512).contains(&self.occupancy) {
            return Err(bad("occupancy", self.occupancy, "must be in 8..=512"));
        }
        if !(1..=16).contains(&self.cascades) || (self.space != SpaceKind::Contracted && self.cascades != 1) {
            return Err(bad("cascades", self.cascades, "must be in 1..=16, and 1 unless `space` is contracted"));
        }
        // Along the diagonal of the outermost cube: equal steps, then steps that grow with the distance.
        let diagonal = 3.0_f32.sqrt() * 2.0_f32.powi(self.cascades as i32);
        let equal = diagonal.min(self.step_min / self.step_cone);
        let steps = equal / self.step_min + (diagonal / equal).ln() / self.step_cone.max(f32::MIN_POSITIVE);
        let (shortest, most) = (diagonal / 4e6, occupy::MAX_SAMPLES);
        if !(shortest..=100.0).contains(&self.step_min) || steps > most as f32 {
            let problem =
                format!("must be in {shortest:e}..=100, and make at most {most} steps of a ray, not {steps:e}");
            return Err(bad("step_min", self.step_min, &problem));
        }
        Ok(())
    }
}
