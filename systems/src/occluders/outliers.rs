//! Occluders in photos, found by comparing all photos with the renders of the field.
//!
//! The residual of a square is that of means over its neighbourhood: texture that is not learnt yet errs both ways and averages
//! out, an occluder does not. It is divided by the expected error of the place where its ray ends ([`ExpectedError`]): gloss and
//! thin things err in all photos that show them. Residuals above a threshold, after the diffusion and the vote of trimmed
//! masks, are certainly an occluder; squares connected to it with smaller residuals belong to it or to its shadow. What most
//! photos would leave out at one place in space, and what holds features of other photos, is the scene: it stays
//! ([`super::scene_guard`]).

use super::expected_error::ExpectedError;
use super::scene_guard::{Marked, PhotoGeometry, STRICT, even_out, marks_of_the_scene};
use crate::limits::{positive, refuse, within};
use crate::photo_model::PhotoAndRender;
use crate::static_maps::{StaticMap, StaticMaps};
use engine::data::Dataset;
use engine::options::Background;
use engine::system::SystemError;
use losses::heuristics::{Extent, close, grow};
use losses::trimmed::TrimmedMask;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Settings of masks that are found from residuals.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OutlierConfig {
    /// Whole photos: the residual of an occluder, in units of the expected error at the same place.
    pub judge_scale: f32,
    /// Share of the rays (whole photos: at the same place) whose residuals the threshold is made of.
    pub trim_quantile: f32,
    /// Share of inliers around a ray that makes it an inlier.
    pub trim_diffuse: f32,
    /// Share of inliers in a patch that makes its inner block inliers.
    pub trim_vote: f32,
    /// Pixels (whole photos: squares) along a side of a patch.
    pub patch: usize,
    /// Pixels (whole photos: squares) along a side of the inner block of a patch.
    pub patch_inner: usize,
}

/// Photos below this longest side are judged by patches of half the size.
pub(crate) const SMALL_PHOTO: u32 = 320;

impl OutlierConfig {
    /// Trimming as published (Sabour et al., "RobustNeRF", 2023, section 4.2): the median, a vote of half the 3x3 neighbours, and of 0.6 of
    /// a 16x16 patch on its 8x8 inner block. Of photos of a small `longest` side patches are half as large.
    #[must_use]
    pub(crate) fn of_photos(longest: u32) -> Self {
        let share = if longest < SMALL_PHOTO { 2 } else { 1 };
        Self {
            judge_scale: 4.0,
            trim_quantile: 0.5,
            trim_diffuse: 0.5,
            trim_vote: 0.6,
            patch: 16 / share,
            patch_inner: 8 / share,
        }
    }

    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub fn check(&self) -> Result<(), SystemError> {
        positive("judge_scale", self.judge_scale)?;
        if let Err(e) = self.trimming().check() {
            let Self { trim_quantile, trim_diffuse, trim_vote, patch, patch_inner, .. } = self;
            let value = format!("{trim_quantile}, {trim_diffuse}, {trim_vote}, {patch}, {patch_inner}");
            return refuse("trim_quantile, trim_diffuse, trim_vote, patch, patch_inner", value, e.to_string());
        }
        within("patch", self.patch, 2..=256)
    }

    /// How residuals become masks.
    #[must_use]
    pub fn trimming(&self) -> TrimmedMask {
        TrimmedMask::default()
            .with_quantile(self.trim_quantile)
            .with_diffuse(self.trim_diffuse)
            .with_vote(self.trim_vote)
            .with_patch(self.patch)
            .with_inner(self.patch_inner)
    }
}

/// Squares along a side of the neighbourhood whose mean residual counts.
pub(crate) const NEIGHBOURHOOD: usize = 3;
/// Gaps in an occluder of up to this many squares are part of it.
const GAP: usize = 5;

/// Largest difference of a channel from the backdrop's colour.
const BACKDROP: f32 = 0.03;

/// The colour behind the scene in all photos, where it is one: pixels of it are not evidence.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Backdrop(Option<[f32; 3]>);

