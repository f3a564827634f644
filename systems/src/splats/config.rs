//! Settings of the system, each with what it does; all of them can be given as `--set name=value`.

use engine::system::SystemError;
use serde::{Deserialize, Serialize};
use splat_core::{MAX_DEGREE, RasterSettings, Widening};

/// Where Gaussians begin.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum StartKind {
    /// At the points that the scene comes with.
    Points,
    /// Anywhere in the box that the cameras look at.
    Random,
}

/// How their number and places change while they learn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DensityKind {
    /// Adaptive density control: clone, split, prune, opacity reset (Kerbl et al., 2023, section 5.2).
    Adc,
    /// Relocation as a Markov chain, with noise (Kheradmand et al., "3D Gaussian splatting as Markov chain Monte Carlo", 2024).
    Mcmc,
}

/// Settings of [`Splat`](super::Splat). Lengths are in *internal* units: the extent of the cameras is 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SplatConfig {
    /// Centre of the scene, world units.
    pub centre: [f64; 3],
    /// Internal length 1 in world units: 1.1 times the largest distance of a camera from the mean of all.
    pub radius: f64,

    /// Where Gaussians begin: `points` or `random`.
    pub start: StartKind,
    /// How many begin at random places.
    pub start_count: usize,
    /// There are never more Gaussians than this, from the first step on.
    pub max_splats: usize,
    /// Degree of the spherical harmonics, 0 to 3.
    pub sh_degree: usize,
    /// Steps after which one more degree is active.
    pub sh_every: u64,

    /// How their number and places change: `adc` or `mcmc`.
    pub density: DensityKind,
    /// It changes after this step,
    pub densify_from: u64,
    /// before this one,
    pub densify_until: u64,
    /// and so often.
    pub densify_every: u64,
    /// `adc`: clone or split where the mean gradient of the centre is at least this, picture sizes a unit.
    pub densify_gradient: f32,
    /// `adc`: steps between two resets of opacity, each of which takes some hundred steps to recover from; 0: none.
    pub reset_every: u64,
    /// `adc`: Gaussians larger than so many extents of the cameras are removed after the first reset, without
    /// resets from the start; 0: none. Far things are made of large ones.
    pub prune_size: f32,
    /// Gaussians where points are seen through are removed, every [`densify_every`](Self::densify_every) steps to the end.
    pub free_space: bool,
    /// `mcmc`: what opacity and size cost, each a factor of its mean.
    pub mcmc_cost: f32,
    /// `mcmc`: strength of the noise, a factor of the learning rate of the centres.
    pub mcmc_noise: f32,

    /// Steps in which the learning rate of the centres falls to its end.
    pub horizon: u64,
    /// Learning rate of centres at the start,
    pub lr_mean: f64,
    /// and at the end.
    pub lr_mean_end: f64,
    /// Learning rate of colours at degree 0; those above: a twentieth of it.
    pub lr_dc: f64,
    /// Learning rate of opacities.
    pub lr_logit: f64,
    /// Learning rate of sizes.
    pub lr_scale: f64,
    /// Learning rate of rotations.
    pub lr_rotation: f64,

    /// Share of `1 - SSIM` in the loss.
    pub dssim: f32,
    /// Gaussians at this depth or nearer are left out.
    pub near: f32,
    /// What widening to a pixel does to opacity: `keeps` (as 3DGS) or `dims` (antialiased).
    pub widening: WideningKind,
    /// Pictures begin at `2^-coarse` of their size, and double
    pub coarse: u32,
    /// after so many steps each.
    pub coarse_steps: u64,
}

/// [`Widening`] as a word.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum WideningKind {
    /// Opacity stays.
    Keeps,
    /// Opacity falls with the area gained.
    Dims,
}

/// Learning rates of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rates {
    pub(super) mean: f64,
    dc: f64,
    logit: f64,
    scale: f64,
    rotation: f64,
}

impl Rates {
    /// In the order of the optimiser's groups.
    pub(super) fn groups(&self) -> [f64; 8] {
        let rest = self.dc / 20.0;
        [self.mean, self.scale, self.rotation, self.logit, self.dc, rest, rest, rest]
    }
}

