//! What do these photos need? A short training of the plain field, then every photo beside what the field renders there.
//!
//! * Light: where photos are brighter, darker or of another tint than the field as a whole, by photo.
//! * Occluders: squares of a photo whose mean is far from the field's after its light is taken out, but for those that are of
//!   the scene for all that the field does not know of it yet ([`super::guard`]).
//!
//! Pixels of a backdrop of one colour say nothing of either.
//!
//! Where the scene itself is far from the field, or where photos in different light are, the field has had no fair chance: it is
//! trained for longer, with a code for each photo where light differs, and looked at again before anything is called an occluder.

use super::config::{AppearanceKind, FieldKind, OccluderKind, WildConfig};
use super::guard::{DARK, LEAST_PHOTOS, LOOSE, Marked, Witness, scene as of_the_scene};
use super::light::Light;
use super::nerf_w::NerfW;
use super::photo_judge::{Backdrop, NEIGHBOURHOOD, mean_residuals};
use super::survey_stride;
use crate::method::{Method, Pixel, ViewSeen};
use crate::plan::{Ground, field_settings};
use crate::rays::Ngp;
use crate::survey::Surveys;
use engine::data::Dataset;
use engine::options::RunOptions;
use engine::system::{System, SystemError};
use losses::heuristics::Extent;

/// Steps of the short training, and of the second one.
const STEPS: u64 = 80;
const MORE_STEPS: u64 = 160;
/// Deviation of the photos' light, as a factor of colours, from which on each has a code.
const LIGHT: f64 = 0.045;
/// Difference of a square's mean from the field, colour units, that an occluder makes; and the share of such squares from which
/// on the loss is robust.
const STRANGE: f32 = 0.2;
const SHARE: f64 = 0.05;
/// That share at the second look, which errs less.
const SECOND_SHARE: f64 = 0.01;
/// Of fewer photos than this three or four show a place: too few for a robust loss to tell which of them an occluder hides it in.
/// A transient part of each photo, which costs what it explains, takes its place.
const FEW_PHOTOS: usize = 16;
/// Occluders are looked for where the share of the scene is at most so many times that of what is strange; of few photos more, as a
/// transient part takes nothing away for good.
const SCENE: f64 = 1.0;
const SCENE_OF_FEW: f64 = 2.0;

/// Light and occluders of the photos, each with a line of reason.
pub(super) fn needs(
    ground: &mut Ground,
    data: &Dataset,
    run: &RunOptions,
) -> Result<(AppearanceKind, OccluderKind), SystemError> {
    if data.len() < 2 {
        ground.lines.push("light and occluders: not looked for (one photo says nothing about others)".into());
        return Ok((AppearanceKind::None, OccluderKind::None));
    }
    let lines = ground.lines.len();
    // Colours that depend on the direction would explain the light of each photo.
    let mut config = field_settings(ground, data);
    config.networks.sh_degree = 1;
    let mut field = ground.ngp(data, &config, run.seed, None)?;
    // What this field was built with is said again for the one that stays.
    ground.lines.truncate(lines);
    let backdrop = Backdrop::new(ground.background);
    let train = |field: &mut Ngp, steps: std::ops::Range<u64>| -> Result<(), SystemError> {
        for step in steps {
            field.step(data, step)?;
        }
        Ok(())
    };
    train(&mut field, 0..STEPS)?;
    let first = Found::of(&field, data, backdrop, None)?;
    let light = first.light > LIGHT;
    let again = first.scene > SHARE || (light && first.strange > SHARE);
    let known = light.then_some(&first.gains[..]);
    let (found, limit, steps) = if again && data.len() >= LEAST_PHOTOS {
        if light {
            let wild = WildConfig::new(FieldKind::Ngp, AppearanceKind::Codes, OccluderKind::None);
            let codes = Light::new(&wild, data, run.seed)?;
            let method: Box<dyn Method> = Box::new(NerfW::new(&wild, codes, data, run.seed));
            field = ground.ngp(data, &config, run.seed, Some(method))?;
            ground.lines.truncate(lines);
            train(&mut field, 0..MORE_STEPS)?;
        } else {
            train(&mut field, STEPS..STEPS + MORE_STEPS)?;
        }
        (Found::of(&field, data, backdrop, known)?, SECOND_SHARE, if light { MORE_STEPS } else { STEPS + MORE_STEPS })
    } else {
        (first.clone(), SHARE, STEPS)
    };
    let (appearance, word) = match light {
        true => (AppearanceKind::Codes, "a code for each photo"),
        false => (AppearanceKind::None, "one for all"),
    };
    ground.lines.push(format!(
        "light: {word} (after {STEPS} plain steps photos differ from the field by {:.1} % in brightness or tint, limit {:.1} %)",
        100.0 * first.light,
        100.0 * LIGHT
    ));
    if data.len() < LEAST_PHOTOS {
        ground.lines.push(format!("occluders: not looked for ({} photos are too few to tell)", data.len()));
        return Ok((appearance, OccluderKind::None));
    }
    let (scene, kind, word) = if data.len() < FEW_PHOTOS {
        (SCENE_OF_FEW, OccluderKind::Transient, "a transient part of each photo, as there are few")
    } else {
        (SCENE, OccluderKind::Robust, "left out by a robust loss")
    };
    let (occluders, word) = if found.has_occluders(limit, scene) { (kind, word) } else { (OccluderKind::None, "none") };
    ground.lines.push(format!(
        "occluders: {word} (after {steps} steps {:.1} % of the photos' squares are more than {STRANGE} away from the field in one \
         photo, limit {:.1} %; {:.1} % are in most photos that see the place: that is the scene)",
        100.0 * found.strange,
        100.0 * limit,
        100.0 * found.scene
    ));
    Ok((appearance, occluders))
}

