//! Settings of the system; all of them can be given as `--set name=value`.

use crate::rays::MixtureKind;
use crate::space::SpaceKind;
use engine::system::{MOST_LAYERS, MOST_RAYS, MOST_UNITS, SystemError, at_most};
use serde::{Deserialize, Serialize};

/// Settings of [`Nerf`](super::Nerf). As published, but for `batch_rays`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NerfConfig {
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
    /// Octaves of the position, 10.
    pub position_octaves: usize,
    /// Octaves of the direction, 4.
    pub direction_octaves: usize,
    /// Width of the layers, 256.
    pub width: usize,
    /// Layers of the trunk, 8.
    pub depth: usize,
    /// Samples of the coarse network, 64.
    pub coarse: usize,
    /// Samples added for the fine network, 128.
    pub fine: usize,
    /// Deviation of the noise on the raw density in training: 0 for objects, 1 for real scenes.
    pub density_noise: f32,
    /// How a transient part shares an interval with the static one, where a photo model has one: `paper` or `proportional`.
    pub mixture: MixtureKind,
    /// Factor of the prior `ln(1 + 2 sigma^2)` on the densities of the coarse network, mean over its samples; 0: none.
    pub sparsity: f32,
    /// Rays of a batch. Published: 4096; fewer make more steps in the same time.
    pub batch_rays: usize,
    /// Learning rate at the start, 5e-4.
    pub lr: f32,
    /// Steps in which it falls to a tenth, 500 000 (250 000 for forward-facing scenes).
    pub lr_decay: u64,
}

impl NerfConfig {
    /// The published settings for a space.
    #[must_use]
    pub fn published(space: SpaceKind) -> Self {
        Self {
            space,
            centre: [0.0; 3],
            radius: 1.0,
            extent: 1.0,
            near: 0.05,
            position_octaves: 10,
            direction_octaves: 4,
            width: 256,
            depth: 8,
            coarse: 64,
            fine: 128,
            density_noise: if space == SpaceKind::Box { 0.0 } else { 1.0 },
            mixture: MixtureKind::Paper,
            sparsity: 0.0,
            batch_rays: 128,
            lr: 5e-4,
            lr_decay: if space == SpaceKind::Ndc { 250_000 } else { 500_000 },
        }
    }

    /// Learning rate of a step.
    #[must_use]
    pub fn learning_rate(&self, step: u64) -> f64 {
        f64::from(self.lr) * 0.1_f64.powf(step as f64 / self.lr_decay as f64)
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
        let positive = |field, value: f64| {
            if value > 0.0 && value.is_finite() {
                return Ok(());
            }
            Err(SystemError::Config { field, value: value.to_string(), problem: "must be positive and finite".into() })
        };
        positive("radius", self.radius)?;
        positive("extent", self.extent)?;
        positive("near", f64::from(self.near))?;
        positive("width", (self.width / 2) as f64)?;
        positive("depth", self.depth as f64)?;
        positive("batch_rays", self.batch_rays as f64)?;
        positive("lr", f64::from(self.lr))?;
        positive("lr_decay", self.lr_decay as f64)?;
        positive("density_noise + 1", f64::from(self.density_noise) + 1.0)?;
        for (field, octaves) in
            [("position_octaves", self.position_octaves), ("direction_octaves", self.direction_octaves)]
        {
            if octaves > 32 {
                let problem = "must be at most 32".into();
                return Err(SystemError::Config { field, value: octaves.to_string(), problem });
            }
        }
        if !(0.0..=10.0).contains(&self.sparsity) {
            return Err(SystemError::Config {
                field: "sparsity",
                value: self.sparsity.to_string(),
                problem: "must be in 0..=10".into(),
            });
        }
        if self.coarse < 3 {
            return Err(SystemError::Config {
                field: "coarse",
                value: self.coarse.to_string(),
                problem: "must be at least 3: the fine samples are drawn between the inner ones".into(),
            });
        }
        Ok(())
    }
}
