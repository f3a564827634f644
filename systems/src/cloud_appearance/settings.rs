//! Settings of the appearance of a cloud.

use crate::views::{first_of, not_negative, positive, unless};
use engine::system::SystemError;
use serde::{Deserialize, Serialize};

/// What is done about photos of different appearance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum CloudAppearance {
    /// All have the same.
    #[default]
    None,
    /// A code for each photo and for each Gaussian, and a network that makes a tone of both.
    Codes,
    /// Feature maps of a photo, which each Gaussian reads where it is in the photo and where it learnt to, and a network that makes a tone
    /// of both.
    Maps,
    /// A photo projected back to planes about the scene, which each Gaussian reads where it is, and a network that makes a tone of that.
    Triplane,
}

/// The same, as a setting.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct AppearanceChoice {
    /// `none`, `codes`, `maps` or `triplane`.
    pub(crate) appearance: CloudAppearance,
}

/// A tone for each Gaussian in each photo.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ToneSettings {
    /// Numbers of a photo's code.
    pub(crate) appearance_dims: usize,
    /// Units of each of the two layers of the network.
    pub(crate) tone_width: usize,
    /// Factor of what the network gives: how fast a tone leaves that of the cloud.
    pub(crate) tone_scale: f32,
    /// Learning rate of the photos' codes; of this and the network's a tenth is left at the end of the schedule.
    pub(crate) code_lr: f64,
    /// Learning rate of the Gaussians' codes; it fades as those of the cloud do.
    pub(crate) place_code_lr: f64,
    /// Learning rate of the network.
    pub(crate) tone_lr: f64,
}

/// Codes longer, and networks wider than these are a mistake.
const MOST_DIMS: usize = 256;
const MOST_WIDTH: usize = 512;

impl ToneSettings {
    /// # Errors
    /// [`SystemError::Config`] naming the first setting that cannot work.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        let dims = self.appearance_dims;
        first_of([
            unless((1..=MOST_DIMS).contains(&dims), "appearance_dims", dims, "must be 1 to 256"),
            unless((1..=MOST_WIDTH).contains(&self.tone_width), "tone_width", self.tone_width, "must be 1 to 512"),
            positive("tone_scale", self.tone_scale.into()),
            positive("code_lr", self.code_lr),
            not_negative("place_code_lr", self.place_code_lr),
            positive("tone_lr", self.tone_lr),
        ])
    }
}

/// What is left of a rate at a share of the schedule, from 0 to 1: a tenth at its end.
pub(crate) fn rate_left(share: f64) -> f64 {
    0.1_f64.powf(share.clamp(0.0, 1.0))
}