/// What photos beside the field say.
#[derive(Clone, Debug)]
struct Found {
    /// The light of each photo, as [`gain`] has it.
    gains: Vec<[f32; 3]>,
    /// Deviation of the photos' light.
    light: f64,
    /// Share of the squares that are far from the field, but for the next.
    strange: f64,
    /// Share of the squares that are far from the field and of the scene.
    scene: f64,
}

impl Found {
    /// `known` is the light of each photo where the field renders each in its own.
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
            let shown = field.show(data, view, stride)?;
            let seen = shown.seen(view);
            let alpha = evidence(&seen, backdrop);
            let seen = ViewSeen { alpha: &alpha, ..seen };
            let gain = gain(&seen);
            let marks = strange(&seen, gain);
            all += marks.iter().filter(|mark| **mark).count();
            squares += alpha.iter().filter(|a| **a > 0.5).count();
            let [width, height] = seen.size;
            // In one light for all.
            let light = known.map_or(gain, |known| known[view]);
            let lit = |rgb: &[f32; 3]| [0, 1, 2].map(|c| (rgb[c] + DARK) / light[c].exp() - DARK);
            marked.push(Marked {
                witness: Witness::of(data, view),
                extent: Extent { width, height },
                stride: seen.stride,
                marks,
                colours: seen.truth.iter().map(lit).collect(),
                evidence: alpha.iter().map(|a| *a > 0.5).collect(),
            });
            gains.push(gain);
        }
        let scene = of_the_scene(marked, LOOSE).iter().flatten().filter(|mark| **mark).count();
        let share = |count: usize| count as f64 / squares.max(1) as f64;
        Ok(Self { light: deviation(&gains), gains, strange: share(all - scene), scene: share(scene) })
    }

    /// Enough is far from the field, and not too much of that is the scene: where it is, the rest are its parts that fewer photos
    /// see.
    fn has_occluders(&self, limit: f64, scene: f64) -> bool {
        self.strange > limit && scene * self.strange > self.scene
    }
}

/// How much each square says: its opacity, and nothing where the backdrop is seen.
fn evidence(seen: &ViewSeen<'_>, backdrop: Backdrop) -> Vec<f32> {
    seen.alpha.iter().zip(seen.truth).map(|(a, rgb)| if backdrop.is(*rgb) { 0.0 } else { *a }).collect()
}

/// Logarithm of the factor between photo and field, by channel: the median over its pixels.
fn gain(seen: &ViewSeen<'_>) -> [f32; 3] {
    medians(seen, |photo, field| ((photo + DARK) / (field.max(0.0) + DARK)).ln())
}

