//! Settings of the system; all of them can be given as `--set name=value`.

use crate::limits::{at_least_1, positive, within};
use crate::networks::{NetworkConfig, PlaceConfig, RaysConfig, TwoLevelConfig};
use crate::rays::MixtureKind;
use crate::settings::Settings;
use crate::space::SpaceKind;
use engine::system::SystemError;
use serde::{Deserialize, Serialize};

/// Most octaves of an encoding.
const MOST_OCTAVES: usize = 32;

/// Losses and learning rate. As published.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NerfTrainingConfig {
    /// How a transient part shares an interval with the static one, where a photo model has one: `paper` or `proportional`.
    pub mixture: MixtureKind,
    /// Factor of the prior `ln(1 + 2 sigma^2)` on the densities of the coarse network, mean over its samples; 0: none.
    pub sparsity: f32,
    /// Learning rate at the start, 5e-4.
    pub lr: f32,
    /// Steps in which it falls to a tenth, 500 000 (250 000 for forward-facing scenes).
    pub lr_decay: u64,
}

impl NerfTrainingConfig {
    /// Learning rate of a step.
    #[must_use]
    pub fn learning_rate(&self, step: u64) -> f64 {
        f64::from(self.lr) * 0.1_f64.powf(step as f64 / self.lr_decay as f64)
    }

    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub fn check(&self) -> Result<(), SystemError> {
        positive("lr", self.lr)?;
        at_least_1("lr_decay", self.lr_decay)?;
        within("sparsity", self.sparsity, 0.0..=10.0)
    }
}

/// Settings of [`Nerf`](super::Nerf), part by part. As published, but for `batch_rays`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NerfConfig {
    /// What the systems of two levels share. Published: 10 octaves of the position; noise of 0 for objects, 1 for real scenes; 64
    /// samples of the coarse network, 128 more for the fine one.
    pub levels: TwoLevelConfig,
    /// Losses and learning rate.
    pub training: NerfTrainingConfig,
}

impl NerfConfig {
    /// The published settings for a space.
    #[must_use]
    pub fn published(space: SpaceKind) -> Self {
        let density_noise = if space == SpaceKind::Box { 0.0 } else { 1.0 };
        Self {
            levels: TwoLevelConfig {
                place: PlaceConfig::unit(space),
                network: NetworkConfig::published(10, density_noise),
                rays: RaysConfig::published(64, 128),
            },
            training: NerfTrainingConfig {
                mixture: MixtureKind::Paper,
                sparsity: 0.0,
                lr: 5e-4,
                lr_decay: if space == SpaceKind::Ndc { 250_000 } else { 500_000 },
            },
        }
    }

    /// The same after `--set`.
    ///
    /// # Errors
    /// [`SystemError::Config`] for a value of the wrong kind.
    pub(crate) fn asked(&self, settings: &mut Settings<'_>) -> Result<Self, SystemError> {
        Ok(Self { levels: self.levels.asked(settings)?, training: settings.of(&self.training)? })
    }

    /// Check what the parts do not check when they are made.
    ///
    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub fn check(&self) -> Result<(), SystemError> {
        self.levels.check()?;
        self.training.check()?;
        let NetworkConfig { position_octaves, direction_octaves, .. } = self.levels.network;
        within("position_octaves", position_octaves, 0..=MOST_OCTAVES)?;
        within("direction_octaves", direction_octaves, 0..=MOST_OCTAVES)?;
        if self.levels.rays.coarse < 3 {
            return Err(SystemError::Config {
                field: "coarse",
                value: self.levels.rays.coarse.to_string(),
                problem: "must be at least 3: the fine samples are drawn between the inner ones".into(),
            });
        }
        Ok(())
    }
}
