//! What do these photos need? A short training of the plain field, then every photo beside what the field renders there.
//!
//! * Light: where photos are brighter, darker or of another tint than the field as a whole, by photo.
//! * Occluders: squares of a photo whose mean is far from the field's after its light is taken out, but for those that are of
//!   the scene for all that the field does not know of it yet ([`super::guard`]).
//!
//! Pixels of a backdrop of one colour say nothing of either.

use super::config::{AppearanceKind, OccluderKind};
use super::field_settings::field_settings;
use super::guard::{DARK, LEAST_PHOTOS, Marked, Witness, scene as of_the_scene};
use super::photo_judge::{Backdrop, NEIGHBOURHOOD, mean_residuals};
use super::survey_stride;
use crate::data::Dataset;
use crate::method::{Pixel, ViewSeen};
use crate::options::RunOptions;
use crate::plan::Ground;
use crate::static_scene::ngp::NgpConfig;
use crate::static_scene::survey::Surveys;
use crate::system::{System, SystemError};
use losses::heuristics::Extent;
use scene_io::Scene;

/// Steps of the short training.
const STEPS: u64 = 80;
/// Deviation of the photos' light, as a factor of colours, from which on each has a code.
const LIGHT: f64 = 0.045;
/// Difference of a square's mean from the field, colour units, that an occluder makes; and the share of such squares from which
/// on the loss is robust.
const STRANGE: f32 = 0.2;
const SHARE: f64 = 0.05;

/// Light and occluders of the photos, each with a line of reason.
pub(super) fn needs(
    ground: &mut Ground,
    scene: &Scene,
    data: &Dataset,
    run: &RunOptions,
) -> Result<(AppearanceKind, OccluderKind), SystemError> {
    if data.len() < 2 {
        ground.lines.push("light and occluders: not looked for (one photo says nothing about others)".into());
        return Ok((AppearanceKind::None, OccluderKind::None));
    }
    let lines = ground.lines.len();
    // Colours that depend on the direction would explain the light of each photo.
    let config = NgpConfig { sh_degree: 1, ..field_settings(ground, scene, data) };
    let mut field = ground.ngp(data, &config, run.seed, None)?;
    // What this field was built with is said again for the one that stays.
    ground.lines.truncate(lines);
    for step in 0..STEPS {
        field.step(data, step)?;
    }
    let (stride, backdrop) = (survey_stride(data), Backdrop::new(ground.background));
    let mut gains = Vec::with_capacity(data.len());
    let (mut marked, mut squares) = (Vec::with_capacity(data.len()), 0);
    for view in 0..data.len() {
        let shown = field.show(data, view, stride)?;
        let seen = shown.seen(view);
        let alpha = evidence(&seen, backdrop);
        let seen = ViewSeen { alpha: &alpha, ..seen };
        let gain = gain(&seen);
        let marks = strange(&seen, gain);
        squares += seen.alpha.iter().filter(|a| **a > 0.5).count();
        let [width, height] = seen.size;
        let extent = Extent { width, height };
        // In the light of the field.
        let colours = seen.truth.iter().map(|rgb| [0, 1, 2].map(|c| (rgb[c] + DARK) / gain[c].exp() - DARK)).collect();
        let evidence = seen.alpha.iter().map(|a| *a > 0.5).collect();
        marked.push(Marked { witness: Witness::of(data, view), extent, stride: seen.stride, marks, colours, evidence });
        gains.push(gain);
    }
    let light = deviation(&gains);
    let (appearance, word) = match light > LIGHT {
        true => (AppearanceKind::Codes, "a code for each photo"),
        false => (AppearanceKind::None, "one for all"),
    };
    ground.lines.push(format!(
        "light: {word} (after {STEPS} plain steps photos differ from the field by {:.1} % in brightness or tint, limit {:.1} %)",
        100.0 * light,
        100.0 * LIGHT
    ));
    if data.len() < LEAST_PHOTOS {
        ground.lines.push(format!("occluders: not looked for ({} photos are too few to tell)", data.len()));
        return Ok((appearance, OccluderKind::None));
    }
    let share = |marks: &[Vec<bool>]| {
        marks.iter().flatten().filter(|mark| **mark).count() as f64 / squares.max(1) as f64
    };
    let all: Vec<Vec<bool>> = marked.iter().map(|photo| photo.marks.clone()).collect();
    let scene = of_the_scene(marked);
    let (all, scene) = (share(&all), share(&scene));
    let (occluders, word) = match all - scene > SHARE {
        true => (OccluderKind::Robust, "left out by a robust loss"),
        false => (OccluderKind::None, "none"),
    };
    ground.lines.push(format!(
        "occluders: {word} ({:.1} % of the photos' squares are more than {STRANGE} away from the field and not where most photos \
         are, limit {:.1} %; {:.1} % are: that is the scene)",
        100.0 * (all - scene),
        100.0 * SHARE,
        100.0 * scene
    ));
    Ok((appearance, occluders))
}

