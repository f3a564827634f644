//! How visible the scene is in each pixel, by what costs least.
//!
//! ```text
//! L(v) = (1 - d) r v + l (1 - v)^2         of a pixel with residual r; 1 - d = 0.8 is the weight of the residual, l = 0.15
//! v = 1 - r (1 - d) / (2 l)                where it is least, not below 0: nothing is left from r = 0.375 on
//! ```
//!
//! `l` may fall over training: while there is little to compare with, few pixels should be left out.
//!
//! In the paper `v` is what a head of the network that encodes the photo says, a pixel for each square of four, and learnt with `L`. Here
//! it is what that head would have to say of the residual as it is, averaged over such squares: nothing is to be learnt.
//!
//! # Source
//! Zhang et al., "Gaussian in the Wild", 2024, section 3.4; Xu et al., "Wild-GS", 2024 (a weight that falls).

use super::error_histogram::Errors;
use super::structure_parts::Plane;
use crate::views::{Beside, RenderJudge, first_of, positive, unless};
use engine::system::SystemError;
use serde::{Deserialize, Serialize};

/// Weight of the residual in the loss as published and planned, `1 - dssim`; another `dssim` does not change it.
pub(super) const OF_RESIDUAL: f32 = 0.8;
/// Pixels along the side of a square.
const SQUARE: usize = 4;
/// The scene shows where it is visible to more than this.
pub(super) const SHOWS: f32 = 0.5;

/// Settings of [`VisibilityJudge`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct VisibilitySettings {
    /// Share of the schedule before which all pixels count.
    pub(crate) judge_from: f64,
    /// Weight of what is left out in the loss: the larger, the larger must a residual be for its pixel to count less.
    pub(crate) visibility_weight: f32,
    /// Share of that weight at the end of the schedule, linearly from 1 at its start.
    pub(crate) visibility_left: f32,
}

impl VisibilitySettings {
    /// # Errors
    /// [`SystemError::Config`] naming the first setting that cannot work.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        let left = self.visibility_left;
        first_of([
            unless((0.0..=1.0).contains(&self.judge_from), "judge_from", self.judge_from, "must be a share, 0 to 1"),
            positive("visibility_weight", self.visibility_weight.into()),
            unless(left > 0.0 && left <= 1.0, "visibility_left", left, "must be above 0, and at most 1"),
        ])
    }

    /// The weight of what is left out, at a share of the schedule.
    pub(super) fn weight(&self, share: f64) -> f32 {
        let VisibilitySettings { visibility_weight, visibility_left, .. } = *self;
        visibility_weight * (1.0 - share.clamp(0.0, 1.0) as f32 * (1.0 - visibility_left))
    }
}

/// Has pixels count as visible as the scene is.
pub(crate) struct VisibilityJudge {
    settings: VisibilitySettings,
    /// Steps of the schedule.
    horizon: u64,
}

impl VisibilityJudge {
    /// For a schedule of `horizon` steps.
    pub(crate) fn new(settings: VisibilitySettings, horizon: u64) -> Self {
        Self { settings, horizon }
    }

    fn visibility(&self, weight: f32, beside: &Beside<'_>) -> Vec<f32> {
        if beside.size.contains(&0) {
            return Vec::new();
        }
        let Errors { size, values } = Errors::of(beside);
        let residual = Plane { size, values }.smaller(SQUARE).interpolated(beside.size);
        residual.values.into_iter().map(|r| visibility(weight, r)).collect()
    }
}

/// Visibility of a pixel with a residual; 0 where that is no number.
fn visibility(weight: f32, residual: f32) -> f32 {
    (1.0 - residual * OF_RESIDUAL / (2.0 * weight)).clamp(0.0, 1.0).max(0.0)
}

impl RenderJudge for VisibilityJudge {
    fn weights(&mut self, step: u64, beside: &Beside<'_>) -> Option<Vec<f32>> {
        let from = self.settings.judge_from * self.horizon as f64;
        let weight = self.settings.weight(step as f64 / self.horizon.max(1) as f64);
        (step as f64 >= from).then(|| self.visibility(weight, beside))
    }

