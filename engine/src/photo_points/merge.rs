//! One point for each place, and every photo that shows it.

use super::depth::Estimate;
use super::patch::{ncc, patch};
use super::photo::Photo;
use glam::{DMat2, DVec2, DVec3};
use rayon::prelude::*;
use std::collections::HashMap;

/// Two points are one where most photos show them this close together, pixels.
const SAME: f64 = 2.0;
/// Agreement of a photo that shows a point.
const SHOWN: f32 = 0.7;
/// Photos are asked about points up to this parallax, radians; those within the smaller one should show it.
const ASKED: f64 = 0.6;
const EXPECTED: f64 = 0.3;
/// This share of those does.
const LEAST_SHARE: f64 = 0.34;
/// Sizes of a patch in two photos differ by less than this (area).
const SIZES: f64 = 3.0;

/// A point that is kept.
pub(super) struct Merged {
    pub(super) x: DVec3,
    pub(super) rgb: [u8; 3],
    /// Photos and pixels, ascending.
    pub(super) seen: Vec<(usize, DVec2)>,
}

/// Points of the estimates, best first where they fall together; the order kept is that of the estimates.
pub(super) fn merge(photos: &[Photo], estimates: &[Estimate]) -> Vec<Merged> {
    let mut order: Vec<usize> = (0..estimates.len()).collect();
    order.sort_by(|i, j| estimates[*j].score.total_cmp(&estimates[*i].score).then(i.cmp(j)));
    let mut taken: HashMap<(usize, i64, i64), Vec<DVec2>> = HashMap::new();
    let mut kept = Vec::new();
    let cell = |x: DVec2| ((x.x / SAME).floor() as i64, (x.y / SAME).floor() as i64);
    for i in order {
        let e = &estimates[i];
        let shown = e.seen.iter().filter_map(|b| Some((*b, photos[*b].project(e.x)?)));
        let shown: Vec<(usize, DVec2)> = std::iter::once((e.photo, e.pixel)).chain(shown).collect();
        let is_taken = |(photo, x): &&(usize, DVec2)| {
            let (u, v) = cell(*x);
            (v - 1..=v + 1).any(|v| {
                (u - 1..=u + 1).any(|u| {
                    taken.get(&(*photo, u, v)).is_some_and(|there| there.iter().any(|y| y.distance(*x) < SAME))
                })
            })
        };
        if 2 * shown.iter().filter(is_taken).count() > shown.len() {
            continue;
        }
        for (photo, x) in shown {
            let (u, v) = cell(x);
            taken.entry((photo, u, v)).or_default().push(x);
        }
        kept.push(i);
    }
    kept.sort_unstable();
    kept.par_iter().filter_map(|i| seen_by_all(photos, &estimates[*i])).collect()
}

/// The point with all photos that show it; `None` where too few of those do that should.
fn seen_by_all(photos: &[Photo], e: &Estimate) -> Option<Merged> {
    let photo = &photos[e.photo];
    let with = patch(&photo.levels[0], 1.0, e.pixel, &DMat2::IDENTITY)?;
    let to_camera = photo.centre() - e.x;
    let (distance, d) = (to_camera.length(), -to_camera.normalize());
    let size = distance / photo.focal();
    let down = photo.camera().pose.r.y_axis;
    let right = down.cross(d).normalize_or_zero();
    let (right, down) = (right * size, d.cross(right) * size);
    let mut seen = vec![(e.photo, e.pixel)];
    let (mut expected, mut agreed) = (0, 0);
    for (b, other) in photos.iter().enumerate().filter(|(b, _)| *b != e.photo) {
        let theta = to_camera.angle_between(other.centre() - e.x);
        if theta > ASKED {
            continue;
        }
        let Some(at) = other.project(e.x).filter(|at| other.holds(*at, 1.0) && other.shows(*at)) else { continue };
        let (Some(u), Some(v)) = (other.project(e.x + right), other.project(e.x + down)) else { continue };
        let turn = DMat2::from_cols(u - at, v - at);
        if !(1.0 / SIZES..SIZES).contains(&turn.determinant()) {
            continue;
        }
        let Some(there) = patch(&other.levels[0], 1.0, at, &turn) else { continue };
        let shows = ncc(&there, &with) >= SHOWN;
        if theta <= EXPECTED {
            expected += 1;
            agreed += usize::from(shows);
        }
        if shows {
            seen.push((b, at));
        }
    }
    if (agreed as f64) < LEAST_SHARE * expected as f64 {
        return None;
    }
    seen.sort_by_key(|(photo, _)| *photo);
    let mut sum = [0_u32; 3];
    for (photo, x) in &seen {
        let colour = photos[*photo].colour(*x);
        (0..3).for_each(|c| sum[c] += u32::from(colour[c]));
    }
    let n = seen.len() as u32;
    Some(Merged { x: e.x, rgb: sum.map(|s| ((s + n / 2) / n) as u8), seen })
}
