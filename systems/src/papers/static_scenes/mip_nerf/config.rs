//! Settings of the system; all of them can be given as `--set name=value`.

use crate::limits::{at_least_0, at_least_1, positive};
use crate::networks::{NetworkConfig, PlaceConfig, RaysConfig, TwoLevelConfig};
use crate::settings::Settings;
use crate::space::SpaceKind;
use engine::system::SystemError;
use optim::{LearningRate, Schedule, Warmup};
use serde::{Deserialize, Serialize};

/// Cones, and the losses of their two levels. As published.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ConesConfig {
    /// Added to the blurred weights of the coarse level, 0.01: the share of the fine level that is spread evenly.
    pub resample_padding: f32,
    /// How far colours may leave `[0, 1]` so that both ends can be reached, 0.001.
    pub colour_padding: f32,
    /// Factor of the coarse level's loss, 0.1.
    pub coarse_loss: f32,
    /// Side of the cube over which density and colour at a point are averaged, internal units: a pixel's size.
    pub point_size: f32,
}

impl ConesConfig {
    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub fn check(&self) -> Result<(), SystemError> {
        for (field, value) in [
            ("resample_padding", self.resample_padding),
            ("colour_padding", self.colour_padding),
            ("coarse_loss", self.coarse_loss),
            ("point_size", self.point_size),
        ] {
            at_least_0(field, value)?;
        }
        Ok(())
    }
}

/// The learning rate. As published.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RateConfig {
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

impl RateConfig {
    /// Learning rate of a step.
    #[must_use]
    pub fn learning_rate(&self, step: u64) -> f64 {
        let (lr_init, lr_final) = (self.lr.into(), self.lr_final.into());
        let schedule = Schedule::LogLerp { lr_init, lr_final, steps: self.lr_steps };
        let warmup = Warmup::Sine { start: self.warmup_start.into(), steps: self.warmup_steps };
        LearningRate { schedule, warmup }.at(step)
    }

    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub fn check(&self) -> Result<(), SystemError> {
        positive("lr", self.lr)?;
        positive("lr_final", self.lr_final)?;
        at_least_0("warmup_start", self.warmup_start)
    }
}

/// Settings of [`MipNerf`](super::MipNerf), part by part. As published, but for `batch_rays`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MipNerfConfig {
    /// What the systems of two levels share. Published: 16 octaves of the position, no noise, 128 intervals at each level.
    pub levels: TwoLevelConfig,
    /// Cones.
    pub cones: ConesConfig,
    /// The learning rate.
    pub rate: RateConfig,
}

impl MipNerfConfig {
    /// The published settings for a space.
    #[must_use]
    pub fn published(space: SpaceKind) -> Self {
        Self {
            levels: TwoLevelConfig {
                place: PlaceConfig::unit(space),
                network: NetworkConfig::published(16, 0.0),
                rays: RaysConfig::published(128, 128),
            },
            cones: ConesConfig { resample_padding: 0.01, colour_padding: 0.001, coarse_loss: 0.1, point_size: 0.005 },
            rate: RateConfig { lr: 5e-4, lr_final: 5e-6, lr_steps: 1_000_000, warmup_steps: 2500, warmup_start: 0.01 },
        }
    }

    /// The same after `--set`.
    ///
    /// # Errors
    /// [`SystemError::Config`] for a value of the wrong kind.
    pub(crate) fn asked(&self, settings: &mut Settings<'_>) -> Result<Self, SystemError> {
        Ok(Self {
            levels: self.levels.asked(settings)?,
            cones: settings.of(&self.cones)?,
            rate: settings.of(&self.rate)?,
        })
    }

    /// Check what the parts do not check when they are made.
    ///
    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub fn check(&self) -> Result<(), SystemError> {
        self.levels.check()?;
        self.cones.check()?;
        self.rate.check()?;
        let RaysConfig { coarse, fine, .. } = self.levels.rays;
        at_least_1("coarse", coarse as u64)?;
        at_least_1("fine", fine as u64)
    }
}
