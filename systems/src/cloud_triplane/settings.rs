//! Settings of the appearance from planes about a scene.

use crate::cloud_reference::{MapShape, ReferenceSettings, SIDE, is_side};
use crate::views::{first_of, not_negative, unless};
use engine::system::SystemError;
use serde::{Deserialize, Serialize};

/// A photo projected back to planes, its tones as a whole, and a tone for each Gaussian from both.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct TriplaneSettings {
    /// Side of the square that a photo is made before it is encoded and projected back, pixels.
    pub(crate) encoder_side: usize,
    /// Cells along a side of a plane that colours of a photo are projected back to; features are half as wide.
    pub(crate) plane_side: usize,
    /// Features of a place in a plane.
    pub(crate) plane_channels: usize,
    /// Share of the points beyond either end of the planes, along each axis: 0: the planes hold all points.
    pub(crate) plane_crop: f64,
    /// Share of the schedule before which nothing is projected back: depths say nothing yet. 1: nothing ever is.
    pub(crate) plane_from: f64,
    /// Numbers of a photo as a whole; 0: planes alone.
    pub(crate) photo_dims: usize,
    /// Units of each of the two layers of the network of tones.
    pub(crate) tone_width: usize,
    /// Factor of what the network gives: how fast a tone leaves that of the cloud.
    pub(crate) tone_scale: f32,
    /// Learning rate of what each Gaussian is; it fades as those of the cloud do.
    pub(crate) place_code_lr: f64,
    /// Learning rate of the network of tones; of this and the encoder's a tenth is left at the end of the schedule.
    pub(crate) tone_lr: f64,
    /// Learning rate of the networks that encode photo and planes.
    pub(crate) encoder_lr: f64,
}

/// Planes deeper and codes longer than these are a mistake.
const MOST_CHANNELS: usize = 64;
const MOST_DIMS: usize = 256;

/// Planes: across the third, the first and the second axis.
pub(super) const PLANES: usize = 3;
/// Channels of a plane before the network: colours from either side, and whether there is anything.
pub(super) const CHANNELS: usize = 7;

impl TriplaneSettings {
    /// Where nothing is said. Sizes are not published; local features come in after 1 000 of 30 000 steps there, of a cloud that begins at
    /// points.
    pub(crate) const PLANNED: Self = Self {
        encoder_side: 64,
        plane_side: 64,
        plane_channels: 8,
        plane_crop: 0.01,
        plane_from: 0.05,
        photo_dims: 32,
        tone_width: 32,
        tone_scale: 0.1,
        place_code_lr: 5e-3,
        tone_lr: 6e-3,
        encoder_lr: 2e-3,
    };

    /// # Errors
    /// [`SystemError::Config`] naming the first setting that cannot work.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        self.reference().check()?;
        let (channels, dims) = (self.plane_channels, self.photo_dims);
        first_of([
            unless(is_side(self.plane_side), "plane_side", self.plane_side, SIDE),
            unless((1..=MOST_CHANNELS).contains(&channels), "plane_channels", channels, "must be 1 to 64"),
            unless((0.0..=0.4).contains(&self.plane_crop), "plane_crop", self.plane_crop, "must be 0 to 0.4"),
            unless((0.0..=1.0).contains(&self.plane_from), "plane_from", self.plane_from, "must be a share, 0 to 1"),
            unless(dims <= MOST_DIMS, "photo_dims", dims, "must be 0 to 256"),
            not_negative("place_code_lr", self.place_code_lr),
        ])
    }

    /// What all kinds of reference photos have.
    pub(super) fn reference(&self) -> ReferenceSettings {
        ReferenceSettings {
            side: self.encoder_side,
            tone_width: self.tone_width,
            tone_scale: self.tone_scale,
            tone_lr: self.tone_lr,
            encoder_lr: self.encoder_lr,
            directed: false,
        }
    }

    /// Of the network that all planes go through.
    pub(super) fn shape(&self) -> MapShape {
        MapShape { side: self.plane_side, channels: CHANNELS, planes: self.plane_channels, tones: false }
    }

    /// Cells along a side of a plane of features.
    pub(super) fn feature_side(&self) -> usize {
        self.plane_side / 2
    }
}