impl Backdrop {
    pub(crate) fn new(background: Background) -> Self {
        Self((background != Background::Random).then(|| background.colour()))
    }

    pub(crate) fn is(self, rgb: [f32; 3]) -> bool {
        self.0.is_some_and(|colour| (0..3).all(|c| (rgb[c] - colour[c]).abs() < BACKDROP))
    }
}

/// Residuals of the photos of a survey.
#[derive(Default)]
pub(crate) struct PhotoOutliers {
    expected: ExpectedError,
    photos: Vec<SurveyedPhoto>,
    backdrop: Backdrop,
    brightness: Brightness,
    expecting: Expecting,
}

/// Which squares of the photos say what error is expected.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Expecting {
    /// All.
    #[default]
    All,
    /// Those that the masks of the last survey left: where occluders hide a place in most photos, the expected error is not theirs.
    Unmasked,
}

impl Expecting {
    /// Hysteresis: squares connected to a detected occluder join it above this share of the threshold. What is expected is less without
    /// occluders, so more of it is needed (docs/decisions/0062).
    fn weak(self) -> f32 {
        match self {
            Self::All => 0.4,
            Self::Unmasked => 0.6,
        }
    }
}

/// Whether photos differ in brightness and tint.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Brightness {
    /// One for all.
    #[default]
    Same,
    /// Each its own: there is an appearance model.
    Each,
}

/// What is static in a photo.
pub(crate) struct StaticParts {
    /// All but what is certainly an occluder.
    pub(crate) seed: StaticMap,
    /// Without what is connected to it.
    pub(crate) whole: StaticMap,
}

/// A photo of a survey.
struct SurveyedPhoto {
    extent: Extent,
    stride: usize,
    residuals: Vec<f32>,
    place: Vec<[f32; 3]>,
    geometry: PhotoGeometry,
    colours: Vec<[f32; 3]>,
    /// Which squares show anything but the backdrop.
    evidence: Vec<bool>,
}

/// `|mean(C - Y)|` over a square neighbourhood of each pixel, cut off at the borders.
pub(crate) fn mean_residuals(seen: &PhotoAndRender<'_>, side: usize) -> Vec<f32> {
    let [width, height] = seen.size;
    // Sums over all pixels above and to the left.
    let mut sums = vec![[0.0_f64; 3]; (width + 1) * (height + 1)];
    for y in 0..height {
        let mut row = [0.0; 3];
        for x in 0..width {
            let (i, at) = (y * width + x, (y + 1) * (width + 1) + x + 1);
            for c in 0..3 {
                row[c] += f64::from(seen.pixels[i].rgb[c] - seen.truth[i][c]);
                sums[at][c] = sums[at - width - 1][c] + row[c];
            }
        }
    }
    let reach = side / 2;
    (0..width * height)
        .map(|i| {
            let (x, y) = (i % width, i / width);
            let (x0, x1) = (x.saturating_sub(reach), (x + reach + 1).min(width));
            let (y0, y1) = (y.saturating_sub(reach), (y + reach + 1).min(height));
            let at = |x: usize, y: usize, c: usize| sums[y * (width + 1) + x][c];
            let count = ((x1 - x0) * (y1 - y0)) as f64;
            let mean = |c| (at(x1, y1, c) - at(x0, y1, c) - at(x1, y0, c) + at(x0, y0, c)) / count;
            (0..3).map(|c| mean(c).powi(2)).sum::<f64>().sqrt() as f32
        })
        .collect()
}

impl PhotoOutliers {
    pub(crate) fn new(backdrop: Backdrop, brightness: Brightness, expecting: Expecting) -> Self {
        Self { backdrop, brightness, expecting, ..Self::default() }
    }

