//! Settings of the motion of a cloud.

use crate::fields::PlaneGridSource;
use crate::views::{first_of, positive, unless};
use engine::system::SystemError;
use serde::{Deserialize, Serialize};

/// What moves a cloud, before `--set`.
#[derive(Clone, Debug)]
pub(crate) struct MotionParts {
    pub(crate) settings: MotionSettings,
    pub(crate) features: PlaneGridSource,
}

/// The motion of a cloud.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct MotionSettings {
    /// Nothing moves before this share of the schedule: what stands still is learnt first.
    pub(crate) motion_from: f64,
    /// Units of each layer of the networks.
    pub(crate) motion_width: usize,
    /// Layers that all offsets share, besides the first.
    pub(crate) motion_layers: usize,
    /// Opacities change, too.
    pub(crate) motion_opacity: bool,
    /// Colours change, too.
    pub(crate) motion_colour: bool,
    /// Masks of a cloud in front change, too.
    pub(crate) motion_masks: bool,
    /// Learning rate of the networks where motion begins.
    pub(crate) motion_lr: f64,
    /// Learning rate of the networks at the end of the schedule.
    pub(crate) motion_lr_end: f64,
    /// Learning rate of the features where motion begins.
    pub(crate) motion_feature_lr: f64,
    /// Learning rate of the features at the end of the schedule.
    pub(crate) motion_feature_lr_end: f64,
    /// Factor of what neighbours move otherwise; 0: nothing.
    pub(crate) motion_coherence: f32,
    /// How near neighbours are, internal units.
    pub(crate) motion_reach: f32,
    /// What differs over the film by less than this share of itself stands still, and is not asked where it is; 0: all are asked.
    pub(crate) motion_rest: f32,
}

/// Networks wider or deeper than these are a mistake.
const MOST_WIDTH: usize = 512;
const MOST_LAYERS: usize = 8;

impl MotionSettings {
    /// # Errors
    /// [`SystemError::Config`] naming the first setting that cannot work.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        first_of([
            unless(
                (0.0..1.0).contains(&self.motion_from),
                "motion_from",
                self.motion_from,
                "must be a share, 0 to below 1",
            ),
            unless(
                (1..=MOST_WIDTH).contains(&self.motion_width),
                "motion_width",
                self.motion_width,
                "must be 1 to 512",
            ),
            unless(self.motion_layers <= MOST_LAYERS, "motion_layers", self.motion_layers, "must be at most 8"),
            positive("motion_lr", self.motion_lr),
            positive("motion_lr_end", self.motion_lr_end),
            positive("motion_feature_lr", self.motion_feature_lr),
            positive("motion_feature_lr_end", self.motion_feature_lr_end),
            unless(
                (0.0..=1e3).contains(&self.motion_coherence),
                "motion_coherence",
                self.motion_coherence,
                "must be 0 to 1000",
            ),
            unless(
                (1e-4..=10.0).contains(&self.motion_reach),
                "motion_reach",
                self.motion_reach,
                "must be 0.0001 to 10",
            ),
            unless((0.0..=10.0).contains(&self.motion_rest), "motion_rest", self.motion_rest, "must be 0 to 10"),
        ])
    }

    /// Rows of a cloud that say which of its Gaussians rest, after those of its masks.
    pub(crate) fn rows_at_rest(&self) -> usize {
        usize::from(self.motion_rest > 0.0)
    }

    /// Learning rates of networks and features at a share of the time that something moves, from 0 to 1: log-linear.
    pub(super) fn rates(&self, share: f64) -> [f64; 2] {
        let between = |from: f64, to: f64| (from.ln() * (1.0 - share) + to.ln() * share).exp();
        [between(self.motion_lr, self.motion_lr_end), between(self.motion_feature_lr, self.motion_feature_lr_end)]
    }
}
