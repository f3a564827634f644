//! Settings of two clouds in one picture.

use crate::views::{first_of, not_negative, unless};
use engine::system::SystemError;
use serde::{Deserialize, Serialize};

/// Two clouds in one picture: weights of what it costs, beside the absolute difference, which has 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct LayerSettings {
    /// The cloud in front waits for this share of the schedule: what stands still is learnt first.
    pub(crate) front_from: f64,
    /// For this share of the schedule both clouds learn as in the paper's first stage: the one behind all of the photos, as if nothing moved.
    pub(crate) front_first_stage: f64,
    /// The cloud in front goes with the camera, and has no place in the scene: what stands before single photos.
    pub(crate) front_at_camera: bool,
    /// Each cloud is compared with the photo by itself, by its share, and not what both show together: the front may have any pixel
    /// that the cloud behind is far from, whatever it shows there itself.
    pub(crate) front_apart: bool,
    /// The cloud in front changes how bright the one behind is, as shadows do.
    pub(crate) front_shades: bool,
    /// Learning rate of the masks of Gaussians in front.
    pub(crate) front_mask_lr: f64,
    /// Difference of the structure of the picture.
    pub(crate) front_structure: f64,
    /// Each cloud alone, where a pixel is most likely its own.
    pub(crate) front_each: f64,
    /// Both clouds show the same structure, where a pixel is most likely of the front.
    pub(crate) front_divergence: f64,
    /// Masks that are neither: from the middle of the schedule on.
    pub(crate) front_entropy: f64,
    /// Share of the front: what both could show is of the cloud behind.
    pub(crate) front_sparsity: f64,
    /// The same where the front begins: it grows to the other until the middle of the schedule.
    pub(crate) front_sparsity_start: f64,
    /// What is in front lies behind.
    pub(crate) front_separation: f64,
    /// Depths behind vary where the photo does not.
    pub(crate) front_smoothness: f64,
    /// Brightness other than 1, at the end.
    pub(crate) front_brightness: f64,
    /// The cloud behind, as bright as the front makes it, is not the photo; until the weight of other brightness is larger.
    pub(crate) front_brightness_photo: f64,
    /// Gaussians of both clouds are more than five times as long as they are thin.
    pub(crate) front_anisotropy: f64,
    /// In the second half of the schedule Gaussians in front are dropped that have less than this in every photo: their opacity times
    /// their own share of their masks; 0: none.
    pub(crate) front_prune: f64,
}

/// Where [`LayerSettings::front_sparsity`] is reached.
const SPARSE_FROM: f64 = 0.5;

impl LayerSettings {
    /// What the share of the front costs at a share of the schedule.
    pub(super) fn sparsity(&self, at: f64) -> f64 {
        let before = (SPARSE_FROM - self.front_from).max(f64::EPSILON);
        let grown = ((at - self.front_from) / before).clamp(0.0, 1.0);
        self.front_sparsity_start + grown * (self.front_sparsity - self.front_sparsity_start)
    }

    /// # Errors
    /// [`SystemError::Config`] naming the first setting that cannot work.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        first_of([
            unless(
                (0.0..1.0).contains(&self.front_from),
                "front_from",
                self.front_from,
                "must be a share, 0 to below 1",
            ),
            unless(
                (0.0..=1.0).contains(&self.front_first_stage),
                "front_first_stage",
                self.front_first_stage,
                "must be a share, 0 to 1",
            ),
            not_negative("front_mask_lr", self.front_mask_lr),
            not_negative("front_structure", self.front_structure),
            not_negative("front_each", self.front_each),
            not_negative("front_divergence", self.front_divergence),
            not_negative("front_entropy", self.front_entropy),
            not_negative("front_sparsity", self.front_sparsity),
            not_negative("front_sparsity_start", self.front_sparsity_start),
            not_negative("front_separation", self.front_separation),
            not_negative("front_smoothness", self.front_smoothness),
            not_negative("front_brightness", self.front_brightness),
            not_negative("front_brightness_photo", self.front_brightness_photo),
            not_negative("front_anisotropy", self.front_anisotropy),
            unless(
                (0.0..1.0).contains(&self.front_prune),
                "front_prune",
                self.front_prune,
                "must be an opacity, 0 to below 1",
            ),
        ])
    }
}

#[cfg(test)]
mod tests {
    use crate::cloud_layers::tests::SETTINGS;

    #[test]
    fn the_share_of_the_front_costs_more_until_the_middle() {
        let settings = crate::cloud_layers::LayerSettings {
            front_from: 0.1,
            front_sparsity: 0.2,
            front_sparsity_start: 0.1,
            ..SETTINGS
        };
        for (at, want) in [(0.0, 0.1), (0.1, 0.1), (0.3, 0.15), (0.5, 0.2), (1.0, 0.2)] {
            assert!((settings.sparsity(at) - want).abs() < 1e-12, "{at}");
        }
        // One that begins late has all of it at once.
        let late = crate::cloud_layers::LayerSettings { front_from: 0.7, ..settings };
        assert!((late.sparsity(0.71) - 0.2).abs() < 1e-12);
    }

    #[test]
    fn what_cannot_work_is_refused_by_its_name() {
        use crate::cloud_layers::LayerSettings;
        for (name, settings) in [
            ("front_from", LayerSettings { front_from: 1.0, ..SETTINGS }),
            ("front_first_stage", LayerSettings { front_first_stage: 1.5, ..SETTINGS }),
            ("front_divergence", LayerSettings { front_divergence: -1.0, ..SETTINGS }),
            ("front_brightness_photo", LayerSettings { front_brightness_photo: -1.0, ..SETTINGS }),
            ("front_anisotropy", LayerSettings { front_anisotropy: f64::INFINITY, ..SETTINGS }),
            ("front_sparsity_start", LayerSettings { front_sparsity_start: f64::NAN, ..SETTINGS }),
            ("front_prune", LayerSettings { front_prune: 1.0, ..SETTINGS }),
        ] {
            let error = settings.check().unwrap_err().to_string();
            assert!(error.contains(name), "{name}: {error}");
        }
        assert!(SETTINGS.check().is_ok());
    }
}
