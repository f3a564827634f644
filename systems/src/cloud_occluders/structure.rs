//! What has not the structure of its photo is left out of a step.
//!
//! ```text
//! r = 1 - likeness, 0 to 1                 of photo and render, pixel by pixel
//! L = r / (2 s^2) + l ln s                 the uncertainty s of a pixel costs this (WildGaussians, equation 10), l = 1/2
//! s^2 = r / l                              where it is least
//! M = 1 where 1 / (2 s^2) > 1, else 0      the pixels that count (equation 11): those with r < l / 2 = 1/4
//! ```
//!
//! In the paper `s` is what a linear layer says of features of the photo (DINOv2), and learnt with `L`. Without these features each
//! pixel has the best `s` of its own, which is known in closed form: nothing is to be learnt. The residual is that of multi-scale
//! structural similarity (the paper's table 4).
//!
//! # Source
//! Kulhanek et al., "WildGaussians: 3D Gaussian Splatting in the Wild", 2024, section 3.3.

use super::structure_parts::{Plane, likeness};
use crate::views::{Beside, RenderJudge, first_of, unless};
use engine::system::SystemError;
use serde::{Deserialize, Serialize};

/// Pictures are compared at this longest side at most, pixels.
const LONGEST: usize = 400;
const CHANNELS: usize = 3;

/// Settings of [`StructureJudge`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct StructureSettings {
    /// Share of the schedule before which all pixels count.
    pub(crate) judge_from: f64,
    /// Share of the schedule over which those that do not show the scene come to count nothing.
    pub(crate) judge_warmup: f64,
    /// Weight of `ln s` in what an uncertainty `s` costs: pixels with a residual of half of it or more count nothing.
    pub(crate) uncertainty_weight: f32,
}

impl StructureSettings {
    /// # Errors
    /// [`SystemError::Config`] naming the first setting that cannot work.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        let weight = self.uncertainty_weight;
        first_of([
            unless((0.0..=1.0).contains(&self.judge_from), "judge_from", self.judge_from, "must be a share, 0 to 1"),
            unless(
                (0.0..=1.0).contains(&self.judge_warmup),
                "judge_warmup",
                self.judge_warmup,
                "must be a share, 0 to 1",
            ),
            unless(weight > 0.0 && weight <= 2.0, "uncertainty_weight", weight, "must be above 0, and at most 2"),
        ])
    }
}

/// Leaves out what has not the structure of its photo.
pub(crate) struct StructureJudge {
    settings: StructureSettings,
    /// Steps of the schedule.
    horizon: u64,
}

impl StructureJudge {
    /// For a schedule of `horizon` steps.
    pub(crate) fn new(settings: StructureSettings, horizon: u64) -> Self {
        Self { settings, horizon }
    }

    /// How much what does not show the scene is left out in a step: from 0 to 1.
    fn share(&self, step: u64) -> f32 {
        let at = step as f64 / self.horizon.max(1) as f64 - self.settings.judge_from;
        match at {
            at if at < 0.0 => 0.0,
            at => (at / self.settings.judge_warmup.max(f64::MIN_POSITIVE)).min(1.0) as f32,
        }
    }
}

/// The channels of a picture, smaller where it is large.
fn channels(size: [usize; 2], planes: &[f32]) -> Vec<Plane> {
    let side = size[0].max(size[1]).div_ceil(LONGEST).max(1);
    let pixels = (size[0] * size[1]).max(1);
    let plane = |values: &[f32]| Plane { size, values: values.to_vec() };
    planes.chunks_exact(pixels).take(CHANNELS).map(|values| plane(values).smaller(side)).collect()
}

impl RenderJudge for StructureJudge {
    fn weights(&mut self, step: u64, beside: &Beside<'_>) -> Option<Vec<f32>> {
        let share = self.share(step);
        let faded = |counts: f32| 1.0 + share * (counts - 1.0);
        (share > 0.0).then(|| self.static_pixels(beside).into_iter().map(faded).collect())
    }

    fn static_pixels(&self, beside: &Beside<'_>) -> Vec<f32> {
        if beside.size.contains(&0) {
            return Vec::new();
        }
        let [render, photo] = [beside.render, beside.photo].map(|planes| channels(beside.size, planes));
        let weight = self.settings.uncertainty_weight;
        let likeness = likeness(&render, &photo).interpolated(beside.size);
        likeness.values.iter().map(|alike| if is_certain(1.0 - alike, weight) { 1.0 } else { 0.0 }).collect()
    }
}

