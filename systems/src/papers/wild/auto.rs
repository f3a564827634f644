//! What do these photos need? A short training of the plain field, then a comparison of every photo with its render.
//!
//! * Appearance: where photos are brighter, darker or of another tint than their renders as a whole.
//! * Occluders: squares of a photo whose mean is far from the render's once its brightness and tint are taken out, except for
//!   those that show the scene, which the field does not know well enough yet ([`crate::occluders::scene_guard`]).
//!
//! Pixels of a backdrop of one colour are not evidence of either.
//!
//! Where the scene itself is far from the field, or where photos of different appearance are, the field is not good enough yet:
//! it is trained for longer, with a code for each photo where appearance differs, and compared again before anything is called
//! an occluder.

use super::choice::{AppearanceKind, OccluderKind};
use super::nerf_w::{HASH_GRID_CODES, with_codes};
use crate::claims::Claim;
use crate::occluders::outliers::{Backdrop, NEIGHBOURHOOD, mean_residuals};
use crate::occluders::scene_guard::{DARK, LEAST_PHOTOS, LOOSE, Marked, PhotoGeometry, marks_of_the_scene};
use crate::occluders::survey::survey_stride;
use crate::photo_model::{PhotoAndRender, Pixel};
use crate::plan::{Ground, field_settings};
use crate::rays::{RayConfig, RaySystem};
use crate::survey::Surveys;
use engine::data::Dataset;
use engine::options::RunOptions;
use engine::system::{System, SystemError};
use losses::heuristics::Extent;
use std::ops::Range;

/// What it is.
pub(crate) const CLAIM: Claim = Claim {
    name: "auto",
    paper: "",
    what: "Whichever parts the photos need, found by a short training",
    take: "always, unless you know what your photos need",
    differs: "Appearance and occluders are chosen after a short training that is compared with the photos.",
    mark: "",
};

/// Steps of the short training, and of the second one.
const STEPS: u64 = 80;
const MORE_STEPS: u64 = 160;
/// Standard deviation of the photos' gains above which each photo has a code.
const GAIN_DEVIATION: f64 = 0.045;
/// Difference of a square's mean from the render above which it is marked, colour units.
const FAR: f32 = 0.2;
/// Share of marked squares above which there are occluders.
const SHARE: f64 = 0.05;
/// That share at the second comparison, which errs less.
const SECOND_SHARE: f64 = 0.01;
/// With fewer photos only three or four show a place: too few for a robust loss to tell in which of them an occluder hides it. A
/// transient part of each photo takes its place.
pub(crate) const FEW_PHOTOS: usize = 16;
/// Largest ratio of marks of the scene to other marks with which there are occluders; larger for few photos, as a transient part
/// leaves nothing out for good.
const SCENE: f64 = 1.0;
const SCENE_OF_FEW: f64 = 2.0;

