//! Which pixels count by their errors: those that most photos' pixels are as near to their renders as, or those that a network says by
//! features of the photo.
//!
//! ```text
//! M = inlier(0.7)                                    without features (RobustFilter): see the histogram of errors
//! M = network(F)                                     with features (SLS-mlp), learnt to lie between inlier(0.5) and inlier(0.9)
//! M~ = 1 with chance a + (1 - a) M, else 0           the pixels of a step; a falls from 1 to 0
//! ```
//!
//! Quantiles are those before the step: a photo is not judged by itself. Released: `a = exp(-0.003 floor((1 + t) / 1.5))` at step `t` of
//! 30 000; here by the same share of the schedule.
//!
//! # Source
//! Sabour et al., "SpotLessSplats: Ignoring Distractors in 3D Gaussian Splatting", 2024, section 4.

use super::error_histogram::{ErrorHistogram, Errors};
use super::feature_network::{Bounds, FeatureNetwork};
use super::photo_features::PhotoFeatures;
use crate::views::{Beside, RenderJudge, first_of, positive, unless};
use engine::system::{SystemError, Tensor, TensorMap};
use field_core::rng::Rng;
use float_core::Simd;
use serde::{Deserialize, Serialize};

/// Streams of random numbers.
const CHANCES: u64 = 0x6368_616e;
const NETWORK: u64 = 0x736c_736d;

/// Settings of masks by errors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ErrorMaskSettings {
    /// Share of the schedule in which the chance that a pixel counts whatever its mask says falls to 1/e.
    pub(crate) chance_fade: f64,
    /// Share of the pixels of the last photos, those nearest to their renders, that show the scene.
    pub(crate) inlier_share: f32,
}

/// Settings of masks by features.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct FeatureMaskSettings {
    /// See [`ErrorMaskSettings`].
    pub(crate) chance_fade: f64,
    /// This share of the pixels, those nearest to their renders, certainly shows the scene.
    pub(crate) inlier_least: f32,
    /// More than this share certainly does not.
    pub(crate) inlier_most: f32,
    /// Learning rate of the network.
    pub(crate) mask_lr: f64,
}

fn share(field: &'static str, value: f32) -> Option<crate::views::Problem> {
    unless((0.0..=1.0).contains(&value), field, value, "must be a share, 0 to 1")
}

fn fade(value: f64) -> Option<crate::views::Problem> {
    unless((0.0..=1.0).contains(&value), "chance_fade", value, "must be a share, 0 to 1")
}

impl ErrorMaskSettings {
    /// # Errors
    /// [`SystemError::Config`] naming the first setting that cannot work.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        first_of([fade(self.chance_fade), share("inlier_share", self.inlier_share)])
    }
}

impl FeatureMaskSettings {
    /// # Errors
    /// [`SystemError::Config`] naming the first setting that cannot work.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        let ordered = self.inlier_least <= self.inlier_most;
        first_of([
            fade(self.chance_fade),
            share("inlier_least", self.inlier_least),
            share("inlier_most", self.inlier_most),
            unless(ordered, "inlier_least", self.inlier_least, "must be at most `inlier_most`"),
            positive("mask_lr", self.mask_lr),
            unless(self.mask_lr <= 1.0, "mask_lr", self.mask_lr, "must be at most 1"),
        ])
    }
}

/// What says which pixels show the scene.
enum Rule {
    Errors(ErrorMaskSettings),
    Features { settings: FeatureMaskSettings, photos: PhotoFeatures, network: Box<FeatureNetwork> },
}

/// Leaves out what is far from its render, or what features say is like that.
pub(crate) struct ErrorJudge {
    rule: Rule,
    /// Steps of the schedule.
    horizon: u64,
    chances: Rng,
    histogram: ErrorHistogram,
    /// Counts of the last picture, which the next step learns.
    seen: Option<Vec<u32>>,
}

impl ErrorJudge {
    fn new(rule: Rule, horizon: u64, seed: u64) -> Self {
        let histogram = ErrorHistogram::default();
        Self { rule, horizon, chances: Rng::new(seed, CHANCES), histogram, seen: None }
    }

    /// By errors alone, for a schedule of `horizon` steps.
    pub(crate) fn of_errors(settings: ErrorMaskSettings, horizon: u64, seed: u64) -> Self {
        Self::new(Rule::Errors(settings), horizon, seed)
    }

    /// By features of the photos.
    pub(crate) fn of_features(settings: FeatureMaskSettings, photos: PhotoFeatures, horizon: u64, seed: u64) -> Self {
        let network = Box::new(FeatureNetwork::new(photos.channels(), Rng::new(seed, NETWORK)));
        Self::new(Rule::Features { settings, photos, network }, horizon, seed)
    }