impl SplatConfig {
    /// As published, for a scene around `centre` whose cameras extend over `radius`; schedules for `horizon` steps.
    ///
    /// # Panics
    /// In builds that check for overflow: when `horizon` is above 10^15.
    #[must_use]
    pub fn published(centre: [f64; 3], radius: f64, horizon: u64) -> Self {
        // The published schedules are for 30 000 steps.
        let scaled = |steps: u64| (steps * horizon / 30_000).max(1);
        Self {
            centre,
            radius,
            start: StartKind::Points,
            start_count: 20_000,
            max_splats: 100_000,
            sh_degree: 3,
            sh_every: scaled(1000).max(500),
            density: DensityKind::Adc,
            densify_from: scaled(500).max(300),
            densify_until: scaled(15_000),
            densify_every: 100,
            densify_gradient: 2e-4,
            reset_every: 0,
            prune_size: 0.0,
            free_space: false,
            mcmc_cost: 0.01,
            mcmc_noise: 5e5,
            horizon,
            lr_mean: 1.6e-4,
            lr_mean_end: 1.6e-6,
            lr_dc: 2.5e-3,
            lr_logit: 0.05,
            lr_scale: 5e-3,
            lr_rotation: 1e-3,
            dssim: 0.2,
            near: 0.01,
            widening: WideningKind::Keeps,
            coarse: 0,
            coarse_steps: 700,
        }
    }

    /// What rasterising goes by.
    pub(super) fn rules(&self) -> RasterSettings {
        let widening = match self.widening {
            WideningKind::Keeps => Widening::Keeps,
            WideningKind::Dims => Widening::Dims,
        };
        RasterSettings::DEFAULT.with_near(self.near).with_widening(widening)
    }

    /// Active degree at a step, counted from 0.
    pub(super) fn degree(&self, step: u64) -> usize {
        let degrees = step.checked_div(self.sh_every).unwrap_or(u64::MAX);
        self.sh_degree.min(usize::try_from(degrees).unwrap_or(MAX_DEGREE))
    }

    /// By how many halvings the picture of a step is smaller.
    pub(super) fn level(&self, step: u64) -> u32 {
        let doubled = step.checked_div(self.coarse_steps).unwrap_or(u64::MAX);
        self.coarse.saturating_sub(u32::try_from(doubled).unwrap_or(u32::MAX))
    }

    pub(super) fn rates(&self, step: u64) -> Rates {
        let part = (step as f64 / self.horizon.max(1) as f64).min(1.0);
        let mean = (self.lr_mean.ln() * (1.0 - part) + self.lr_mean_end.ln() * part).exp();
        Rates { mean, dc: self.lr_dc, logit: self.lr_logit, scale: self.lr_scale, rotation: self.lr_rotation }
    }

    /// # Errors
    /// [`SystemError::Config`] naming the first setting that cannot work.
    pub fn check(&self) -> Result<(), SystemError> {
        let positive = |field: &'static str, x: f64| {
            (!(x.is_finite() && x > 0.0)).then(|| (field, x.to_string(), "must be a positive number"))
        };
        let not_negative = |field: &'static str, x: f64| {
            (!(x.is_finite() && x >= 0.0)).then(|| (field, x.to_string(), "must be 0 or more"))
        };
        let problems = [
            positive("radius", self.radius),
            positive("lr_mean", self.lr_mean),
            positive("lr_mean_end", self.lr_mean_end),
            not_negative("lr_dc", self.lr_dc),
            not_negative("lr_logit", self.lr_logit),
            not_negative("lr_scale", self.lr_scale),
            not_negative("lr_rotation", self.lr_rotation),
            not_negative("mcmc_cost", self.mcmc_cost.into()),
            not_negative("mcmc_noise", self.mcmc_noise.into()),
            positive("densify_gradient", self.densify_gradient.into()),
            positive("near", self.near.into()),
            not_negative("prune_size", self.prune_size.into()),
            (!self.centre.iter().all(|x| x.is_finite()))
                .then(|| ("centre", format!("{:?}", self.centre), "must be three finite numbers")),
            (self.sh_degree > MAX_DEGREE).then(|| ("sh_degree", self.sh_degree.to_string(), "must be 0 to 3")),
            (!(0.0..=1.0).contains(&self.dssim)).then(|| ("dssim", self.dssim.to_string(), "must be 0 to 1")),
            (self.max_splats == 0 || self.max_splats > MOST)
                .then(|| ("max_splats", self.max_splats.to_string(), "must be 1 to 50 million")),
            (self.start_count > MOST)
                .then(|| ("start_count", self.start_count.to_string(), "must be at most 50 million")),
            (self.start == StartKind::Random && self.start_count == 0)
                .then(|| ("start_count", "0".into(), "must be at least 1 where they start at random")),
            (self.densify_every == 0).then(|| ("densify_every", "0".into(), "must be at least 1")),
            (self.coarse > 6).then(|| ("coarse", self.coarse.to_string(), "must be at most 6")),
        ];
        match problems.into_iter().flatten().next() {
            Some((field, value, problem)) => Err(SystemError::Config { field, value, problem: problem.into() }),
            None => Ok(()),
        }
    }
}

/// More Gaussians than this have no memory anywhere near a CPU.
const MOST: usize = 50_000_000;