/// Appearance and occluders of the photos, each with a line of reason.
pub(crate) fn needs(
    ground: &mut Ground,
    data: &Dataset,
    run: &RunOptions,
) -> Result<(AppearanceKind, OccluderKind), SystemError> {
    if data.len() < 2 {
        ground.lines.push("appearance and occluders: not sought (there is one photo)".into());
        return Ok((AppearanceKind::None, OccluderKind::None));
    }
    let lines = ground.lines.len();
    let config = blind_to_directions(field_settings(ground, data));
    let mut field = ground.ngp(data, &config, run.seed, None)?;
    // The field that stays has lines of its own.
    ground.lines.truncate(lines);
    let backdrop = Backdrop::new(ground.background);
    train(&mut field, data, 0..STEPS)?;
    let first = Found::of(&field, data, backdrop, None)?;
    let differ = differs(first.deviation);
    let again = first.scene > SHARE || (differ && first.far > SHARE);
    let known = differ.then_some(&first.gains[..]);
    let (found, limit, steps) = if again && data.len() >= LEAST_PHOTOS {
        if differ {
            field = ground.ngp(
                data,
                &config,
                run.seed,
                Some(Box::new(with_codes(HASH_GRID_CODES.appearance_dims, data, run.seed))),
            )?;
            ground.lines.truncate(lines);
            train(&mut field, data, 0..MORE_STEPS)?;
        } else {
            train(&mut field, data, STEPS..STEPS + MORE_STEPS)?;
        }
        (Found::of(&field, data, backdrop, known)?, SECOND_SHARE, if differ { MORE_STEPS } else { STEPS + MORE_STEPS })
    } else {
        (first.clone(), SHARE, STEPS)
    };
    let appearance = if differ { AppearanceKind::Codes } else { AppearanceKind::None };
    ground.lines.push(appearance_line(first.deviation, ""));
    if data.len() < LEAST_PHOTOS {
        ground.lines.push(format!("occluders: not sought ({} photos are too few)", data.len()));
        return Ok((appearance, OccluderKind::None));
    }
    let (scene, kind, word) = if data.len() < FEW_PHOTOS {
        (SCENE_OF_FEW, OccluderKind::Transient, "a transient part of each photo, as there are few")
    } else {
        (SCENE, OccluderKind::Robust, "left out")
    };
    let (occluders, word) = if found.has_occluders(limit, scene) { (kind, word) } else { (OccluderKind::None, "none") };
    ground.lines.push(format!(
        "occluders: {word} (after {steps} steps {:.1} % of the photos' squares are more than {FAR} away from the field in one \
         photo, limit {:.1} %; {:.1} % are in most photos that show the place: that is the scene)",
        100.0 * found.far,
        100.0 * limit,
        100.0 * found.scene
    ));
    Ok((appearance, occluders))
}

/// Appearance alone, with its line of reason, of photos that each show a time of their own; `config` are the settings of the field
/// of the scene. A plain field knows no time, and what moves is not where it shows it: only what both halves of a photo have in common
/// is taken for its appearance.
///
/// # Errors
/// As a training has them.
pub(crate) fn appearance_of_times(
    ground: &Ground,
    data: &Dataset,
    config: &RayConfig,
    seed: u64,
) -> Result<(AppearanceKind, String), SystemError> {
    if data.len() < 2 {
        return Ok((AppearanceKind::None, "appearance: not sought (there is one photo)".into()));
    }
    let mut field = ground.plain(data, &blind_to_directions(config.clone()), seed)?;
    train(&mut field, data, 0..STEPS)?;
    let (stride, backdrop) = (survey_stride(data), Backdrop::new(ground.background));
    let mut gains = Vec::with_capacity(data.len());
    for view in 0..data.len() {
        let rendered = field.render_training_view(data, view, stride)?;
        let seen = rendered.beside_photo(view);
        gains.push(gains_of_halves(&seen, &evidence(&seen, backdrop)));
    }
    let deviation = common_deviation(&gains);
    let kind = if differs(deviation) { AppearanceKind::Codes } else { AppearanceKind::None };
    Ok((kind, appearance_line(deviation, ", alike in both halves")))
}

/// Whether photos differ enough for codes of their own.
fn differs(deviation: f64) -> bool {
    deviation > GAIN_DEVIATION
}

fn appearance_line(deviation: f64, also: &str) -> String {
    let word = if differs(deviation) { "a code for each photo" } else { "one for all" };
    format!(
        "appearance: {word} (after {STEPS} plain steps photos differ from the field by {:.1} % in brightness or tint{also}, limit \
         {:.1} %)",
        100.0 * deviation,
        100.0 * GAIN_DEVIATION
    )
}

/// Colours that depend on the direction would explain the appearance of each photo.
fn blind_to_directions(mut config: RayConfig) -> RayConfig {
    config.networks.sh_degree = 1;
    config
}

fn train(field: &mut RaySystem, data: &Dataset, steps: Range<u64>) -> Result<(), SystemError> {
    for step in steps {
        field.step(data, step)?;
    }
    Ok(())
}

