//! Settings of the system; all of them can be given as `--set name=value`.

use crate::limits::{at_least_1, positive, refuse, within};
use crate::networks::PlaceConfig;
use crate::settings::Settings;
use crate::space::SpaceKind;
use engine::system::{MOST_LAYERS, MOST_RAYS, MOST_UNITS, SystemError, at_most};
use optim::{LearningRate, Schedule, Warmup};
use render_core::quadrature::LastInterval;
use serde::{Deserialize, Serialize};

/// Most rounds of proposals, and most intervals of a round.
pub(super) const MOST_ROUNDS: usize = 8;
const MOST_INTERVALS: usize = 4096;
/// Largest factor of a loss, and largest dilation.
const MOST: f32 = 100.0;

/// What the last interval of a ray is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LastSample {
    /// A wall: every ray ends on something.
    Opaque,
    /// As long as it is; the background shows behind.
    Finite,
}

/// Where rays are sampled: rounds of proposals, then the final round. As published.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RoundsConfig {
    /// Distance before which nothing is sampled, internal units: 0.2 where space is contracted.
    pub near: f32,
    /// Distance behind which nothing is sampled where space is contracted, internal units: 1e6.
    pub far: f32,
    /// Proposal rounds, 2.
    pub proposals: usize,
    /// Intervals of each of them, 64.
    pub proposal_samples: usize,
    /// Intervals of the final round, 32.
    pub samples: usize,
    /// `opaque` or `finite`.
    pub last: LastSample,
    /// Half width in `s` by which histograms are dilated at least, 0.0025.
    pub dilation: f32,
    /// The same divided by the intervals of the rounds before, 0.5.
    pub dilation_spread: f32,
    /// Steepness of the annealing of proposal weights, 10.
    pub anneal_slope: f32,
}

impl RoundsConfig {
    /// What the last interval of each ray is.
    pub(super) fn last(&self) -> LastInterval {
        match self.last {
            LastSample::Opaque => LastInterval::Opaque,
            LastSample::Finite => LastInterval::Finite,
        }
    }

    /// Intervals of round `round`; the last is the final one.
    pub(super) fn intervals(&self, round: usize) -> usize {
        if round < self.proposals { self.proposal_samples } else { self.samples }
    }

    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub fn check(&self) -> Result<(), SystemError> {
        positive("near", self.near)?;
        positive("anneal_slope", self.anneal_slope)?;
        for (field, value) in [("proposal_samples", self.proposal_samples), ("samples", self.samples)] {
            if !(2..=MOST_INTERVALS).contains(&value) {
                return refuse(field, value, "must be in 2..=4096: one interval cannot be cut anew");
            }
        }
        within("proposals", self.proposals, 0..=MOST_ROUNDS)?;
        if !(self.far > self.near && self.far.is_finite()) {
            return refuse("far", self.far, "must be finite and beyond `near`");
        }
        within("dilation", self.dilation, 0.0..=MOST)?;
        within("dilation_spread", self.dilation_spread, 0.0..=MOST)
    }
}

/// The proposal network and the final one. As published.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NetworksConfig {
    /// Octaves of the position along each of the 21 directions, 12.
    pub octaves: usize,
    /// Octaves of the viewing direction, 4.
    pub direction_octaves: usize,
    /// Width of the proposal network, 256.
    pub proposal_width: usize,
    /// Layers of the proposal network, 4.
    pub proposal_depth: usize,
    /// Width of the final network, 1024.
    pub width: usize,
    /// Layers of the final network, 8.
    pub depth: usize,
    /// Features that go from the final network to its view branch, 256.
    pub bottleneck: usize,
    /// Width of the view branch, 128.
    pub view_width: usize,
}

impl NetworksConfig {
    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub fn check(&self) -> Result<(), SystemError> {
        let sizes = [
            ("width", self.width, MOST_UNITS),
            ("depth", self.depth, MOST_LAYERS),
            ("proposal_width", self.proposal_width, MOST_UNITS),
            ("proposal_depth", self.proposal_depth, MOST_LAYERS),
            ("bottleneck", self.bottleneck, MOST_UNITS),
            ("view_width", self.view_width, MOST_UNITS),
        ];
        at_most(&sizes)?;
        at_most(&[("octaves", self.octaves, MOST_LAYERS), ("direction_octaves", self.direction_octaves, MOST_LAYERS)])?;
        sizes.iter().try_for_each(|&(field, value, _)| at_least_1(field, value as u64))
    }
}

/// Losses. As published, but for `charbonnier` of objects.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LossConfig {
    /// Weight of the interlevel loss, 1.
    pub interlevel: f32,
    /// Weight of the distortion loss: 0.01, or 0 for objects.
    pub distortion: f32,
    /// Charbonnier constant of the colour loss: 0.001, or 1 for objects, which is all but the squared error.
    pub charbonnier: f32,
}