    /// As at the end of the schedule.
    fn static_pixels(&self, beside: &Beside<'_>) -> Vec<f32> {
        self.visibility(self.settings.weight(1.0), beside)
            .into_iter()
            .map(|v| if v > SHOWS { 1.0 } else { 0.0 })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SETTINGS: VisibilitySettings =
        VisibilitySettings { judge_from: 0.2, visibility_weight: 0.15, visibility_left: 1.0 };

    /// The closed form is what costs least, found by trying.
    #[test]
    fn the_closed_form_is_the_best_visibility() {
        let of = |residual: f32| visibility(0.15, residual);
        for residual in [0.0, 0.01, 0.1, 0.2, 0.3, 0.374, 0.376, 0.6, 1.0] {
            let cost = |v: f64| 0.8 * f64::from(residual) * v + 0.15 * (1.0 - v).powi(2);
            let tried = (0..=10_000).map(|i| f64::from(i) * 1e-4);
            let best = tried.min_by(|a, b| cost(*a).total_cmp(&cost(*b))).unwrap();
            assert!((f64::from(of(residual)) - best).abs() < 2e-4, "{residual}: {best}");
        }
        assert!((of(0.1875) - 0.5).abs() < 1e-6);
        assert_eq!([of(f32::NAN), of(f32::INFINITY)], [0.0, 0.0]);
    }

    #[test]
    fn the_weight_falls_linearly_and_pixels_count_less_for_the_same_residual() {
        let settings = VisibilitySettings { judge_from: 0.0, visibility_weight: 0.4, visibility_left: 0.25 };
        let mut judge = VisibilityJudge::new(settings, 100);
        let close = |share: f64, want: f32| (judge.settings.weight(share) - want).abs() < 1e-6;
        assert!(close(0.0, 0.4) && close(0.5, 0.25) && close(1.0, 0.1) && close(7.0, 0.1));
        // Everything is off by 0.125.
        let (render, photo) = (vec![0.5; 3 * 64], vec![0.625; 3 * 64]);
        let beside = Beside { view: 0, size: [8, 8], render: &render, photo: &photo, before: None };
        for (step, want) in [(0, 0.875), (50, 0.8), (100, 0.5)] {
            let weights = judge.weights(step, &beside).unwrap();
            assert!(weights.iter().all(|w| (w - want).abs() < 1e-5), "{step}: {}", weights[0]);
        }
        let at_start = VisibilityJudge::new(settings, 0).weights(0, &beside).unwrap();
        assert!((at_start[0] - 0.875).abs() < 1e-5);
    }

    #[test]
    fn what_stands_before_the_scene_does_not_count_and_the_rest_does() {
        let size = [32, 24];
        let render = vec![0.5; 3 * 32 * 24];
        let mut photo = render.clone();
        for i in (0..photo.len()).filter(|i| (8..16).contains(&(i % 32)) && (8..16).contains(&(i / 32 % 24))) {
            photo[i] = 0.0;
        }
        let mut judge = VisibilityJudge::new(SETTINGS, 100);
        let beside = Beside { view: 0, size, render: &render, photo: &photo, before: None };
        assert!(judge.weights(19, &beside).is_none());
        let weights = judge.weights(20, &beside).unwrap();
        assert_eq!((weights[12 * 32 + 12], weights[2 * 32 + 2], weights[20 * 32 + 28]), (0.0, 1.0, 1.0));
        let counts = judge.static_pixels(&beside);
        let left_out = counts.iter().filter(|c| **c == 0.0).count();
        assert!((40..100).contains(&left_out), "{left_out}");
    }

    #[test]
    fn nothing_is_judged_of_nothing_and_what_cannot_work_is_refused() {
        let judge = VisibilityJudge::new(SETTINGS, 0);
        assert!(
            judge.static_pixels(&Beside { view: 0, size: [0, 4], render: &[], photo: &[], before: None }).is_empty()
        );
        let (nan, one) = (vec![f32::NAN; 3 * 16], vec![1.0; 3 * 16]);
        let counts = judge.static_pixels(&Beside { view: 0, size: [4, 4], render: &nan, photo: &one, before: None });
        assert!(counts.iter().all(|c| *c == 0.0));
        assert!(SETTINGS.check().is_ok());
        for bad in [
            VisibilitySettings { judge_from: -0.1, ..SETTINGS },
            VisibilitySettings { visibility_weight: 0.0, ..SETTINGS },
            VisibilitySettings { visibility_left: 0.0, ..SETTINGS },
            VisibilitySettings { visibility_left: 1.1, ..SETTINGS },
        ] {
            assert!(bad.check().is_err(), "{bad:?}");
        }
    }
}
