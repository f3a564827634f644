//! Settings of the filter and its loss, as published and on the hash grid.

use crate::limits::{MOST, above_0, positive, within};
use crate::occluders::likelihood;
use engine::system::SystemError;
use serde::{Deserialize, Serialize};

/// The features of photos.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FeatureKind {
    /// Files beside the photos; none where no photo has one.
    #[default]
    Files,
    /// There are none.
    None,
}

/// Settings of the filter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FilterConfig {
    /// Length of a photo's code.
    pub transient_dims: usize,
    /// Learning rate of the codes, relative to that of the field's networks.
    pub transient_lr: f32,
    /// Octaves of the place in the photo.
    pub filter_octaves: usize,
    /// Width of the layers.
    pub filter_width: usize,
    /// `files`, the features beside the photos where there are any, or `none`.
    pub filter_features: FeatureKind,
    /// Learning rate of the network, relative to that of the field's networks.
    pub filter_lr: f32,
    /// Steps in which all but the branch of the place learns at a tenth of that.
    pub filter_hold: u64,
    /// Steps from there until it does not.
    pub filter_ease: u64,
}

impl FilterConfig {
    /// As published (section 4).
    pub const PUBLISHED: Self = Self {
        transient_dims: 128,
        transient_lr: 1.0,
        filter_octaves: 15,
        filter_width: 128,
        filter_features: FeatureKind::Files,
        filter_lr: 0.1,
        filter_hold: 12_000,
        filter_ease: 10_000,
    };

    /// On the hash grid: a smaller filter, and hundreds of steps for thousands.
    pub const HASH_GRID: Self = Self {
        transient_dims: 32,
        transient_lr: 0.25,
        filter_octaves: 8,
        filter_width: 64,
        filter_hold: 250,
        filter_ease: 250,
        ..Self::PUBLISHED
    };

    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub fn check(&self) -> Result<(), SystemError> {
        within("transient_dims", self.transient_dims, 1..=512)?;
        within("filter_width", self.filter_width, 1..=512)?;
        above_0("transient_lr", self.transient_lr, MOST)?;
        above_0("filter_lr", self.filter_lr, MOST)
    }
}

/// Settings of the loss.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LayerConfig {
    /// Least uncertainty of a pixel, colour units.
    pub beta_min: f32,
    /// Above errors of about this the loss grows linearly instead of as the square, colour units; 0: always the square, as published.
    pub tail: f32,
    /// `kappa`, temperature of the opacities; towards 0 they are a coin toss.
    pub filter_temperature: f32,
    /// `lambda_alpha`, factor of the opacity.
    pub filter_opacity: f32,
    /// `lambda_sm`, factor of the opacities' change over the picture.
    pub filter_smoothness: f32,
}

impl LayerConfig {
    /// As published (section 4).
    pub const PUBLISHED: Self =
        Self { beta_min: 0.03, tail: 0.0, filter_temperature: 1.0, filter_opacity: 0.2, filter_smoothness: 5e-7 };

    /// On the hash grid.
    pub const HASH_GRID: Self = Self { beta_min: 0.1, ..Self::PUBLISHED };

    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub fn check(&self) -> Result<(), SystemError> {
        positive("filter_temperature", self.filter_temperature)?;
        likelihood::check(self.beta_min, self.tail)?;
        within("filter_opacity", self.filter_opacity, 0.0..=MOST)?;
        within("filter_smoothness", self.filter_smoothness, 0.0..=MOST)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_that_would_end_a_training_are_refused_before_it() {
        let (filter, layer) = (FilterConfig::HASH_GRID, LayerConfig::HASH_GRID);
        filter.check().unwrap();
        layer.check().unwrap();
        for (result, want) in [
            (FilterConfig { filter_width: 0, ..filter.clone() }.check(), "`filter_width` = 0: must be in 1..=512"),
            (
                FilterConfig { filter_lr: 1e10, ..filter }.check(),
                "`filter_lr` = 10000000000: must be above 0 and at most 1000",
            ),
            (
                LayerConfig { filter_temperature: 0.0, ..layer.clone() }.check(),
                "`filter_temperature` = 0: must be positive and finite",
            ),
            (
                LayerConfig { filter_smoothness: f32::NAN, ..layer }.check(),
                "`filter_smoothness` = NaN: must be in 0..=1000",
            ),
        ] {
            assert_eq!(result.unwrap_err().to_string(), want);
        }
    }
}