impl LossConfig {
    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub fn check(&self) -> Result<(), SystemError> {
        positive("charbonnier", self.charbonnier)?;
        within("interlevel", self.interlevel, 0.0..=MOST)?;
        within("distortion", self.distortion, 0.0..=MOST)
    }
}

/// Batches and their steps. As published, but for `batch_rays`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StepConfig {
    /// Rays of a batch. Published: 16384; fewer make more steps in the same time.
    pub batch_rays: usize,
    /// Learning rate at the start, 2e-3.
    pub lr: f32,
    /// Learning rate at the end, 2e-5.
    pub lr_final: f32,
    /// Steps of the learning rate's rise from a hundredth, 512.
    pub lr_warmup: u64,
    /// Steps from the first learning rate to the last, and of the annealing: 250 000.
    pub steps: u64,
    /// Largest norm of the gradient of each network, 1e-3.
    pub clip: f32,
}

impl StepConfig {
    /// Learning rate of a step.
    #[must_use]
    pub fn learning_rate(&self, step: u64) -> f64 {
        let schedule = Schedule::LogLerp { lr_init: self.lr.into(), lr_final: self.lr_final.into(), steps: self.steps };
        LearningRate { schedule, warmup: Warmup::Sine { start: 0.01, steps: self.lr_warmup } }.at(step)
    }

    /// Part of the training that is over.
    pub(super) fn fraction(&self, step: u64) -> f32 {
        (step as f64 / self.steps as f64) as f32
    }

    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub fn check(&self) -> Result<(), SystemError> {
        at_most(&[("batch_rays", self.batch_rays, MOST_RAYS)])?;
        at_least_1("batch_rays", self.batch_rays as u64)?;
        positive("lr", self.lr)?;
        positive("lr_final", self.lr_final)?;
        at_least_1("steps", self.steps)?;
        positive("clip", self.clip)
    }
}

/// Settings of [`MipNerf360`](super::MipNerf360), part by part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MipNerf360Config {
    /// Where the scene is: `box` or `contracted`.
    pub place: PlaceConfig,
    /// Where rays are sampled.
    pub rounds: RoundsConfig,
    /// Both networks.
    pub networks: NetworksConfig,
    /// Losses.
    pub loss: LossConfig,
    /// Batches and their steps.
    pub step: StepConfig,
}

impl MipNerf360Config {
    /// The published settings for a space; forward-facing scenes count as open ones.
    #[must_use]
    pub fn published(space: SpaceKind) -> Self {
        let object = space == SpaceKind::Box;
        Self {
            place: PlaceConfig::unit(if object { SpaceKind::Box } else { SpaceKind::Contracted }),
            rounds: RoundsConfig {
                near: if object { 0.05 } else { 0.2 },
                far: 1e6,
                proposals: 2,
                proposal_samples: 64,
                samples: 32,
                last: if object { LastSample::Finite } else { LastSample::Opaque },
                dilation: 0.0025,
                dilation_spread: 0.5,
                anneal_slope: 10.0,
            },
            networks: NetworksConfig {
                octaves: 12,
                direction_octaves: 4,
                proposal_width: 256,
                proposal_depth: 4,
                width: 1024,
                depth: 8,
                bottleneck: 256,
                view_width: 128,
            },
            loss: LossConfig {
                interlevel: 1.0,
                distortion: if object { 0.0 } else { 0.01 },
                charbonnier: if object { 1.0 } else { 1e-3 },
            },
            step: StepConfig { batch_rays: 64, lr: 2e-3, lr_final: 2e-5, lr_warmup: 512, steps: 250_000, clip: 1e-3 },
        }
    }

    /// The same after `--set`.
    ///
    /// # Errors
    /// [`SystemError::Config`] for a value of the wrong kind.
    pub(crate) fn asked(&self, settings: &mut Settings<'_>) -> Result<Self, SystemError> {
        Ok(Self {
            place: settings.of(&self.place)?,
            rounds: settings.of(&self.rounds)?,
            networks: settings.of(&self.networks)?,
            loss: settings.of(&self.loss)?,
            step: settings.of(&self.step)?,
        })
    }

    /// Check what the parts do not check when they are made.
    ///
    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub fn check(&self) -> Result<(), SystemError> {
        self.networks.check()?;
        self.step.check()?;
        self.place.check()?;
        self.rounds.check()?;
        self.loss.check()?;
        if self.place.space == SpaceKind::Ndc {
            return refuse("space", "ndc", "cones have no common width there; use `contracted` or `box`");
        }
        Ok(())
    }
}