    /// The chance that a pixel counts whatever its mask says.
    fn chance(&self, step: u64) -> f32 {
        let share = match &self.rule {
            Rule::Errors(settings) => settings.chance_fade,
            Rule::Features { settings, .. } => settings.chance_fade,
        };
        let at = step as f64 / self.horizon.max(1) as f64;
        (-at / share.max(f64::MIN_POSITIVE)).exp() as f32
    }
}

/// 1 for inliers.
fn counts(inlier: bool) -> f32 {
    if inlier { 1.0 } else { 0.0 }
}

impl RenderJudge for ErrorJudge {
    fn weights(&mut self, step: u64, beside: &Beside<'_>) -> Option<Vec<f32>> {
        let errors = Errors::of(beside);
        let counted = ErrorHistogram::counts(&errors, beside.before);
        let chance = self.chance(step);
        let inliers = |share: f32| errors.inliers(self.histogram.quantile(share));
        let mut mask: Vec<f32> = match &mut self.rule {
            Rule::Errors(settings) => inliers(settings.inlier_share).into_iter().map(counts).collect(),
            Rule::Features { settings, photos, network } => {
                let features = photos.of_step(beside.view)?;
                let judged = network.judge(features, beside.size);
                let [least, most] = [settings.inlier_least, settings.inlier_most].map(inliers);
                let bounds = Bounds { least: &least, most: &most, counts: beside.before };
                network.learn(features, &judged, &bounds);
                judged.mask
            }
        };
        self.seen = Some(counted);
        let rng = self.chances.substream(step);
        for (i, m) in mask.iter_mut().enumerate() {
            *m = counts(rng.uniform_at(i as u64) < chance + (1.0 - chance) * *m);
        }
        Some(mask)
    }

    fn static_pixels(&self, beside: &Beside<'_>) -> Vec<f32> {
        match &self.rule {
            Rule::Errors(settings) => {
                let limit = self.histogram.quantile(settings.inlier_share);
                Errors::of(beside).inliers(limit).into_iter().map(counts).collect()
            }
            Rule::Features { photos, network, .. } => match photos.of_photo(beside.view) {
                None => vec![1.0; beside.size[0] * beside.size[1]],
                Some(features) => {
                    network.judge(features, beside.size).mask.into_iter().map(|m| counts(m > 0.5)).collect()
                }
            },
        }
    }

    fn learn(&mut self, simd: Simd) -> usize {
        let Some(seen) = self.seen.take() else { return 0 };
        self.histogram.add(&seen);
        match &mut self.rule {
            Rule::Errors(_) => 0,
            Rule::Features { settings, network, .. } => network.step(simd, settings.mask_lr),
        }
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        let mut out = Vec::new();
        self.histogram.push_state(&mut out);
        if let Rule::Features { network, .. } = &self.rule {
            network.push_state(&mut out);
        }
        out
    }

    fn load(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        let histogram = ErrorHistogram::take(state)?;
        if let Rule::Features { network, .. } = &mut self.rule {
            network.load(state)?;
        }
        self.histogram = histogram;
        self.seen = None;
        Ok(())
    }

    fn parameter_count(&self) -> usize {
        match &self.rule {
            Rule::Errors(_) => 0,
            Rule::Features { network, .. } => network.parameter_count(),
        }
    }