/// How much each square says: its opacity, and nothing where the backdrop is seen.
fn evidence(seen: &ViewSeen<'_>, backdrop: Backdrop) -> Vec<f32> {
    seen.alpha.iter().zip(seen.truth).map(|(a, rgb)| if backdrop.is(*rgb) { 0.0 } else { *a }).collect()
}

/// Logarithm of the factor between photo and field, by channel: the median over its pixels.
fn gain(seen: &ViewSeen<'_>) -> [f32; 3] {
    [0, 1, 2].map(|c| {
        let ratio = |i: usize| ((seen.truth[i][c] + DARK) / (seen.pixels[i].rgb[c].max(0.0) + DARK)).ln();
        let mut ratios: Vec<f32> = (0..seen.pixels.len()).filter(|&i| seen.alpha[i] > 0.5).map(ratio).collect();
        let middle = ratios.len() / 2;
        match ratios.is_empty() {
            true => 0.0,
            false => *ratios.select_nth_unstable_by(middle, f32::total_cmp).1,
        }
    })
}

/// Deviation of the gains over the photos, mean over channels.
fn deviation(gains: &[[f32; 3]]) -> f64 {
    let n = gains.len().max(1) as f64;
    let channel = |c: usize| {
        let mean = gains.iter().map(|g| f64::from(g[c])).sum::<f64>() / n;
        (gains.iter().map(|g| (f64::from(g[c]) - mean).powi(2)).sum::<f64>() / n).sqrt()
    };
    (channel(0) + channel(1) + channel(2)) / 3.0
}

/// Squares that show something else than the field, of those that show anything: by the means of their neighbourhoods, as
/// texture that is not learnt yet errs both ways.
fn strange(seen: &ViewSeen<'_>, gain: [f32; 3]) -> Vec<bool> {
    let gain = gain.map(f32::exp);
    let lit = |pixel: &Pixel| [0, 1, 2].map(|c| (pixel.rgb[c] + DARK) * gain[c] - DARK);
    let pixels: Vec<Pixel> = seen.pixels.iter().map(|pixel| Pixel { rgb: lit(pixel), ..*pixel }).collect();
    let residuals = mean_residuals(&ViewSeen { pixels: &pixels, ..*seen }, NEIGHBOURHOOD);
    residuals.iter().zip(seen.alpha).map(|(e, a)| *a > 0.5 && *e > STRANGE).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen<'a>(pixels: &'a [Pixel], truth: &'a [[f32; 3]], alpha: &'a [f32]) -> ViewSeen<'a> {
        ViewSeen { view: 0, size: [pixels.len(), 1], stride: 1, pixels, truth, alpha, place: &[] }
    }

    #[test]
    fn light_is_the_median_and_a_stranger_does_not_change_it() {
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
        let strange = strange(&seen, gain).into_iter().filter(|s| *s).count();
        assert!((3..=6).contains(&strange), "{strange}");
        assert!(deviation(&[gain, gain]) < 1e-6 && deviation(&[gain, [0.0; 3]]) > 0.04);
    }

    #[test]
    fn a_backdrop_says_nothing_about_the_light() {
        let pixels = [Pixel { rgb: [0.5; 3], ..Pixel::default() }; 4];
        let truth = [[1.0; 3], [0.99; 3], [0.4; 3], [1.0, 1.0, 0.9]];
        let seen = seen(&pixels, &truth, &[1.0; 4]);
        assert_eq!(evidence(&seen, Backdrop::new(crate::options::Background::White)), [0.0, 0.0, 1.0, 1.0]);
        assert_eq!(evidence(&seen, Backdrop::default()), [1.0; 4]);
    }

    #[test]
    fn a_photo_of_nothing_needs_nothing() {
        let seen = seen(&[], &[], &[]);
        assert_eq!((gain(&seen), strange(&seen, [0.0; 3]).len(), deviation(&[])), ([0.0; 3], 0, 0.0));
    }
}
