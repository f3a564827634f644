//! How far away a corner is: where along its ray its patch agrees with what several photos show.
//!
//! Each match of a corner says a depth. The one that most matches agree on is refined: the patch, taken for a small square that
//! faces the corner's camera, is moved along the ray and compared with every photo that may see it.

use super::matching::{Corner, Links};
use super::options::Options;
use super::patch::{Patch, ncc, patch};
use super::photo::Photo;
use super::triangulate::along_ray;
use glam::{DMat2, DVec2, DVec3};
use rayon::prelude::*;

/// Matches agree where a point is seen this close to both corners, pixels.
const AGREE: f64 = 2.0;
/// Places tried along the ray to each side, and how far apart they are in the photo where that is farthest, pixels.
const TRIED: usize = 5;
const APART: f64 = 0.6;
/// How often the range is moved where its end is best.
const MOVES: usize = 2;
/// Agreement that counts at all, and that of a photo that shows the corner.
const FAINT: f32 = 0.5;
const SHOWN: f32 = 0.72;
/// The same where only one other photo can tell.
const SHOWN_ALONE: f32 = 0.9;
/// A photo's own best place is no further off than this, pixels.
const OFF: f64 = 1.0;
/// Parallax that a point must have in pixels, too: a third of a pixel is a thirtieth of this.
const LEAST_PIXELS: f64 = 10.0;
/// So many places beside the best one the agreement of all is less by this, on the mean: where it is not, patches slide along an edge.
const BESIDE: usize = 3;
const SHARP: f32 = 0.04;
/// Parallax beyond which patches look different, radians.
const WIDEST: f64 = 0.7;
/// Sizes of a patch in two photos differ by less than this (area).
const SIZES: f64 = 3.0;

/// A corner with its depth.
pub(super) struct Estimate {
    pub(super) x: DVec3,
    /// The photo of the corner and its pixel.
    pub(super) photo: usize,
    pub(super) pixel: DVec2,
    /// Other photos that show it, ascending.
    pub(super) seen: Vec<usize>,
    /// Sum of the agreements.
    pub(super) score: f32,
}

/// Depths of all corners with matches, in the order of their groups.
pub(super) fn estimates(
    photos: &[Photo],
    corners: &[Vec<Corner>],
    links: &Links,
    pairs: &[(usize, usize)],
    options: &Options,
) -> Vec<Estimate> {
    let mut partners: Vec<Vec<usize>> = vec![Vec::new(); photos.len()];
    for &(a, b) in pairs {
        partners[a].push(b);
        partners[b].push(a);
    }
    partners.iter_mut().for_each(|p| p.sort_unstable());
    let finder = Finder { photos, corners, links, partners: &partners, options };
    let groups = links.groups();
    let found: Vec<Vec<Estimate>> = groups.par_iter().map(|group| finder.of_group(group)).collect();
    found.into_iter().flatten().collect()
}

struct Finder<'a> {
    photos: &'a [Photo],
    corners: &'a [Vec<Corner>],
    links: &'a Links,
    partners: &'a [Vec<usize>],
    options: &'a Options,
}

/// A photo that may show a patch: how it does, and where along the ray.
struct Witness {
    photo: usize,
    /// Pixel at the depth assumed, and pixels a step.
    x: DVec2,
    motion: DVec2,
    turn: DMat2,
    /// Parallax, radians.
    theta: f64,
    agreement: [f32; 2 * TRIED + 1],
}