    fn bytes(&self) -> usize {
        match &self.rule {
            Rule::Errors(_) => 0,
            Rule::Features { photos, .. } => photos.bytes() + FeatureNetwork::bytes(photos.pixels()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use scene_io::Features;
    use std::sync::Arc;

    const ERRORS: ErrorMaskSettings = ErrorMaskSettings { chance_fade: 0.1, inlier_share: 0.7 };
    const FEATURES: FeatureMaskSettings =
        FeatureMaskSettings { chance_fade: 0.1, inlier_least: 0.5, inlier_most: 0.9, mask_lr: 1e-2 };
    const SIZE: [usize; 2] = [20, 16];

    /// A photo whose upper left quarter is far from its render, here more and there less, the rest near.
    fn pictures() -> [Vec<f32>; 2] {
        let far = |i: usize| i % SIZE[0] < 10 && (i / SIZE[0]) % SIZE[1] < 8;
        let render = vec![0.5; 3 * 320];
        let farther = |i: usize| 0.7 + 0.002 * ((i % 320) * 37 % 100) as f32;
        let photo = (0..3 * 320).map(|i| if far(i) { farther(i) } else { 0.5 + 1e-4 * (i % 7) as f32 }).collect();
        [render, photo]
    }

    fn judge_of_features() -> ErrorJudge {
        // Of fewer numbers a network with weights as small as the regulariser wants them makes nothing.
        let data = (0..16 * 20).map(|i| if i % 5 < 2 && (i / 5) % 4 < 2 { 2.0 } else { -2.0 }).collect();
        let features = Arc::new(Features { channels: 16, width: 5, height: 4, data });
        ErrorJudge::of_features(FEATURES, PhotoFeatures::of_pinholes(vec![features]), 1000, 3)
    }

    #[test]
    fn what_is_far_from_its_render_comes_to_count_nothing() {
        let [render, photo] = pictures();
        let beside = Beside { view: 0, size: SIZE, render: &render, photo: &photo, before: None };
        let mut judge = ErrorJudge::of_errors(ERRORS, 1000, 3);
        let all = judge.weights(0, &beside).unwrap();
        assert!(all.iter().all(|weight| *weight == 1.0), "at first all count");
        for step in 0..600 {
            judge.weights(step, &beside);
            assert_eq!(judge.learn(Simd::best()), 0);
        }
        let shown = judge.static_pixels(&beside);
        assert_eq!((shown[3 * 20 + 4], shown[12 * 20 + 15]), (0.0, 1.0));
        let left_out = shown.iter().filter(|weight| **weight == 0.0).count();
        assert!((60..=110).contains(&left_out), "{left_out}");
        let step = judge.weights(600, &beside).unwrap();
        assert!(step.iter().all(|weight| *weight == 0.0 || *weight == 1.0));
        let same = step.iter().zip(&shown).filter(|(a, b)| a == b).count();
        assert!(same > 250, "{same}");
    }

    #[test]
    fn a_picture_that_is_not_learnt_changes_nothing_and_a_state_says_all() {
        let [render, photo] = pictures();
        let beside = Beside { view: 0, size: SIZE, render: &render, photo: &photo, before: None };
        for make in [|| ErrorJudge::of_errors(ERRORS, 1000, 3), judge_of_features as fn() -> ErrorJudge] {
            let mut judge = make();
            for step in 0..5 {
                judge.weights(step, &beside);
                judge.learn(Simd::best());
            }
            judge.weights(900, &Beside { photo: &render, ..beside });
            let state: TensorMap = judge.state().into_iter().map(|t| (t.name.clone(), t.into_owned())).collect();
            let mut other = make();
            other.load(&state).unwrap();
            assert_eq!(other.weights(5, &beside), judge.weights(5, &beside));
            judge.learn(Simd::best());
            other.learn(Simd::best());
            assert_eq!(other.state(), judge.state());
            assert!(other.load(&TensorMap::default()).is_err());
        }
    }

    #[test]
    fn settings_that_cannot_work_are_named() {
        assert!(ERRORS.check().is_ok() && FEATURES.check().is_ok());
        let of_errors =
            [ErrorMaskSettings { chance_fade: f64::NAN, ..ERRORS }, ErrorMaskSettings { inlier_share: 1.5, ..ERRORS }];
        assert!(of_errors.iter().all(|settings| settings.check().is_err()));
        for (bad, name) in [
            (FeatureMaskSettings { inlier_least: 0.95, ..FEATURES }, "inlier_least"),
            (FeatureMaskSettings { inlier_most: -0.1, ..FEATURES }, "inlier_most"),
            (FeatureMaskSettings { mask_lr: 0.0, ..FEATURES }, "mask_lr"),
            (FeatureMaskSettings { mask_lr: 2.0, ..FEATURES }, "mask_lr"),
        ] {
            assert!(bad.check().unwrap_err().to_string().contains(name), "{bad:?}");
        }
    }

    #[test]
    fn a_photo_without_pixels_or_unlike_any_render_does_no_harm() {
        for mut judge in [ErrorJudge::of_errors(ERRORS, 0, 3), judge_of_features()] {
            let nothing = Beside { view: 0, size: [0, 4], render: &[], photo: &[], before: None };
            assert!(judge.weights(0, &nothing).is_none_or(|weights| weights.is_empty()));
            judge.learn(Simd::best());
            assert!(judge.static_pixels(&nothing).is_empty());
            let (nan, photo) = (vec![f32::NAN; 3 * 320], vec![1.0; 3 * 320]);
            let beside = Beside { view: 0, size: SIZE, render: &nan, photo: &photo, before: None };
            judge.weights(1, &beside);
            judge.learn(Simd::best());
            assert!(judge.static_pixels(&beside).iter().all(|weight| *weight == 0.0 || *weight == 1.0));
        }
    }
}