/// The summand between photo and field, by channel: the median over its pixels.
fn offset(seen: &ViewSeen<'_>) -> [f32; 3] {
    medians(seen, |photo, field| photo - field)
}

/// The median over the pixels that say something of what photo and field are to each other, by channel; 0 where none do.
fn medians(seen: &ViewSeen<'_>, of: impl Fn(f32, f32) -> f32) -> [f32; 3] {
    [0, 1, 2].map(|c| {
        let says = (0..seen.pixels.len()).filter(|&i| seen.alpha[i] > 0.5);
        let mut values: Vec<f32> = says.map(|i| of(seen.truth[i][c], seen.pixels[i].rgb[c])).collect();
        let middle = values.len() / 2;
        match values.is_empty() {
            true => 0.0,
            false => *values.select_nth_unstable_by(middle, f32::total_cmp).1,
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
/// texture that is not learnt yet errs both ways. Neither a factor nor a summand of the photo's light explains them.
fn strange(seen: &ViewSeen<'_>, gain: [f32; 3]) -> Vec<bool> {
    let (gain, offset) = (gain.map(f32::exp), offset(seen));
    let far = |lit: &dyn Fn(&Pixel) -> [f32; 3]| -> Vec<bool> {
        let pixels: Vec<Pixel> = seen.pixels.iter().map(|pixel| Pixel { rgb: lit(pixel), ..*pixel }).collect();
        let residuals = mean_residuals(&ViewSeen { pixels: &pixels, ..*seen }, NEIGHBOURHOOD);
        residuals.iter().zip(seen.alpha).map(|(e, a)| *a > 0.5 && *e > STRANGE).collect()
    };
    let by_factor = far(&|pixel| [0, 1, 2].map(|c| (pixel.rgb[c] + DARK) * gain[c] - DARK));
    let by_summand = far(&|pixel| [0, 1, 2].map(|c| pixel.rgb[c] + offset[c]));
    by_factor.into_iter().zip(by_summand).map(|(a, b)| a && b).collect()
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
        let darker: Vec<[f32; 3]> = pixels.iter().map(|p| p.rgb.map(|c| c - 0.3)).collect();
        assert_eq!(super::strange(&ViewSeen { truth: &darker, ..seen }, gain), [false; 20], "a summand explains it");
        assert!(deviation(&[gain, gain]) < 1e-6 && deviation(&[gain, [0.0; 3]]) > 0.04);
    }

    #[test]
    fn what_is_mostly_the_scene_has_no_occluders() {
        let found = |strange, scene| Found { gains: Vec::new(), light: 0.0, strange, scene };
        for scene in [SCENE, SCENE_OF_FEW] {
            assert!(found(0.2, 0.0).has_occluders(SHARE, scene) && found(0.12, 0.02).has_occluders(SHARE, scene));
            assert!(!found(0.04, 0.0).has_occluders(SHARE, scene) && !found(0.06, 0.19).has_occluders(SHARE, scene));
        }
        let [few, many] = [SCENE_OF_FEW, SCENE].map(|scene| found(0.08, 0.09).has_occluders(SHARE, scene));
        assert!(few && !many);
    }

    #[test]
    fn a_backdrop_says_nothing_about_the_light() {
        let pixels = [Pixel { rgb: [0.5; 3], ..Pixel::default() }; 4];
        let truth = [[1.0; 3], [0.99; 3], [0.4; 3], [1.0, 1.0, 0.9]];
        let seen = seen(&pixels, &truth, &[1.0; 4]);
        assert_eq!(evidence(&seen, Backdrop::new(engine::options::Background::White)), [0.0, 0.0, 1.0, 1.0]);
        assert_eq!(evidence(&seen, Backdrop::default()), [1.0; 4]);
    }

    #[test]
    fn a_photo_of_nothing_needs_nothing() {
        let seen = seen(&[], &[], &[]);
        assert_eq!((gain(&seen), strange(&seen, [0.0; 3]).len(), deviation(&[])), ([0.0; 3], 0, 0.0));
    }
}