impl Finder<'_> {
    /// The points of corners that hang together: mostly one.
    fn of_group(&self, group: &[usize]) -> Vec<Estimate> {
        let mut order: Vec<usize> = group.to_vec();
        order.sort_by_key(|node| (std::cmp::Reverse(self.links.of[*node].len()), *node));
        let mut out: Vec<Estimate> = Vec::new();
        for node in order {
            let (photo, corner) = self.links.corner(node);
            let x = self.corners[photo][corner].x;
            let known = out.iter().any(|e| {
                e.photo == photo && e.pixel.distance(x) < AGREE
                    || e.seen.binary_search(&photo).is_ok()
                        && self.photos[photo].project(e.x).is_some_and(|at| at.distance(x) < AGREE)
            });
            if !known {
                out.extend(self.of_corner(photo, corner, node));
            }
        }
        out
    }

    fn of_corner(&self, a: usize, corner: usize, node: usize) -> Option<Estimate> {
        let (photo, corner) = (&self.photos[a], &self.corners[a][corner]);
        let t = self.most_agreed(photo, corner, &self.links.of[node])?;
        let fronto = patch(&photo.levels[0], 1.0, corner.x, &DMat2::IDENTITY)?;
        let mut t = t;
        for _ in 0..=MOVES {
            let mut witnesses = self.witnesses(a, corner, t);
            let step = set_steps(&mut witnesses)?;
            witnesses.iter_mut().for_each(|w| w.compare(&self.photos[w.photo], &fronto));
            let place = best_place(&witnesses);
            let moved = |place: f64| 1.0 / (1.0 / t + place * step);
            if place.abs() >= TRIED as f64 {
                t = moved(place);
                if !(t > 0.0 && t.is_finite()) {
                    return None;
                }
                continue;
            }
            let t = moved(place);
            return (t > 0.0 && t.is_finite()).then(|| self.judged(a, corner, t, place, &witnesses)).flatten();
        }
        None
    }

    /// Depth along a corner's ray that most of its matches agree on.
    fn most_agreed(&self, photo: &Photo, corner: &Corner, links: &[(u32, u32)]) -> Option<f64> {
        let other =
            |link: &(u32, u32)| (&self.photos[link.0 as usize], &self.corners[link.0 as usize][link.1 as usize]);
        let depth = |link: &(u32, u32)| {
            let (seen_by, as_) = other(link);
            let t = along_ray(photo.centre(), corner.d, seen_by.centre(), as_.d)?;
            let x = photo.centre() + corner.d * t;
            let agree = |link: &&(u32, u32)| {
                let (seen_by, as_) = other(link);
                seen_by.project(x).is_some_and(|at| at.distance(as_.x) <= AGREE)
            };
            Some((links.iter().filter(agree).count(), corner.d.dot(as_.d).clamp(-1.0, 1.0).acos(), t))
        };
        // Of equal ones the widest angle is the most certain.
        links.iter().filter_map(depth).max_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))).map(|(_, _, t)| t)
    }

    /// Photos that may show the corner if it is at distance `t`.
    fn witnesses(&self, a: usize, corner: &Corner, t: f64) -> Vec<Witness> {
        let photo = &self.photos[a];
        let (o, d) = (photo.centre(), corner.d);
        let x = o + d * t;
        // Sides of a pixel there, square to the ray.
        let size = t / photo.focal();
        let down = photo.camera().pose.r.y_axis;
        let right = down.cross(d).normalize_or_zero();
        let (right, down) = (right * size, d.cross(right) * size);
        let witness = |b: &usize| {
            let other = &self.photos[*b];
            let theta = (o - x).angle_between(other.centre() - x);
            let at = other.project(x)?;
            if theta > WIDEST || !other.holds(at, 1.0) || !other.shows(at) {
                return None;
            }
            let turn = DMat2::from_cols(other.project(x + right)? - at, other.project(x + down)? - at);
            if !(1.0 / SIZES..SIZES).contains(&turn.determinant()) {
                return None;
            }
            // Pixels for a change of the inverse distance by one part.
            let ahead = other.project(o + d * (t * (1.0 + 1e-4)))?;
            let motion = (at - ahead) * 1e4 * t;
            Some(Witness { photo: *b, x: at, motion, turn, theta, agreement: [-1.0; 2 * TRIED + 1] })
        };
        self.partners[a].iter().filter_map(witness).collect()
    }

    /// The point, if enough photos show it at this place of the range.
    fn judged(&self, a: usize, corner: &Corner, t: f64, place: f64, witnesses: &[Witness]) -> Option<Estimate> {
        let middle = (place.round() + TRIED as f64) as usize;
        let shown = |w: &&Witness| {
            let own =
                (0..w.agreement.len()).max_by(|i, j| w.agreement[*i].total_cmp(&w.agreement[*j])).unwrap_or(middle);
            let off = (own as f64 - TRIED as f64 - place).abs() * w.motion.length();
            w.agreement[middle] >= SHOWN && off <= OFF
        };
        let shown: Vec<&Witness> = witnesses.iter().filter(shown).collect();
        let widest = shown.iter().map(|w| w.theta).fold(0.0, f64::max);
        let wide = widest >= self.options.least_angle && widest * self.photos[a].focal() >= LEAST_PIXELS;
        let score: f32 = shown.iter().map(|w| w.agreement[middle]).sum();
        let enough = match (shown.len(), witnesses.len()) {
            (1, 1) => score >= SHOWN_ALONE,
            (n, _) => n >= 2,
        };
        (enough && wide && is_sharp(&shown, middle)).then(|| Estimate {
            x: self.photos[a].centre() + corner.d * t,
            photo: a,
            pixel: corner.x,
            seen: shown.iter().map(|w| w.photo).collect(),
            score,
        })
    }
}

/// Whether the agreement falls off to both sides.
fn is_sharp(shown: &[&Witness], middle: usize) -> bool {
    let mean = |k: usize| shown.iter().map(|w| w.agreement[k]).sum::<f32>() / shown.len() as f32;
    let last = 2 * TRIED;
    [middle.saturating_sub(BESIDE), (middle + BESIDE).min(last)].iter().all(|k| mean(*k) <= mean(middle) - SHARP)
}

/// Change of the inverse distance for a step, so that no photo's place moves by more than [`APART`]; motions become those of a step.
/// `None` where nothing moves.
fn set_steps(witnesses: &mut [Witness]) -> Option<f64> {
    let fastest = witnesses.iter().map(|w| w.motion.length()).fold(0.0, f64::max);
    let step = APART / fastest;
    witnesses.iter_mut().for_each(|w| w.motion *= step);
    (fastest > 0.0 && step.is_finite() && step > 0.0).then_some(step)
}

impl Witness {
    /// Compare at all places of the range.
    fn compare(&mut self, photo: &Photo, with: &Patch) {
        for (k, agreement) in self.agreement.iter_mut().enumerate() {
            let x = self.x + self.motion * (k as f64 - TRIED as f64);
            *agreement = patch(&photo.levels[0], 1.0, x, &self.turn).map_or(-1.0, |p| ncc(&p, with));
        }
    }
}

/// The place with the most agreement, between the places tried where it is not at an end.
fn best_place(witnesses: &[Witness]) -> f64 {
    let sum = |k: usize| witnesses.iter().map(|w| (w.agreement[k] - FAINT).max(0.0)).sum::<f32>();
    let sums: Vec<f64> = (0..=2 * TRIED).map(|k| f64::from(sum(k))).collect();
    let best = (0..sums.len()).max_by(|i, j| sums[*i].total_cmp(&sums[*j]).then(j.cmp(i))).unwrap_or(TRIED);
    let place = best as f64 - TRIED as f64;
    if best == 0 || best == 2 * TRIED {
        return place;
    }
    let (a, b, c) = (sums[best - 1], sums[best], sums[best + 1]);
    let bend = a - 2.0 * b + c;
    if bend < 0.0 { place + (0.5 * (a - c) / bend).clamp(-0.5, 0.5) } else { place }
}