    /// Add a photo; they come in the order of the views. `known` are the masks of the last survey.
    pub(crate) fn add(&mut self, data: &Dataset, seen: &PhotoAndRender<'_>, known: &StaticMaps) {
        let residuals = mean_residuals(seen, NEIGHBOURHOOD);
        let alpha: Vec<f32> =
            seen.alpha.iter().zip(seen.truth).map(|(a, rgb)| if self.backdrop.is(*rgb) { 0.0 } else { *a }).collect();
        let [width, height] = seen.size;
        let known = known.of(seen.view).filter(|_| self.expecting == Expecting::Unmasked);
        let counts = known.map(|map| map.in_squares(seen.stride, Extent { width, height }));
        let counted = counts.map(|counts| alpha.iter().zip(counts).map(|(a, bit)| a * f32::from(bit)).collect());
        let counted: &Vec<f32> = counted.as_ref().unwrap_or(&alpha);
        self.expected.add(&PhotoAndRender { alpha: counted, ..*seen }, &residuals);
        let (extent, stride, place) = (Extent { width, height }, seen.stride, seen.place.to_vec());
        let (geometry, colours) = (PhotoGeometry::of(data, seen.view), seen.truth.to_vec());
        let evidence = alpha.iter().map(|a| *a > 0.5).collect();
        self.photos.push(SurveyedPhoto { extent, stride, residuals, place, geometry, colours, evidence });
    }

    /// Static squares of all photos of the survey, in the order they came; `threshold` in units of the expected error. Forgets
    /// the photos.
    pub(crate) fn static_parts(&mut self, rule: &TrimmedMask, threshold: f32) -> Vec<StaticParts> {
        self.expected.settle(rule.quantile);
        let (expected, weak) = (&self.expected, self.expecting.weak() * threshold);
        let photos: Vec<(Marked, Vec<f32>, Vec<u8>)> = std::mem::take(&mut self.photos)
            .into_par_iter()
            .map(|SurveyedPhoto { extent, stride, mut residuals, place, geometry, colours, evidence }| {
                residuals.iter_mut().zip(&place).for_each(|(e, &at)| *e /= expected.at(at));
                let seed = mask_of(rule, threshold, extent, &residuals);
                let marks = grown(extent, &residuals, weak, &seed).iter().map(|bit| *bit == 0).collect();
                (Marked { geometry, extent, stride, marks, colours, evidence }, residuals, seed)
            })
            .collect();
        let (mut marked, kept): (Vec<Marked>, Vec<_>) = photos
            .into_iter()
            .map(|(marked, residuals, seed)| {
                let place = (marked.extent, marked.stride);
                (marked, (place, residuals, seed))
            })
            .unzip();
        if self.brightness == Brightness::Each {
            even_out(&mut marked);
        }
        let scene = marks_of_the_scene(marked, STRICT);
        kept.into_par_iter()
            .zip(scene)
            .map(|(((extent, stride), mut residuals, mut seed), scene)| {
                for (i, _) in scene.iter().enumerate().filter(|(_, scene)| **scene) {
                    (residuals[i], seed[i]) = (0.0, 1);
                }
                let bits = grown(extent, &residuals, weak, &seed);
                let map = |bits: Vec<u8>| StaticMap { width: extent.width, stride, bits };
                StaticParts { whole: map(bits), seed: map(seed) }
            })
            .collect()
    }
}

/// What is static: all but what is certainly an occluder, what is connected to it by residuals above `weak`, and gaps in both.
fn grown(extent: Extent, residuals: &[f32], weak: f32, seed: &[u8]) -> Vec<u8> {
    let fits = "one residual and one mask for each square, and an odd window";
    let (mut mask, mut bits) = (seed.to_vec(), vec![0; seed.len()]);
    grow(extent, residuals, weak, &mut mask).expect(fits);
    close(extent, GAP, &mask, &mut Vec::new(), &mut bits).expect(fits);
    bits
}