/// The comparison of all photos with their renders.
#[derive(Clone, Debug)]
struct Found {
    /// The [`gain`] of each photo.
    gains: Vec<[f32; 3]>,
    /// Standard deviation of the gains.
    deviation: f64,
    /// Share of the squares that are far from the field and do not show the scene.
    far: f64,
    /// Share of the squares that are far from the field and show the scene.
    scene: f64,
}

impl Found {
    /// `known`: the gain of each photo, where the field has codes and renders each photo with its own.
    fn of(
        field: &dyn Surveys,
        data: &Dataset,
        backdrop: Backdrop,
        known: Option<&[[f32; 3]]>,
    ) -> Result<Self, SystemError> {
        let stride = survey_stride(data);
        let (mut gains, mut marked) = (Vec::with_capacity(data.len()), Vec::with_capacity(data.len()));
        let (mut all, mut squares) = (0, 0);
        for view in 0..data.len() {
            let rendered = field.render_training_view(data, view, stride)?;
            let seen = rendered.beside_photo(view);
            let alpha = evidence(&seen, backdrop);
            let seen = PhotoAndRender { alpha: &alpha, ..seen };
            let gain = gain(&seen);
            let marks = far_squares(&seen, gain);
            all += marks.iter().filter(|mark| **mark).count();
            squares += alpha.iter().filter(|a| **a > 0.5).count();
            let [width, height] = seen.size;
            // Of one brightness for all.
            let gain_of_view = known.map_or(gain, |known| known[view]);
            let evened = |rgb: &[f32; 3]| [0, 1, 2].map(|c| (rgb[c] + DARK) / gain_of_view[c].exp() - DARK);
            marked.push(Marked {
                geometry: PhotoGeometry::of(data, view),
                extent: Extent { width, height },
                stride: seen.stride,
                marks,
                colours: seen.truth.iter().map(evened).collect(),
                evidence: alpha.iter().map(|a| *a > 0.5).collect(),
            });
            gains.push(gain);
        }
        let scene = marks_of_the_scene(marked, LOOSE).iter().flatten().filter(|mark| **mark).count();
        let share = |count: usize| count as f64 / squares.max(1) as f64;
        Ok(Self { deviation: deviation(&gains), gains, far: share(all - scene), scene: share(scene) })
    }

    /// Enough squares are far from the field, and not too many of these show the scene: where they do, the others are parts of it
    /// that fewer photos show.
    fn has_occluders(&self, limit: f64, scene: f64) -> bool {
        self.far > limit && scene * self.far > self.scene
    }
}

/// How far each square is evidence: its opacity, and 0 where the backdrop is seen.
fn evidence(seen: &PhotoAndRender<'_>, backdrop: Backdrop) -> Vec<f32> {
    seen.alpha.iter().zip(seen.truth).map(|(a, rgb)| if backdrop.is(*rgb) { 0.0 } else { *a }).collect()
}

/// Logarithm of the factor between photo and field, by channel: the median over its pixels.
fn gain(seen: &PhotoAndRender<'_>) -> [f32; 3] {
    medians(seen, |photo, field| ((photo + DARK) / (field.max(0.0) + DARK)).ln())
}

/// The [`gain`] of the left half of a photo and of its right half, over the pixels that are evidence.
fn gains_of_halves(seen: &PhotoAndRender<'_>, evidence: &[f32]) -> [[f32; 3]; 2] {
    let width = seen.size[0].max(1);
    [true, false].map(|left| {
        let of_half = |(i, &a): (usize, &f32)| if (i % width < width / 2) == left { a } else { 0.0 };
        let alpha: Vec<f32> = evidence.iter().enumerate().map(of_half).collect();
        gain(&PhotoAndRender { alpha: &alpha, ..*seen })
    })
}

