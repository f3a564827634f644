//! Strangers in photos, found by comparing all photos with what the field renders there.
//!
//! The residual of a square is that of means over its neighbourhood: texture that is not learnt yet errs both ways and averages
//! out, a stranger does not. It is measured by what is expected at the place its ray ends ([`Expected`]): gloss and thin things
//! err in all photos that show them. What exceeds a threshold, after the diffusion and the vote of RobustNeRF, is a stranger
//! for certain; what hangs together with him and errs by less is part of him, or of his shadow. What most photos would leave
//! out at one place in space, and what holds features of other photos, is the scene: it stays ([`super::guard`]).

use super::expected::Expected;
use super::guard::{Marked, STRICT, Witness, even_out, scene};
use super::light::Light;
use super::static_maps::StaticMap;
use crate::method::ViewSeen;
use engine::data::Dataset;
use engine::options::Background;
use losses::heuristics::{Extent, close, grow};
use losses::trimmed::TrimmedMask;
use rayon::prelude::*;

/// Squares along a side of the neighbourhood whose mean is judged.
pub(super) const NEIGHBOURHOOD: usize = 3;
/// What hangs together with a stranger belongs to him from this share of the threshold on.
const WEAK: f32 = 0.4;
/// Gaps in a stranger up to so many squares are part of him.
const GAP: usize = 5;

/// Colours this near to those of the backdrop are of it.
const BACKDROP: f32 = 0.03;

/// What is behind the scene in all photos, where that is one colour: pixels of it say nothing about anything else.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Backdrop(Option<[f32; 3]>);

impl Backdrop {
    pub(super) fn new(background: Background) -> Self {
        Self((background != Background::Random).then(|| background.colour()))
    }

    pub(super) fn is(self, rgb: [f32; 3]) -> bool {
        self.0.is_some_and(|colour| (0..3).all(|c| (rgb[c] - colour[c]).abs() < BACKDROP))
    }
}

/// Residuals of the photos of a survey.
#[derive(Default)]
pub(super) struct PhotoJudge {
    expected: Expected,
    photos: Vec<Photo>,
    backdrop: Backdrop,
    light: PhotosLight,
}

/// Whether photos have a light of their own.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum PhotosLight {
    /// One for all.
    #[default]
    Same,
    /// Each its own.
    Each,
}

/// Photos have a light of their own where a method gives them one.
pub(super) fn light_of(light: Option<&Light>) -> PhotosLight {
    light.map_or(PhotosLight::Same, |_| PhotosLight::Each)
}

/// What is static in a photo.
pub(super) struct Judged {
    /// All but what is a stranger for certain.
    pub(super) seed: StaticMap,
    /// Without what hangs together with him.
    pub(super) whole: StaticMap,
}

/// A photo of a survey.
struct Photo {
    extent: Extent,
    stride: usize,
    residuals: Vec<f32>,
    place: Vec<[f32; 3]>,
    witness: Witness,
    colours: Vec<[f32; 3]>,
    /// Which squares show anything but the backdrop.
    evidence: Vec<bool>,
}

/// `|mean(C - Y)|` over a square neighbourhood of each pixel, cut off at the borders.
pub(super) fn mean_residuals(seen: &ViewSeen<'_>, side: usize) -> Vec<f32> {
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

impl PhotoJudge {
    pub(super) fn new(backdrop: Backdrop, light: PhotosLight) -> Self {
        Self { backdrop, light, ..Self::default() }
    }

    /// Take a photo; they come in the order of the views.
    pub(super) fn look(&mut self, data: &Dataset, seen: &ViewSeen<'_>) {
        let residuals = mean_residuals(seen, NEIGHBOURHOOD);
        let alpha: Vec<f32> =
            seen.alpha.iter().zip(seen.truth).map(|(a, rgb)| if self.backdrop.is(*rgb) { 0.0 } else { *a }).collect();
        self.expected.add(&ViewSeen { alpha: &alpha, ..*seen }, &residuals);
        let [width, height] = seen.size;
        let (extent, stride, place) = (Extent { width, height }, seen.stride, seen.place.to_vec());
        let (witness, colours) = (Witness::of(data, seen.view), seen.truth.to_vec());
        let evidence = alpha.iter().map(|a| *a > 0.5).collect();
        self.photos.push(Photo { extent, stride, residuals, place, witness, colours, evidence });
    }

    /// Static squares of all photos of the survey, in the order they came; `threshold` in units of what is expected. Forgets
    /// the photos.
    pub(super) fn judge(&mut self, rule: &TrimmedMask, threshold: f32) -> Vec<Judged> {
        self.expected.settle(rule.quantile);
        let expected = &self.expected;
        let photos: Vec<(Marked, Vec<f32>, Vec<u8>)> = std::mem::take(&mut self.photos)
            .into_par_iter()
            .map(|Photo { extent, stride, mut residuals, place, witness, colours, evidence }| {
                residuals.iter_mut().zip(&place).for_each(|(e, &at)| *e /= expected.at(at));
                let seed = mask_of(rule, threshold, extent, &residuals);
                let marks = grown(extent, &residuals, threshold, &seed).iter().map(|bit| *bit == 0).collect();
                (Marked { witness, extent, stride, marks, colours, evidence }, residuals, seed)
            })
            .collect();
        let (mut marked, kept): (Vec<Marked>, Vec<_>) = photos
            .into_iter()
            .map(|(marked, residuals, seed)| {
                let place = (marked.extent, marked.stride);
                (marked, (place, residuals, seed))
            })
            .unzip();
        if self.light == PhotosLight::Each {
            even_out(&mut marked);
        }
        let scene = scene(marked, STRICT);
        kept.into_par_iter()
            .zip(scene)
            .map(|(((extent, stride), mut residuals, mut seed), scene)| {
                for (i, _) in scene.iter().enumerate().filter(|(_, scene)| **scene) {
                    (residuals[i], seed[i]) = (0.0, 1);
                }
                let bits = grown(extent, &residuals, threshold, &seed);
                let map = |bits: Vec<u8>| StaticMap { width: extent.width, stride, bits };
                Judged { whole: map(bits), seed: map(seed) }
            })
            .collect()
    }
}

/// What is static: all but what is a stranger for certain, what hangs together with him, and gaps in both.
fn grown(extent: Extent, residuals: &[f32], threshold: f32, seed: &[u8]) -> Vec<u8> {
    let fits = "one residual and one mask for each square, and an odd window";
    let (mut mask, mut bits) = (seed.to_vec(), vec![0; seed.len()]);
    grow(extent, residuals, WEAK * threshold, &mut mask).expect(fits);
    close(extent, GAP, &mask, &mut Vec::new(), &mut bits).expect(fits);
    bits
}

/// The mask of a whole picture: whole patches; the last of a row or column reaches over what the one before it covers.
pub(super) fn mask_of(rule: &TrimmedMask, threshold: f32, extent: Extent, residuals: &[f32]) -> Vec<u8> {
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
