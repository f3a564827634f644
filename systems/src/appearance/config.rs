//! Settings of appearance models.

use crate::limits::{MOST, above_0, at_least_1, refuse, within};
use engine::system::SystemError;
use serde::{Deserialize, Serialize};

/// Settings of the codes, free or encoded.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CodeConfig {
    /// Length of an appearance code.
    pub appearance_dims: usize,
    /// Learning rate of free codes, relative to that of the field's networks.
    pub code_lr: f32,
    /// Factor of the mean square of appearance codes in the loss.
    pub code_size: f32,
}

impl CodeConfig {
    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub fn check(&self) -> Result<(), SystemError> {
        within("appearance_dims", self.appearance_dims, 1..=512)?;
        above_0("code_lr", self.code_lr, MOST)?;
        within("code_size", self.code_size, 0.0..=MOST)
    }
}

/// Settings of the network that encodes a photo.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhotoEncoderConfig {
    /// Longest side of the thumbnail that is encoded, pixels.
    pub encoder_side: usize,
    /// Channels after the first convolution and after each one that halves.
    pub encoder_channels: Vec<usize>,
    /// Learning rate, relative to that of the field's networks.
    pub encoder_lr: f32,
    /// Tilts of the tones that are encoded besides, of each channel; none as published.
    pub encoder_tilts: Vec<f32>,
    /// Least number of lattices in a batch, whose photos are encoded in that step (as published). 0: batches are random
    /// pixels, the field learns with free codes, and the encoder learns to predict them, from a few photos in each step.
    pub lattices: usize,
    /// Pixels along a side of a lattice, spread over at least half a photo.
    pub lattice: usize,
    /// Photos that are encoded in a step, where `lattices` is 0.
    pub encoder_photos: usize,
}

impl PhotoEncoderConfig {
    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub fn check(&self) -> Result<(), SystemError> {
        above_0("encoder_lr", self.encoder_lr, MOST)?;
        within("lattice", self.lattice, 2..=256)?;
        within("lattices", self.lattices, 0..=4096)?;
        within("encoder_photos", self.encoder_photos, 1..=4096)?;
        within("encoder_side", self.encoder_side, 1..=1024)?;
        if self.encoder_channels.len() > 8 || self.encoder_channels.iter().any(|c| !(1..=1024).contains(c)) {
            let value = format!("{:?}", self.encoder_channels);
            return refuse("encoder_channels", value, "must be 1 to 8 numbers in 1..=1024");
        }
        if self.encoder_tilts.len() > 16 || !self.encoder_tilts.iter().all(|t| (-50.0..=50.0).contains(t)) {
            let value = format!("{:?}", self.encoder_tilts);
            return refuse("encoder_tilts", value, "must be at most 16 numbers in -50..=50");
        }
        Ok(())
    }
}

/// Settings of the losses on lattices that are rendered with the code of another photo (see `view_consistency`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ConsistencyConfig {
    /// Weight of the encoder's error on such a render.
    pub view_weight: f32,
    /// Weight of the mode-seeking term: other codes should give other pictures.
    pub mode_weight: f32,
    /// Steps between two of these renders; each weighs this many times as much.
    pub view_every: u64,
}

impl ConsistencyConfig {
    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub fn check(&self) -> Result<(), SystemError> {
        at_least_1("view_every", self.view_every)?;
        within("view_weight", self.view_weight, 0.0..=MOST)?;
        within("mode_weight", self.mode_weight, 0.0..=MOST)
    }

    /// Whether anything is rendered with another code.
    pub(crate) fn weighs(&self) -> bool {
        self.view_weight + self.mode_weight > 0.0
    }

    /// [`ConsistencyConfig::check`] for a field that cannot render a batch with other codes.
    ///
    /// # Errors
    /// [`SystemError::Config`] where such renders are asked for.
    pub fn check_without_second_render(&self) -> Result<(), SystemError> {
        if self.view_weight > 0.0 || self.mode_weight > 0.0 {
            let value = format!("{}, {}", self.view_weight, self.mode_weight);
            return refuse("view_weight, mode_weight", value, "must be 0 with `field = \"mlp\"`");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_that_would_end_a_training_are_refused_before_it() {
        let codes = CodeConfig { appearance_dims: 8, code_lr: 1.0, code_size: 0.0 };
        codes.check().unwrap();
        let encoder = PhotoEncoderConfig {
            encoder_side: 32,
            encoder_channels: vec![4, 8],
            encoder_lr: 1.0,
            encoder_tilts: vec![-50.0, 50.0],
            lattices: 0,
            lattice: 32,
            encoder_photos: 1,
        };
        encoder.check().unwrap();
        let consistency = ConsistencyConfig { view_weight: 1e-3, mode_weight: 0.0, view_every: 1 };
        consistency.check().unwrap();
        assert_eq!(
            consistency.check_without_second_render().unwrap_err().to_string(),
            "`view_weight, mode_weight` = 0.001, 0: must be 0 with `field = \"mlp\"`"
        );
        for (result, want) in [
            (
                CodeConfig { appearance_dims: 513, ..codes.clone() }.check(),
                "`appearance_dims` = 513: must be in 1..=512",
            ),
            (
                CodeConfig { code_lr: f32::NAN, ..codes.clone() }.check(),
                "`code_lr` = NaN: must be above 0 and at most 1000",
            ),
            (CodeConfig { code_size: -1.0, ..codes }.check(), "`code_size` = -1: must be in 0..=1000"),
            (PhotoEncoderConfig { lattice: 1, ..encoder.clone() }.check(), "`lattice` = 1: must be in 2..=256"),
            (
                PhotoEncoderConfig { encoder_channels: vec![4, 0], ..encoder.clone() }.check(),
                "`encoder_channels` = [4, 0]: must be 1 to 8 numbers in 1..=1024",
            ),
            (
                PhotoEncoderConfig { encoder_tilts: vec![50.5], ..encoder }.check(),
                "`encoder_tilts` = [50.5]: must be at most 16 numbers in -50..=50",
            ),
            (ConsistencyConfig { view_every: 0, ..consistency }.check(), "`view_every` = 0: must be at least 1"),
        ] {
            assert_eq!(result.unwrap_err().to_string(), want);
        }
    }
}