/// Root of the covariance of the gains of the photos' halves, mean over channels: where both halves of a photo always agree, the
/// [`deviation`] of its gains; 0 where they know nothing of each other.
fn common_deviation(gains: &[[[f32; 3]; 2]]) -> f64 {
    let n = gains.len().max(1) as f64;
    let channel = |c: usize| {
        let of_half = |half: usize| gains.iter().map(move |g| f64::from(g[half][c]));
        let [left, right] = [0, 1].map(|half| of_half(half).sum::<f64>() / n);
        let products = of_half(0).zip(of_half(1)).map(|(a, b)| (a - left) * (b - right));
        (products.sum::<f64>() / n).max(0.0).sqrt()
    };
    (channel(0) + channel(1) + channel(2)) / 3.0
}

/// The summand between photo and field, by channel: the median over its pixels.
fn offset(seen: &PhotoAndRender<'_>) -> [f32; 3] {
    medians(seen, |photo, field| photo - field)
}

/// The median over the pixels that are evidence of `of(photo, field)`, by channel; 0 without any.
fn medians(seen: &PhotoAndRender<'_>, of: impl Fn(f32, f32) -> f32) -> [f32; 3] {
    [0, 1, 2].map(|c| {
        let evident = (0..seen.pixels.len()).filter(|&i| seen.alpha[i] > 0.5);
        let mut values: Vec<f32> = evident.map(|i| of(seen.truth[i][c], seen.pixels[i].rgb[c])).collect();
        let middle = values.len() / 2;
        match values.is_empty() {
            true => 0.0,
            false => *values.select_nth_unstable_by(middle, f32::total_cmp).1,
        }
    })
}

/// Standard deviation of the gains over the photos, mean over channels.
fn deviation(gains: &[[f32; 3]]) -> f64 {
    let n = gains.len().max(1) as f64;
    let channel = |c: usize| {
        let mean = gains.iter().map(|g| f64::from(g[c])).sum::<f64>() / n;
        (gains.iter().map(|g| (f64::from(g[c]) - mean).powi(2)).sum::<f64>() / n).sqrt()
    };
    (channel(0) + channel(1) + channel(2)) / 3.0
}

