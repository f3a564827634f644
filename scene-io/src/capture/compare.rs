//! Pairs of photos from poses near each other, and how their pictures agree.

use super::Photo;
use super::thumb::{Agreement, Thumb, agreement};
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use render_core::rig::{focus_point, mean_centre, rms_distance};

/// Poses are the same when centres are nearer than this part of the capture's extent and axes within this angle (cosine).
const SAME_PLACE: f64 = 0.03;
const SAME_AXIS: f64 = 0.995;
/// Poses are near each other, likewise.
const NEAR_PLACE: f64 = 0.5;
const NEAR_AXIS: f64 = 0.9;
/// Nearest photos that each photo is compared with.
const MOST: usize = 4;
/// Shifts tried, pixels of a thumb: parallax of what is near, and poses that are not exact.
const SHIFT: i32 = 3;
/// Share of the picture that both photos must show.
const OVERLAP: f64 = 0.4;

/// Two photos from poses near each other.
pub(super) struct Neighbour {
    /// Their places in the list, the lower first.
    pub(super) photos: [usize; 2],
    pub(super) same_pose: bool,
    /// How the pictures agree at the best shift.
    pub(super) agreement: Agreement,
}

/// Root mean square distance of the cameras from their mean, world units.
pub(super) fn extent(photos: &[Photo<'_>]) -> f64 {
    let poses: Vec<_> = photos.iter().map(|p| p.camera.pose).collect();
    mean_centre(&poses).map_or(0.0, |centre| rms_distance(&poses, centre))
}

/// All pairs of photos with each other's nearest poses, once each, in order.
pub(super) fn neighbours(photos: &[Photo<'_>]) -> Vec<Neighbour> {
    let extent = extent(photos);
    if extent <= 0.0 {
        return Vec::new();
    }
    let mut pairs: Vec<[usize; 2]> = (0..photos.len())
        .into_par_iter()
        .flat_map_iter(|i| {
            let a = &photos[i].camera;
            let near = |j: usize| {
                let b = &photos[j].camera;
                let distance = a.pose.c.distance(b.pose.c) / extent;
                let turned = a.optical_axis().dot(b.optical_axis());
                (j != i && distance < NEAR_PLACE && turned > NEAR_AXIS).then_some((distance + (1.0 - turned), j))
            };
            let mut found: Vec<(f64, usize)> = (0..photos.len()).filter_map(near).collect();
            found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            found.truncate(MOST);
            found.into_iter().map(move |(_, j)| [i.min(j), i.max(j)]).collect::<Vec<_>>()
        })
        .collect();
    pairs.sort_unstable();
    pairs.dedup();
    let poses: Vec<_> = photos.iter().map(|p| p.camera.pose).collect();
    let focus = focus_point(&poses);
    pairs
        .into_par_iter()
        .filter_map(|[i, j]| {
            let (a, b) = (&photos[i].camera, &photos[j].camera);
            let same_pose = a.pose.c.distance(b.pose.c) < SAME_PLACE * extent
                && a.optical_axis().dot(b.optical_axis()) > SAME_AXIS
                && a.pose.r.x_axis.dot(b.pose.r.x_axis) > SAME_AXIS;
            Some(Neighbour { photos: [i, j], same_pose, agreement: beside(&photos[i], &photos[j], focus)? })
        })
        .collect()
}

/// The second photo beside the first, as if everything were far away or in the plane through `focus`, at the shift where they
/// agree best; `None` where they overlap too little.
fn beside(a: &Photo<'_>, b: &Photo<'_>, focus: Option<DVec3>) -> Option<Agreement> {
    let (from, to) = (a.camera.prepare(), b.camera.prepare());
    let axis = a.camera.optical_axis();
    let plane = focus.map(|focus| (focus - a.camera.pose.c).dot(axis)).filter(|z| *z > 0.0);
    let found = [None, plane].into_iter().filter_map(|depth| {
        let places: Vec<Option<DVec2>> = pixels(a.thumb)
            .map(|(x, y)| {
                let ray = from.ray(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5))?;
                to.project(match depth {
                    // The direction alone decides where a pixel is seen.
                    None => b.camera.pose.c + ray.d,
                    Some(depth) => ray.o + ray.d * (depth / ray.d.dot(axis)),
                })
            })
            .collect();
        best(a.thumb, b.thumb, &places)
    });
    found.reduce(|a, b| if b.correlation > a.correlation { b } else { a })
}

/// Correlation of two pictures as they are, at the best shift; 0 where they overlap too little.
pub(super) fn unmoved(a: &Thumb, b: &Thumb) -> f32 {
    let scale = DVec2::new(f64::from(b.width) / f64::from(a.width), f64::from(b.height) / f64::from(a.height));
    let places: Vec<Option<DVec2>> =
        pixels(a).map(|(x, y)| Some(scale * DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5))).collect();
    best(a, b, &places).map_or(0.0, |found| found.correlation)
}

fn pixels(thumb: &Thumb) -> impl Iterator<Item = (u32, u32)> {
    let width = thumb.width;
    (0..thumb.height).flat_map(move |y| (0..width).map(move |x| (x, y)))
}

fn best(a: &Thumb, b: &Thumb, places: &[Option<DVec2>]) -> Option<Agreement> {
    let mut best: Option<Agreement> = None;
    let mut pairs = Vec::with_capacity(places.len());
    for shift in (-SHIFT..=SHIFT).flat_map(|y| (-SHIFT..=SHIFT).map(move |x| DVec2::new(x.into(), y.into()))) {
        pairs.clear();
        pairs.extend(a.grey.iter().zip(places).filter_map(|(grey, place)| {
            let place = (*place)? + shift;
            Some((*grey, b.at(place.x, place.y)?)).filter(|(grey, _)| !grey.is_nan())
        }));
        if pairs.len() as f64 >= OVERLAP * places.len() as f64 {
            let found = agreement(&pairs);
            if best.is_none_or(|best| found.correlation > best.correlation) {
                best = Some(found);
            }
        }
    }
    best
}
