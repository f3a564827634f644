//! Settings of the system; all of them can be given as `--set name=value`.

use crate::space::SpaceKind;
use engine::system::{MOST_LAYERS, MOST_RAYS, MOST_UNITS, SystemError, at_most};
use optim::{LearningRate, Schedule, Warmup};
use serde::{Deserialize, Serialize};

/// Settings of [`MipNerf`](super::MipNerf). As published, but for `batch_rays`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MipNerfConfig {
    /// How space is laid out: `box`, `contracted` or `ndc`.
    pub space: SpaceKind,
    /// Centre of the scene, world units.
    pub centre: [f64; 3],
    /// Internal length 1 in world units.
    pub radius: f64,
    /// Half the side of the space, internal units: 1 unless `space` is contracted.
    pub extent: f64,
    /// Distance before which nothing is sampled, internal units.
    pub near: f32,
    /// Octaves of the position, 16: those finer than a pixel fade out by themselves.
    pub position_octaves: usize,
    /// Octaves of the direction, 4.
    pub direction_octaves: usize,
    /// Width of the layers, 256.
    pub width: usize,
    /// Layers of the trunk, 8.
    pub depth: usize,
    /// Intervals of the first look, 128.
    pub coarse: usize,
    /// Intervals of the second look, 128.
    pub fine: usize,
    /// Added to the blurred weights of the first look, 0.01: the share of the second that is spread evenly.
    pub resample_padding: f32,
    /// How far colours may leave `[0, 1]` so that both ends can be reached, 0.001.
    pub colour_padding: f32,
    /// Factor of the first look's loss, 0.1.
    pub coarse_loss: f32,
    /// Side of the cube over which density and colour at a point are averaged, internal units: a pixel's size.
    pub point_size: f32,
    /// Deviation of the noise on the raw density in training, 0.
    pub density_noise: f32,
    /// Rays of a batch. Published: 4096; fewer make more steps in the same time.
    pub batch_rays: usize,
    /// Learning rate at the start, 5e-4.
    pub lr: f32,
    /// Learning rate at the end, 5e-6.
    pub lr_final: f32,
    /// Steps from one to the other, 1 000 000.
    pub lr_steps: u64,
    /// Steps over which the rate rises at the start, 2500.
    pub warmup_steps: u64,
    /// What it rises from, as a share, 0.01.
    pub warmup_start: f32,
}

impl MipNerfConfig {
    /// The published settings for a space.
    #[must_use]
    pub fn published(space: SpaceKind) -> Self {
        Self {
            space,
            centre: [0.0; 3],
            radius: 1.0,
            extent: 1.0,
            near: 0.05,
            position_octaves: 16,
            direction_octaves: 4,
            width: 256,
            depth: 8,
            coarse: 128,
            fine: 128,
            resample_padding: 0.01,
            colour_padding: 0.001,
            coarse_loss: 0.1,
            point_size: 0.005,
            density_noise: 0.0,
            batch_rays: 128,
            lr: 5e-4,
            lr_final: 5e-6,
            lr_steps: 1_000_000,
            warmup_steps: 2500,
            warmup_start: 0.01,
        }
    }

    /// Learning rate of a step.
    #[must_use]
    pub fn learning_rate(&self, step: u64) -> f64 {
        let (lr_init, lr_final) = (self.lr.into(), self.lr_final.into());
        let schedule = Schedule::LogLerp { lr_init, lr_final, steps: self.lr_steps };
        let warmup = Warmup::Sine { start: self.warmup_start.into(), steps: self.warmup_steps };
        LearningRate { schedule, warmup }.at(step)
    }

    /// Check what the parts do not check themselves.
    ///
    /// # Errors
    /// [`SystemError::Config`] naming the field.
    pub fn check(&self) -> Result<(), SystemError> {
        at_most(&[
            ("width", self.width, MOST_UNITS),
            ("depth", self.depth, MOST_LAYERS),
            ("coarse", self.coarse, MOST_UNITS),
            ("fine", self.fine, MOST_UNITS),
            ("batch_rays", self.batch_rays, MOST_RAYS),
        ])?;
        let refuse = |field, value: f64, problem: &str| {
            Err(SystemError::Config { field, value: value.to_string(), problem: problem.into() })
        };
        for (field, value) in [
            ("radius", self.radius),
            ("extent", self.extent),
            ("near", self.near.into()),
            ("width", (self.width / 2) as f64),
            ("depth", self.depth as f64),
            ("coarse", self.coarse as f64),
            ("fine", self.fine as f64),
            ("batch_rays", self.batch_rays as f64),
            ("lr", self.lr.into()),
            ("lr_final", self.lr_final.into()),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return refuse(field, value, "must be positive and finite");
            }
        }
        for (field, value) in [
            ("resample_padding", self.resample_padding),
            ("colour_padding", self.colour_padding),
            ("coarse_loss", self.coarse_loss),
            ("point_size", self.point_size),
            ("density_noise", self.density_noise),
            ("warmup_start", self.warmup_start),
        ] {
            if !(value >= 0.0 && value.is_finite()) {
                return refuse(field, value.into(), "must be at least 0 and finite");
            }
        }
        Ok(())
    }
}