/// The mask of a whole picture: whole patches; the last of a row or column reaches over what the one before it covers.
pub(crate) fn mask_of(rule: &TrimmedMask, threshold: f32, extent: Extent, residuals: &[f32]) -> Vec<u8> {
    let (Extent { width, height }, side) = (extent, rule.patch);
    let mut out = vec![1; width * height];
    let starts = |size: usize| (0..size.div_ceil(side)).map(move |k| (k * side).min(size.saturating_sub(side)));
    let (mut scratch, mut weights, mut patch) = (Vec::new(), vec![0.0; side * side], vec![0.0; side * side]);
    for y in starts(height) {
        for x in starts(width) {
            let at = |k: usize| (y + k / side).min(height - 1) * width + (x + k % side).min(width - 1);
            patch.iter_mut().enumerate().for_each(|(k, e)| *e = residuals[at(k)]);
            let fits = "a patch is whole, and the settings are checked before";
            rule.weights(&patch, threshold, &mut scratch, &mut weights).expect(fits);
            (0..side * side).for_each(|k| out[at(k)] = u8::from(weights[k] > 0.0));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::photo_model::Pixel;
    use crate::plan::made;

    #[test]
    fn settings_that_would_end_a_training_are_refused_before_it() {
        let good = OutlierConfig {
            judge_scale: 4.0,
            trim_quantile: 0.5,
            trim_diffuse: 0.5,
            trim_vote: 0.6,
            patch: 16,
            patch_inner: 8,
        };
        good.check().unwrap();
        for (settings, want) in [
            (OutlierConfig { trim_quantile: 7.0, ..good.clone() }, "`quantile`"),
            (OutlierConfig { trim_vote: -1.0, ..good.clone() }, "`vote`"),
            (OutlierConfig { trim_diffuse: f32::NAN, ..good.clone() }, "`diffuse`"),
            (OutlierConfig { patch_inner: 99, ..good.clone() }, "`inner`"),
            (OutlierConfig { judge_scale: 0.0, ..good.clone() }, "`judge_scale` = 0: must be positive and finite"),
            (OutlierConfig { patch: 257, ..good }, "257"),
        ] {
            let error = settings.check().unwrap_err().to_string();
            assert!(error.contains(want), "{want}: {error}");
        }
    }

    #[test]
    fn what_is_expected_of_a_place_is_not_the_error_of_occluders_that_are_masked() {
        let side = made::SIDE as usize;
        let (_, data) = made::scene(made::frames(4, |_, _, _| [0, 0, 0, 255]), Vec::new());
        // Three quarters of each photo hide one place, which is rendered well where it is seen.
        let is_hidden = |i: usize| i / side < 3 * side / 4;
        let error = |i: usize| Pixel { rgb: [if is_hidden(i) { 0.8 } else { 0.1 }; 3], ..Pixel::default() };
        let pixels: Vec<Pixel> = (0..side * side).map(error).collect();
        let map =
            StaticMap { width: side, stride: 1, bits: (0..side * side).map(|i| u8::from(!is_hidden(i))).collect() };
        let (truth, alpha, place) = (vec![[0.0; 3]; side * side], vec![1.0; side * side], vec![[0.3; 3]; side * side]);
        let expected = |expecting: Expecting, known: &StaticMaps| {
            let mut judge = PhotoOutliers::new(Backdrop::default(), Brightness::Same, expecting);
            for view in 0..4 {
                let (size, stride) = ([side; 2], 1);
                let seen =
                    PhotoAndRender { view, size, stride, pixels: &pixels, truth: &truth, alpha: &alpha, place: &place };
                judge.add(&data, &seen, known);
            }
            judge.expected.settle(0.5);
            judge.expected.at([0.3; 3])
        };
        let (none, mut known) = (StaticMaps::default(), StaticMaps::default());
        known.set_all(vec![map; 4]);
        let [hidden, seen] = [error(0), error(side * side - 1)].map(|p| p.rgb[0] * 3.0_f32.sqrt());
        for (expecting, known, want) in [
            (Expecting::All, &none, hidden),
            (Expecting::All, &known, hidden),
            (Expecting::Unmasked, &none, hidden),
            (Expecting::Unmasked, &known, seen),
        ] {
            let got = expected(expecting, known);
            assert!((got - want).abs() < 0.05, "{expecting:?}: {got}, not {want}");
        }
    }
}
