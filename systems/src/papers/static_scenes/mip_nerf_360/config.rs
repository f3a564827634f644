//! Settings of the system; all of them can be given as `--set name=value`.

use crate::space::SpaceKind;
use engine::system::{MOST_LAYERS, MOST_RAYS, MOST_UNITS, SystemError, at_most};
use optim::{LearningRate, Schedule, Warmup};
use render_core::quadrature::LastInterval;
use serde::{Deserialize, Serialize};

/// What the last interval of a ray is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LastSample {
    /// A wall: every ray ends on something.
    Opaque,
    /// As long as it is; the background shows behind.
    Finite,
}

/// Settings of [`MipNerf360`](super::MipNerf360). As published, but for `batch_rays`, and `charbonnier` of objects.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MipNerf360Config {
    /// How space is laid out: `box` or `contracted`.
    pub space: SpaceKind,
    /// Centre of the scene, world units.
    pub centre: [f64; 3],
    /// Internal length 1 in world units.
    pub radius: f64,
    /// Distance before which nothing is sampled, internal units: 0.2 where space is contracted.
    pub near: f32,
    /// Distance behind which nothing is sampled where space is contracted, internal units: 1e6.
    pub far: f32,
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
    /// Looks of the proposal network at a ray, 2.
    pub proposals: usize,
    /// Intervals of each of them, 64.
    pub proposal_samples: usize,
    /// Intervals of the final look, 32.
    pub samples: usize,
    /// `opaque` or `finite`.
    pub last: LastSample,
    /// Half width in `s` by which histograms are dilated at least, 0.0025.
    pub dilation: f32,
    /// The same divided by the intervals seen before, 0.5.
    pub dilation_spread: f32,
    /// Steepness of the annealing of proposal weights, 10.
    pub anneal_slope: f32,
    /// Weight of the interlevel loss, 1.
    pub interlevel: f32,
    /// Weight of the distortion loss: 0.01, or 0 for objects.
    pub distortion: f32,
    /// Charbonnier constant of the colour loss: 0.001, or 1 for objects, which is all but the squared error.
    pub charbonnier: f32,
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

pub(super) fn bad(field: &'static str, value: impl ToString, problem: &str) -> SystemError {
    SystemError::Config { field, value: value.to_string(), problem: problem.into() }
}

impl MipNerf360Config {
    /// The published settings for a space; forward-facing scenes count as open ones.
    #[must_use]
    pub fn published(space: SpaceKind) -> Self {
        let object = space == SpaceKind::Box;
        Self {
            space: if object { SpaceKind::Box } else { SpaceKind::Contracted },
            centre: [0.0; 3],
            radius: 1.0,
            near: if object { 0.05 } else { 0.2 },
            far: 1e6,
            octaves: 12,
            direction_octaves: 4,
            proposal_width: 256,
            proposal_depth: 4,
            width: 1024,
            depth: 8,
            bottleneck: 256,
            view_width: 128,
            proposals: 2,
            proposal_samples: 64,
            samples: 32,
            last: if object { LastSample::Finite } else { LastSample::Opaque },
            dilation: 0.0025,
            dilation_spread: 0.5,
            anneal_slope: 10.0,
            interlevel: 1.0,
            distortion: if object { 0.0 } else { 0.01 },
            charbonnier: if object { 1.0 } else { 1e-3 },
            batch_rays: 64,
            lr: 2e-3,
            lr_final: 2e-5,
            lr_warmup: 512,
            steps: 250_000,
            clip: 1e-3,
        }
    }

    /// Learning rate of a step.
    #[must_use]
    pub fn learning_rate(&self, step: u64) -> f64 {
        let schedule = Schedule::LogLerp { lr_init: self.lr.into(), lr_final: self.lr_final.into(), steps: self.steps };
        LearningRate { schedule, warmup: Warmup::Sine { start: 0.01, steps: self.lr_warmup } }.at(step)
    }

    /// What the last interval of each ray is.
    pub(super) fn last(&self) -> LastInterval {
        match self.last {
            LastSample::Opaque => LastInterval::Opaque,
            LastSample::Finite => LastInterval::Finite,
        }
    }

    /// Intervals of look `round`; the last is the final one.
    pub(super) fn intervals(&self, round: usize) -> usize {
        if round < self.proposals { self.proposal_samples } else { self.samples }
    }

    /// Check what the parts do not check themselves.
    ///
    /// # Errors
    /// [`SystemError::Config`] naming the field.
    pub fn check(&self) -> Result<(), SystemError> {
        at_most(&[
            ("width", self.width, MOST_UNITS),
            ("depth", self.depth, MOST_LAYERS),
            ("proposal_width", self.proposal_width, MOST_UNITS),
            ("proposal_depth", self.proposal_depth, MOST_LAYERS),
            ("bottleneck", self.bottleneck, MOST_UNITS),
            ("view_width", self.view_width, MOST_UNITS),
            ("octaves", self.octaves, MOST_LAYERS),
            ("direction_octaves", self.direction_octaves, MOST_LAYERS),
            ("batch_rays", self.batch_rays, MOST_RAYS),
        ])?;
        let positive = |field, value: f64| {
            if value > 0.0 && value.is_finite() {
                Ok(())
            } else {
                Err(bad(field, value, "must be positive and finite"))
            }
        };
        positive("radius", self.radius)?;
        positive("near", self.near.into())?;
        positive("proposal_width", self.proposal_width as f64)?;
        positive("proposal_depth", self.proposal_depth as f64)?;
        positive("width", self.width as f64)?;
        positive("depth", self.depth as f64)?;
        positive("bottleneck", self.bottleneck as f64)?;
        positive("view_width", self.view_width as f64)?;
        positive("anneal_slope", self.anneal_slope.into())?;
        positive("charbonnier", self.charbonnier.into())?;
        positive("batch_rays", self.batch_rays as f64)?;
        positive("lr", self.lr.into())?;
        positive("lr_final", self.lr_final.into())?;
        positive("steps", self.steps as f64)?;
        positive("clip", self.clip.into())?;
        let sizes = [("proposal_samples", self.proposal_samples), ("samples", self.samples)];
        for (field, value) in sizes {
            if !(2..=4096).contains(&value) {
                return Err(bad(field, value, "must be in 2..=4096: one interval cannot be cut anew"));
            }
        }
        if self.proposals > 8 {
            return Err(bad("proposals", self.proposals, "must be at most 8"));
        }
        if !(self.far > self.near && self.far.is_finite()) {
            return Err(bad("far", self.far, "must be finite and beyond `near`"));
        }
        for (field, value) in [
            ("dilation", self.dilation),
            ("dilation_spread", self.dilation_spread),
            ("interlevel", self.interlevel),
            ("distortion", self.distortion),
        ] {
            if !(0.0..=100.0).contains(&value) {
                return Err(bad(field, value, "must be in 0..=100"));
            }
        }
        if self.space == SpaceKind::Ndc {
            return Err(bad("space", "ndc", "cones have no common width there; use `contracted` or `box`"));
        }
        Ok(())
    }
}