/// Whether the uncertainty `s` that costs least, `r / (2 s^2) + weight ln s` with `s^2 = r / weight`, gives a pixel of residual `r` more
/// than its full weight: `1 / (2 s^2) > 1`.
fn is_certain(residual: f32, weight: f32) -> bool {
    residual < 0.5 * weight
}

#[cfg(test)]
mod tests {
    use super::*;

    const SETTINGS: StructureSettings =
        StructureSettings { judge_from: 0.2, judge_warmup: 0.2, uncertainty_weight: 0.5 };

    /// A picture of waves, and the same with a square of other waves.
    fn pictures(size: [usize; 2]) -> [Vec<f32>; 2] {
        let wave = |i: usize, length: f32| {
            let (x, y) = (i % size[0], i / size[0]);
            0.5 + 0.4 * ((x as f32 / length).sin() * (y as f32 / (length + 1.0)).cos())
        };
        let inside = |i: usize| (20..40).contains(&(i % size[0])) && (20..40).contains(&(i / size[0]));
        let pixels = size[0] * size[1];
        let all = || (0..3 * pixels).map(|i| i % pixels);
        let plain: Vec<f32> = all().map(|i| wave(i, 3.0)).collect();
        let other = all().map(|i| if inside(i) { 1.0 - wave(i, 5.0) } else { wave(i, 3.0) }).collect();
        [plain, other]
    }

    #[test]
    fn what_is_otherwise_in_a_photo_does_not_count_and_the_rest_does() {
        let size = [64, 60];
        let [render, photo] = pictures(size);
        let judge = StructureJudge::new(SETTINGS, 1000);
        let counts = judge.static_pixels(&Beside { view: 0, size, render: &render, photo: &photo, before: None });
        assert_eq!((counts[30 * 64 + 30], counts[5 * 64 + 5], counts[55 * 64 + 60]), (0.0, 1.0, 1.0));
        let left_out = counts.iter().filter(|c| **c == 0.0).count();
        assert!((300..1100).contains(&left_out), "{left_out}");
    }

    #[test]
    fn pixels_come_to_count_nothing_step_by_step() {
        let size = [64, 60];
        let [render, photo] = pictures(size);
        let mut judge = StructureJudge::new(SETTINGS, 1000);
        let beside = Beside { view: 0, size, render: &render, photo: &photo, before: None };
        assert!(judge.weights(199, &beside).is_none());
        let mut at = |step: u64| judge.weights(step, &beside).unwrap()[30 * 64 + 30];
        assert!((at(300) - 0.5).abs() < 1e-6 && at(400) == 0.0 && at(5000) == 0.0);
    }

    /// The pixels that count are those of the best uncertainty, found by trying.
    #[test]
    fn the_closed_form_is_the_best_uncertainty() {
        for weight in [0.5_f32, 0.3] {
            for residual in [0.01_f32, 0.1, 0.14, 0.16, 0.24, 0.26, 0.4, 1.0] {
                let cost = |s: f64| f64::from(residual) / (2.0 * s * s) + f64::from(weight) * s.ln();
                let best = (1..8000).map(|i| f64::from(i) * 5e-4).min_by(|a, b| cost(*a).total_cmp(&cost(*b))).unwrap();
                assert_eq!(1.0 / (2.0 * best * best) > 1.0, is_certain(residual, weight), "{residual} {best}");
            }
        }
    }

    #[test]
    fn nothing_is_judged_of_nothing_and_what_is_not_finite_does_not_count() {
        let judge = StructureJudge::new(SETTINGS, 0);
        assert!(
            judge.static_pixels(&Beside { view: 0, size: [0, 4], render: &[], photo: &[], before: None }).is_empty()
        );
        let (nan, one) = (vec![f32::NAN; 3 * 16], vec![1.0; 3 * 16]);
        let counts = judge.static_pixels(&Beside { view: 0, size: [4, 4], render: &nan, photo: &one, before: None });
        assert!(counts.iter().all(|c| *c == 0.0));
        assert!(SETTINGS.check().is_ok());
        for bad in [
            StructureSettings { judge_from: 1.5, ..SETTINGS },
            StructureSettings { judge_warmup: f64::NAN, ..SETTINGS },
            StructureSettings { uncertainty_weight: 0.0, ..SETTINGS },
        ] {
            assert!(bad.check().is_err(), "{bad:?}");
        }
    }
}
