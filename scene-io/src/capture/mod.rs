//! Captures that cannot turn out well: what photos and cameras say before any training.
//!
//! Every finding is a [`Problem`] of severity warning: it names the photos and says what to do.
//!
//! | finding | from |
//! | --- | --- |
//! | too few photos, photos too small | counts and sizes |
//! | cameras that contradict each other | photos from nearly one pose that show different things; photos of a sequence that look alike, taken from far apart |
//! | points behind cameras | the points that a photo's features belong to |
//! | exposure jumps, blur | photos beside those from the nearest poses |

mod compare;
mod thumb;

pub use thumb::Thumb;

use crate::listing::listing;
use crate::{Dialect, Problem, Scene, Split, time};
use compare::{Neighbour, neighbours};
use render_core::bounds::percentile;
use render_core::camera::Camera;
use std::path::Path;

/// Fewer training photos than this leave holes.
const FEW_PHOTOS: usize = 12;
/// Photos with a longest side below this show no detail, pixels.
const SMALL_SIDE: u32 = 160;
/// Photos from one pose show different things when their correlation is below this part of what is usual for neighbours, and
/// neighbours usually agree at least so well.
const DIFFERENT: f64 = 0.6;
const USUAL: f64 = 0.5;
/// Correlation above which photos that follow each other look alike.
const ALIKE: f32 = 0.6;
/// A step between photos that follow each other is a jump when it is so many times the median step.
const JUMP: f64 = 8.0;
/// Correlation above which neighbours show enough of the same to compare their brightness.
const RELATED: f32 = 0.3;
/// Exposures differ visibly from this ratio on, stops; and this share of the photos may.
const STOPS: f32 = 0.4;
const EXPOSURE_SHARE: f64 = 0.1;
/// A photo below this part of its neighbours' median sharpness is blurred.
const BLURRED: f32 = 0.35;
/// Share of a photo's points that may lie behind its camera.
const BEHIND: f64 = 0.01;
/// Pairs of photos that are named.
const NAMED: usize = 5;

/// What is wrong with a capture. `thumbs[i]` belongs to `scene.frames[i]`; `None` where it was not decoded.
///
/// Only training photos are compared, and none of a scene that moves: its photos differ for good reason.
///
/// # Panics
/// When there are more thumbs than frames, or a thumb has not a grey value for each pixel.
#[must_use]
pub fn find_problems(scene: &Scene, thumbs: &[Option<Thumb>]) -> Vec<Problem> {
    assert!(thumbs.len() <= scene.frames.len(), "{} thumbs for {} frames", thumbs.len(), scene.frames.len());
    let mut problems = without_pictures(scene);
    if time::summary(&scene.frames).is_some_and(|(_, distinct, _)| distinct > 1) {
        return problems;
    }
    let photos = photos(scene, thumbs);
    let near = neighbours(&photos);
    problems.extend(contradictions(scene, &photos, &near));
    problems.extend(jumps(scene, &photos));
    problems.extend(exposures(scene, &near));
    problems.extend(blur(scene, &photos, &near));
    problems
}

/// The findings that need no pictures.
#[must_use]
pub fn without_pictures(scene: &Scene) -> Vec<Problem> {
    let mut problems = Vec::new();
    let train: Vec<_> = scene.split(Split::Train).map(|i| &scene.frames[i]).collect();
    if (2..FEW_PHOTOS).contains(&train.len()) {
        let what = format!("{} training photos are few: what only one of them sees will be wrong", train.len());
        problems.push(warning(scene, what, "take 30 or more, each overlapping the next by two thirds"));
    }
    let mut sides: Vec<f64> = train.iter().map(|f| f64::from(f.camera.width.max(f.camera.height))).collect();
    sides.sort_unstable_by(f64::total_cmp);
    if let Some(side) = percentile(&sides, 0.5)
        && side < f64::from(SMALL_SIDE)
        && scene.dialect != Dialect::Synthetic
    {
        let what = format!("the photos are small ({side:.0} pixels): the scene cannot be sharper than they are");
        problems.push(warning(scene, what, "give larger photos and let `--longest-side` scale them down"));
    }
    let behind: Vec<String> = train
        .iter()
        .filter_map(|frame| {
            let points = frame.tracks.iter().filter_map(|track| scene.points.get(track.point as usize));
            let depths: Vec<f64> = points.map(|p| frame.camera.pose.to_camera(p.xyz).z).collect();
            let share = depths.iter().filter(|z| **z <= 0.0).count() as f64 / depths.len().max(1) as f64;
            (share > BEHIND).then(|| format!("{} ({:.0} %)", frame.name, 100.0 * share))
        })
        .collect();
    if !behind.is_empty() {
        let names: Vec<&str> = behind.iter().map(String::as_str).collect();
        let what = format!("points that a photo sees lie behind its camera: {}", listing(&names));
        problems.push(warning(scene, what, "leave these photos out, or run structure from motion again"));
    }
    problems
}

/// A training photo that is compared.
struct Photo<'a> {
    name: &'a str,
    /// At the size of the thumb.
    camera: Camera,
    thumb: &'a Thumb,
}

/// The training photos that were decoded.
fn photos<'a>(scene: &'a Scene, thumbs: &'a [Option<Thumb>]) -> Vec<Photo<'a>> {
    let trained = thumbs.iter().zip(&scene.frames).filter(|(_, frame)| frame.split == Split::Train);
    trained
        .filter_map(|(thumb, frame)| {
            let thumb = thumb.as_ref()?;
            Some(Photo { name: &frame.name, camera: frame.camera.resized(thumb.width, thumb.height), thumb })
        })
        .collect()
}

