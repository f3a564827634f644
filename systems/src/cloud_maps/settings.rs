//! Settings of the appearance from a reference photo.

use crate::cloud_reference::{MapShape, ReferenceSettings};
use crate::views::{SamplePlaces, first_of, not_negative, unless};
use engine::system::SystemError;
use serde::{Deserialize, Serialize};

/// Feature maps of a photo, and a tone for each Gaussian from them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct MapSettings {
    /// Side of the square that a photo is made before it is encoded, pixels; maps are half as wide.
    pub(crate) encoder_side: usize,
    /// Feature maps in which each Gaussian has a place of its own, besides the one that it is projected into.
    pub(crate) sampled_maps: usize,
    /// Numbers of a pixel of a map.
    pub(crate) map_channels: usize,
    /// Units of each of the two layers of the network of tones.
    pub(crate) tone_width: usize,
    /// Factor of what the network gives: how fast a tone leaves that of the cloud.
    pub(crate) tone_scale: f32,
    /// Whether a tone depends on the direction that a Gaussian is seen along; such an appearance cannot be written for other programs as it
    /// is, only as seen from nowhere.
    pub(crate) tone_direction: bool,
    /// Weight of what places outside of the maps cost.
    pub(crate) sample_weight: f32,
    /// Learning rate of what each Gaussian is, and of its places in the maps; it fades as those of the cloud do.
    pub(crate) place_code_lr: f64,
    /// Learning rate of the network of tones; of this and the encoder's a tenth is left at the end of the schedule.
    pub(crate) tone_lr: f64,
    /// Learning rate of the network that makes the maps.
    pub(crate) encoder_lr: f64,
}

/// Maps deeper than this are a mistake.
const MOST_CHANNELS: usize = 64;

impl MapSettings {
    /// # Errors
    /// [`SystemError::Config`] naming the first setting that cannot work.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        self.reference().check()?;
        let (channels, maps, most) = (self.map_channels, self.sampled_maps, SamplePlaces::MOST);
        first_of([
            unless(maps <= most, "sampled_maps", maps, "must be 0 to 4"),
            unless((1..=MOST_CHANNELS).contains(&channels), "map_channels", channels, "must be 1 to 64"),
            not_negative("sample_weight", self.sample_weight.into()),
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
            directed: self.tone_direction,
        }
    }

    /// Maps of a photo: the one that Gaussians are projected into, then those in which they have places.
    pub(super) fn shape(&self) -> MapShape {
        let planes = (1 + self.sampled_maps) * self.map_channels;
        MapShape { side: self.encoder_side, channels: 3, planes, tones: true }
    }

    /// Pixels along a side of a map.
    pub(super) fn map_side(&self) -> usize {
        self.encoder_side / 2
    }
}