/// Squares that are evidence and far from the field, by the means of their neighbourhoods, as texture that is not learnt yet errs
/// both ways. Neither a factor nor a summand of the photo explains them.
fn far_squares(seen: &PhotoAndRender<'_>, gain: [f32; 3]) -> Vec<bool> {
    let (gain, offset) = (gain.map(f32::exp), offset(seen));
    let far = |evened: &dyn Fn(&Pixel) -> [f32; 3]| -> Vec<bool> {
        let pixels: Vec<Pixel> = seen.pixels.iter().map(|pixel| Pixel { rgb: evened(pixel), ..*pixel }).collect();
        let residuals = mean_residuals(&PhotoAndRender { pixels: &pixels, ..*seen }, NEIGHBOURHOOD);
        residuals.iter().zip(seen.alpha).map(|(e, a)| *a > 0.5 && *e > FAR).collect()
    };
    let by_factor = far(&|pixel| [0, 1, 2].map(|c| (pixel.rgb[c] + DARK) * gain[c] - DARK));
    let by_summand = far(&|pixel| [0, 1, 2].map(|c| pixel.rgb[c] + offset[c]));
    by_factor.into_iter().zip(by_summand).map(|(a, b)| a && b).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen<'a>(pixels: &'a [Pixel], truth: &'a [[f32; 3]], alpha: &'a [f32]) -> PhotoAndRender<'a> {
        PhotoAndRender { view: 0, size: [pixels.len(), 1], stride: 1, pixels, truth, alpha, place: &[] }
    }

    #[test]
    fn gains_are_medians_and_an_occluder_does_not_change_them() {
        let pixels: Vec<Pixel> = (0..20).map(|i| Pixel { rgb: [0.02 * i as f32; 3], ..Pixel::default() }).collect();
        let mut truth: Vec<[f32; 3]> =
            pixels.iter().map(|p| [1.2, 1.0, 0.9].map(|g| (p.rgb[0] + DARK) * g - DARK)).collect();
        truth[..4].fill([1.0, 0.0, 1.0]);
        let alpha = [1.0; 20];
        let seen = seen(&pixels, &truth, &alpha);
        let gain = gain(&seen);
        for (gain, want) in gain.iter().zip([1.2_f32, 1.0, 0.9]) {
            assert!((gain.exp() - want).abs() < 1e-4, "{gain} {want}");
        }
        let far = far_squares(&seen, gain).into_iter().filter(|far| *far).count();
        assert!((3..=6).contains(&far), "{far}");
        let darker: Vec<[f32; 3]> = pixels.iter().map(|p| p.rgb.map(|c| c - 0.3)).collect();
        assert_eq!(far_squares(&PhotoAndRender { truth: &darker, ..seen }, gain), [false; 20], "a summand explains it");
        assert!(deviation(&[gain, gain]) < 1e-6 && deviation(&[gain, [0.0; 3]]) > 0.04);
    }

    #[test]
    fn what_moves_in_one_half_of_photos_is_not_their_appearance() {
        // Rows of four pixels: two on the left, two on the right.
        let pixels = [Pixel { rgb: [0.5; 3], ..Pixel::default() }; 8];
        let photo = |left: f32, right: f32| [left, left, right, right].repeat(2).into_iter().map(|x| [x; 3]);
        let of = |photos: &[[f32; 2]]| {
            let gains = |&[left, right]: &[f32; 2]| {
                let truth: Vec<[f32; 3]> = photo(left, right).collect();
                let seen = PhotoAndRender { size: [4, 2], ..seen(&pixels, &truth, &[1.0; 8]) };
                gains_of_halves(&seen, &[1.0; 8])
            };
            common_deviation(&photos.iter().map(gains).collect::<Vec<_>>())
        };
        let exposed = of(&[[0.4; 2], [0.6; 2], [0.5; 2]]);
        assert!(differs(exposed), "{exposed}");
        // On the left alone, or on both sides with nothing to do with each other.
        for photos in [&[[0.4, 0.5], [0.6, 0.5], [0.5, 0.5]][..], &[[0.4, 0.6], [0.6, 0.6], [0.4, 0.4], [0.6, 0.4]]] {
            assert!(of(photos) < 1e-3, "{photos:?}: {}", of(photos));
        }
        assert!(of(&[[0.4, 0.6], [0.6, 0.4]]) == 0.0 && of(&[]) == 0.0);
    }

    #[test]
    fn what_is_mostly_the_scene_has_no_occluders() {
        let found = |far, scene| Found { gains: Vec::new(), deviation: 0.0, far, scene };
        for scene in [SCENE, SCENE_OF_FEW] {
            assert!(found(0.2, 0.0).has_occluders(SHARE, scene) && found(0.12, 0.02).has_occluders(SHARE, scene));
            assert!(!found(0.04, 0.0).has_occluders(SHARE, scene) && !found(0.06, 0.19).has_occluders(SHARE, scene));
        }
        let [few, many] = [SCENE_OF_FEW, SCENE].map(|scene| found(0.08, 0.09).has_occluders(SHARE, scene));
        assert!(few && !many);
    }

    #[test]
    fn a_backdrop_is_not_evidence() {
        let pixels = [Pixel { rgb: [0.5; 3], ..Pixel::default() }; 4];
        let truth = [[1.0; 3], [0.99; 3], [0.4; 3], [1.0, 1.0, 0.9]];
        let seen = seen(&pixels, &truth, &[1.0; 4]);
        assert_eq!(evidence(&seen, Backdrop::new(engine::options::Background::White)), [0.0, 0.0, 1.0, 1.0]);
        assert_eq!(evidence(&seen, Backdrop::default()), [1.0; 4]);
    }

    #[test]
    fn a_photo_of_nothing_needs_nothing() {
        let seen = seen(&[], &[], &[]);
        assert_eq!((gain(&seen), far_squares(&seen, [0.0; 3]).len(), deviation(&[])), ([0.0; 3], 0, 0.0));
    }
}