/// A finding about a scene: of its folder, or by its name where it has none, as drawn scenes.
fn warning(scene: &Scene, what: String, remedy: &str) -> Problem {
    let root = scene.root.as_path();
    let place = if root.as_os_str().is_empty() { Path::new(&scene.name) } else { root };
    Problem::new(place, what, remedy).warning()
}

/// Photos from nearly one pose that show different things.
fn contradictions(scene: &Scene, photos: &[Photo<'_>], near: &[Neighbour]) -> Option<Problem> {
    let mut levels: Vec<f64> = near.iter().map(|n| f64::from(n.agreement.correlation)).collect();
    levels.sort_unstable_by(f64::total_cmp);
    let usual = percentile(&levels, 0.5).filter(|usual| *usual >= USUAL)?;
    let differ = |n: &&Neighbour| n.same_pose && f64::from(n.agreement.correlation) < DIFFERENT * usual;
    let mut found: Vec<&Neighbour> = near.iter().filter(differ).collect();
    let same = near.iter().filter(|n| n.same_pose).count();
    found.sort_by(|a, b| a.agreement.correlation.total_cmp(&b.agreement.correlation));
    let pairs: Vec<String> = found
        .iter()
        .take(NAMED)
        .map(|n| format!("{} and {}", photos[n.photos[0]].name, photos[n.photos[1]].name))
        .collect();
    (!pairs.is_empty()).then(|| {
        let what = format!(
            "cameras contradict each other: {} of {same} pairs of photos from nearly one pose show different things ({})",
            found.len(),
            pairs.join("; ")
        );
        warning(
            scene,
            what,
            "look at these photos: texture that repeats folds a model; leave one side out or run structure from motion again",
        )
    })
}

/// Photos that follow each other and look alike, from cameras far apart.
fn jumps(scene: &Scene, photos: &[Photo<'_>]) -> Option<Problem> {
    let mut order: Vec<&Photo<'_>> = photos.iter().collect();
    order.sort_by(|a, b| a.name.cmp(b.name));
    let steps: Vec<f64> = order.windows(2).map(|w| w[0].camera.pose.c.distance(w[1].camera.pose.c)).collect();
    let mut sorted = steps.clone();
    sorted.sort_unstable_by(f64::total_cmp);
    let usual = percentile(&sorted, 0.5).filter(|m| *m > 0.0)?;
    let alike: Vec<f32> = order.windows(2).map(|w| compare::unmoved(w[0].thumb, w[1].thumb)).collect();
    let mut levels: Vec<f64> = alike.iter().map(|a| f64::from(*a)).collect();
    levels.sort_unstable_by(f64::total_cmp);
    // Only where photos are a sequence: small steps, and each looks like the one before.
    let extent = compare::extent(photos);
    let typical = percentile(&levels, 0.5)?;
    if photos.len() < FEW_PHOTOS || usual > 0.15 * extent || typical < f64::from(ALIKE) {
        return None;
    }
    let found: Vec<String> = (0..steps.len())
        .filter(|&i| steps[i] > JUMP * usual && f64::from(alike[i]) >= typical)
        .map(|i| format!("{} and {} ({:.0} times the usual step)", order[i].name, order[i + 1].name, steps[i] / usual))
        .collect();
    (found.len() >= 2).then(|| {
        let named: Vec<&str> = found.iter().take(NAMED).map(String::as_str).collect();
        let what = format!(
            "cameras jump: {} pairs of photos follow each other and look alike, but stand far apart ({})",
            found.len(),
            named.join("; ")
        );
        warning(
            scene,
            what,
            "look at these photos: texture that repeats folds a model; run structure from motion again",
        )
    })
}

/// Neighbours of different brightness.
fn exposures(scene: &Scene, near: &[Neighbour]) -> Option<Problem> {
    let alike: Vec<&Neighbour> = near.iter().filter(|n| n.agreement.correlation > RELATED).collect();
    let jumps: Vec<f32> = alike.iter().map(|n| n.agreement.stops.abs()).filter(|s| *s > STOPS).collect();
    let share = jumps.len() as f64 / alike.len().max(1) as f64;
    (jumps.len() >= 2 && share > EXPOSURE_SHARE).then(|| {
        let most = jumps.iter().fold(0.0_f32, |m, s| m.max(*s));
        let what = format!(
            "exposure jumps: {:.0} % of neighbouring photos differ by more than {STOPS} stops (at most {most:.1})",
            100.0 * share
        );
        warning(
            scene,
            what,
            "take a system that learns the appearance of each photo: others explain the differences by fog",
        )
    })
}

/// Photos much softer than those from the nearest poses.
fn blur(scene: &Scene, photos: &[Photo<'_>], near: &[Neighbour]) -> Option<Problem> {
    let mut around: Vec<Vec<f64>> = vec![Vec::new(); photos.len()];
    for n in near {
        let [a, b] = n.photos;
        around[a].push(f64::from(photos[b].thumb.sharpness));
        around[b].push(f64::from(photos[a].thumb.sharpness));
    }
    around.iter_mut().for_each(|values| values.sort_unstable_by(f64::total_cmp));
    let blurred: Vec<&str> = photos
        .iter()
        .zip(&around)
        .filter(|(photo, around)| {
            let usual = percentile(around, 0.5).filter(|_| around.len() >= 2).unwrap_or(0.0) as f32;
            photo.thumb.sharpness < BLURRED * usual
        })
        .map(|(photo, _)| photo.name)
        .collect();
    (!blurred.is_empty()).then(|| {
        let what = format!(
            "{} of {} photos are blurred beside their neighbours: {}",
            blurred.len(),
            photos.len(),
            listing(&blurred)
        );
        warning(scene, what, "leave them out: `--missing-images skip` trains without photos that are taken away")
    })
}

#[cfg(test)]
mod tests;
