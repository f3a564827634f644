//! Settings of the visibility map, as published and on the hash grid.

use crate::limits::{MOST, above_0, within};
use engine::system::SystemError;
use losses::visibility::SizeSchedule;
use serde::{Deserialize, Serialize};

/// Settings of the visibility map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VisibilityConfig {
    /// Length of a photo's code.
    pub visibility_dims: usize,
    /// Octaves of a pixel's place.
    pub visibility_octaves: usize,
    /// Width of the network's hidden layers.
    pub visibility_width: usize,
    /// Number of the network's hidden layers.
    pub visibility_depth: usize,
    /// Learning rate of the network, relative to that of the field's networks.
    pub visibility_lr: f32,
    /// Learning rate of the codes, relative to that of the field's networks.
    pub visibility_code_lr: f32,
    /// `lambda`, the price of leaving pixels out. A pixel is left out entirely from the squared error of four times this on.
    pub mask_size: f32,
    /// That price in the first step.
    pub mask_size_start: f32,
    /// The step from which on the price is `mask_size`.
    pub mask_size_steps: u64,
}

impl VisibilityConfig {
    /// As published; the schedule of the price as released.
    pub const PUBLISHED: Self = Self {
        visibility_dims: 128,
        visibility_octaves: 10,
        visibility_width: 256,
        visibility_depth: 4,
        visibility_lr: 1.0,
        visibility_code_lr: 1.0,
        mask_size: 6e-3,
        mask_size_start: 5e-2,
        mask_size_steps: 2121,
    };

    /// On the hash grid (`docs/decisions/0015-ha-nerf-on-a-fast-field.md`).
    pub const HASH_GRID: Self = Self {
        visibility_dims: 32,
        visibility_width: 64,
        visibility_depth: 2,
        visibility_lr: 0.1,
        visibility_code_lr: 0.5,
        mask_size_steps: 500,
        ..Self::PUBLISHED
    };

    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub fn check(&self) -> Result<(), SystemError> {
        above_0("visibility_lr", self.visibility_lr, MOST)?;
        above_0("visibility_code_lr", self.visibility_code_lr, MOST)?;
        above_0("mask_size", self.mask_size, MOST)?;
        above_0("mask_size_start", self.mask_size_start, MOST)?;
        within("visibility_dims", self.visibility_dims, 1..=512)?;
        within("visibility_octaves", self.visibility_octaves, 0..=16)?;
        within("visibility_width", self.visibility_width, 1..=1024)?;
        within("visibility_depth", self.visibility_depth, 1..=16)
    }

    /// `lambda` by step: exponential, then constant.
    pub(super) fn schedule(&self) -> SizeSchedule {
        let (start, floor) = (f64::from(self.mask_size_start), f64::from(self.mask_size));
        // The exponential meets the constant at the last step of the fall.
        let rate = if start > floor { (start / floor).ln() / self.mask_size_steps.max(1) as f64 } else { 0.0 };
        SizeSchedule { start, rate, floor }
    }
}
