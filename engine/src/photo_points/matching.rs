//! Corners of two photos that look alike and lie in one plane with both cameras.

use super::corners::corners;
use super::patch::{Patch, SAMPLES, patch};
use super::photo::Photo;
use glam::{DMat2, DVec2, DVec3};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Numbers of a code: a patch of each level.
const CODE: usize = 2 * SAMPLES;
/// A code's number of 1; larger ones than 127 are cut.
const CODE_UNIT: f32 = 400.0;
/// Corners lie in a plane where they are off it by this much at most, pixels: their own places are whole pixels.
const OFF_PLANE: f64 = 1.5;
/// Corners this close to the other camera are in all planes (sine of the angle).
const EPIPOLE: f64 = 0.05;
/// Largest parallax that is searched, radians: rays may part a little, and patches of greater parallax are not alike.
const PARALLAX: [f64; 2] = [-0.002, 0.7];
/// How alike two corners must be, and how much more so than any other pair that is this far away in pixels: the share of what is
/// missing to 1.
const ALIKE: f32 = 0.70;
const CLEARLY: f32 = 0.85;
const ELSEWHERE: f64 = 3.0;
/// Photos turned against each other by less than this are compared as they are (Frobenius norm of the difference to 1).
const UPRIGHT: f64 = 0.25;

/// A corner and what it looks like.
pub(super) struct Corner {
    /// Pixel.
    pub(super) x: DVec2,
    /// Unit direction in the world.
    pub(super) d: DVec3,
    code: [i8; CODE],
}

/// Two corners, one of each photo of a pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Match {
    pub(super) i: u32,
    pub(super) j: u32,
    /// Angle between the rays, radians.
    pub(super) theta: f64,
}

/// Which corners were matched with which.
pub(super) struct Links {
    /// The number of a photo's first corner; one entry more than photos.
    pub(super) first: Vec<usize>,
    /// For each corner of all photos the photo and corner matched with it, in the order of pairs.
    pub(super) of: Vec<Vec<(u32, u32)>>,
}

/// Corners of a photo, best first.
pub(super) fn describe(photo: &Photo, most: usize) -> Vec<Corner> {
    let describe = |x: DVec2| {
        let d = photo.direction(x)?;
        Some(Corner { x, d, code: code(photo, x, &DMat2::IDENTITY)? })
    };
    corners(photo, most).into_iter().filter_map(describe).collect()
}

fn code(photo: &Photo, x: DVec2, turn: &DMat2) -> Option<[i8; CODE]> {
    let fine = patch(&photo.levels[0], 1.0, x, turn)?;
    let coarse = patch(&photo.levels[1], 0.5, x, turn)?;
    let mut out = [0_i8; CODE];
    let put = |to: &mut [i8], from: &Patch| {
        to.iter_mut().zip(from).for_each(|(to, v)| *to = (v * CODE_UNIT).clamp(-127.0, 127.0) as i8);
    };
    put(&mut out[..SAMPLES], &fine);
    put(&mut out[SAMPLES..], &coarse);
    Some(out)
}

/// Mean correlation of the two levels.
fn alike(a: &[i8; CODE], b: &[i8; CODE]) -> f32 {
    let dot: i32 = a.iter().zip(b).map(|(a, b)| i32::from(i16::from(*a) * i16::from(*b))).sum();
    dot as f32 * (0.5 / (CODE_UNIT * CODE_UNIT))
}

/// Pixels of `b` for a pixel of `a` at what is far away in the middle of `a`: turn and size. `None` where `b` does not see that
/// way.
pub(super) fn turn_between(a: &Photo, b: &Photo) -> Option<DMat2> {
    let middle = DVec2::new(0.5 * f64::from(a.camera().width), 0.5 * f64::from(a.camera().height));
    turn_at(a, b, middle)
}

fn turn_at(a: &Photo, b: &Photo, x: DVec2) -> Option<DMat2> {
    // Far enough away that where the cameras stand makes no difference.
    let far = 1e6 * (a.centre().distance(b.centre()) + f64::MIN_POSITIVE);
    let to = |x: DVec2| b.project(b.centre() + a.direction(x)? * far);
    let here = to(x)?;
    let turn = DMat2::from_cols(to(x + DVec2::X)? - here, to(x + DVec2::Y)? - here);
    (turn.is_finite() && turn.determinant() > 1e-3).then_some(turn)
}

/// A corner's best, and the best of those elsewhere.
#[derive(Clone, Copy)]
struct Best {
    with: u32,
    score: f32,
    second: f32,
}

impl Best {
    const NONE: Self = Self { with: u32::MAX, score: -1.0, second: -1.0 };

    fn offer(&mut self, with: usize, score: f32, corners: &[Corner]) {
        let elsewhere = || self.with == u32::MAX || corners[self.with as usize].x.distance(corners[with].x) > ELSEWHERE;
        if score > self.score {
            if elsewhere() {
                self.second = self.score;
            }
            (self.with, self.score) = (with as u32, score);
        } else if score > self.second && elsewhere() {
            self.second = score;
        }
    }

    fn is_clear(&self) -> bool {
        self.score >= ALIKE && 1.0 - self.score <= CLEARLY * (1.0 - self.second)
    }
}

/// Corners `of_a` and `of_b` of two photos that are each other's best, ascending by the first.
pub(super) fn matches(a: &Photo, b: &Photo, of_a: &[Corner], of_b: &[Corner]) -> Vec<Match> {
    let baseline = b.centre() - a.centre();
    let Some(axis) = baseline.try_normalize() else { return Vec::new() };
    // Planes are counted from the one that the cameras look along, so that few lie where the count wraps round.
    let ahead = a.camera().optical_axis() + b.camera().optical_axis();
    let zero = (ahead - axis * ahead.dot(axis)).try_normalize().unwrap_or_else(|| axis.any_orthonormal_vector());
    let quarter = axis.cross(zero);
    let angles = |d: &DVec3| {
        let (along, u, v) = (d.dot(axis), d.dot(zero), d.dot(quarter));
        let sine = u.hypot(v);
        (v.atan2(u), sine.atan2(along), sine)
    };
    let off_plane = OFF_PLANE / a.focal().min(b.focal());
    let mut planes: Vec<(f64, f64, usize)> = Vec::with_capacity(of_b.len() + 16);
    for (j, corner) in of_b.iter().enumerate() {
        let (phi, along, sine) = angles(&corner.d);
        if sine < EPIPOLE {
            continue;
        }
        planes.push((phi, along, j));
        // As wide as any window is.
        let wrap = off_plane / EPIPOLE;
        if phi > PI - wrap {
            planes.push((phi - 2.0 * PI, along, j));
        } else if phi < wrap - PI {
            planes.push((phi + 2.0 * PI, along, j));
        }
    }
    planes.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.2.cmp(&b.2)));
    let turn = turn_between(a, b);
    let turned = turn.filter(|t| {
        let off = *t - DMat2::IDENTITY;
        off.x_axis.length_squared() + off.y_axis.length_squared() > UPRIGHT * UPRIGHT
    });
    let mut best_a = vec![Best::NONE; of_a.len()];
    let mut best_b = vec![Best::NONE; of_b.len()];
    let mut theta = vec![0.0; of_a.len()];
    for (i, corner) in of_a.iter().enumerate() {
        let (phi, along, sine) = angles(&corner.d);
        if sine < EPIPOLE {
            continue;
        }
        let window = off_plane / sine;
        let from = planes.partition_point(|p| p.0 < phi - window);
        let within = planes[from..].iter().take_while(|p| p.0 <= phi + window);
        let mut candidates = within.filter(|p| (PARALLAX[0]..PARALLAX[1]).contains(&(p.1 - along))).peekable();
        if candidates.peek().is_none() {
            continue;
        }
        // As `b` would show it.
        let again = turned.map(|_| turn_at(a, b, corner.x).and_then(|turn| code(a, corner.x, &turn.inverse())));
        let code = match &again {
            None => &corner.code,
            Some(Some(code)) => code,
            Some(None) => continue,
        };
        for (_, there, j) in candidates {
            let score = alike(code, &of_b[*j].code);
            let was = best_a[i].with;
            best_a[i].offer(*j, score, of_b);
            if best_a[i].with != was {
                theta[i] = there - along;
            }
            best_b[*j].offer(i, score, of_a);
        }
    }
    let mutual = |(i, best): (usize, &Best)| {
        let back = best_b.get(best.with as usize)?;
        (best.is_clear() && back.is_clear() && back.with as usize == i).then(|| Match {
            i: i as u32,
            j: best.with,
            theta: theta[i],
        })
    };
    best_a.iter().enumerate().filter_map(mutual).collect()
}

impl Links {
    /// Matches of all `pairs`.
    pub(super) fn new(photos: &[Photo], corners: &[Vec<Corner>], pairs: &[(usize, usize)]) -> Self {
        let mut first = vec![0];
        first.extend(corners.iter().scan(0, |sum, corners| {
            *sum += corners.len();
            Some(*sum)
        }));
        let mut of = vec![Vec::new(); first[corners.len()]];
        let found: Vec<Vec<Match>> =
            pairs.par_iter().map(|&(a, b)| matches(&photos[a], &photos[b], &corners[a], &corners[b])).collect();
        for (&(a, b), found) in pairs.iter().zip(&found) {
            for m in found {
                of[first[a] + m.i as usize].push((b as u32, m.j));
                of[first[b] + m.j as usize].push((a as u32, m.i));
            }
        }
        Self { first, of }
    }

    /// Photo and number in it of a corner.
    pub(super) fn corner(&self, node: usize) -> (usize, usize) {
        let photo = self.first.partition_point(|first| *first <= node) - 1;
        (photo, node - self.first[photo])
    }

    fn node(&self, photo: u32, corner: u32) -> usize {
        self.first[photo as usize] + corner as usize
    }

    /// Corners that hang together, each group ascending, in the order of their first; corners without a match are left out.
    pub(super) fn groups(&self) -> Vec<Vec<usize>> {
        let mut parent: Vec<usize> = (0..self.of.len()).collect();
        fn root(parent: &mut [usize], mut node: usize) -> usize {
            while parent[node] != node {
                parent[node] = parent[parent[node]];
                node = parent[node];
            }
            node
        }
        for node in 0..self.of.len() {
            for &(photo, corner) in &self.of[node] {
                let (a, b) = (root(&mut parent, node), root(&mut parent, self.node(photo, corner)));
                // The smaller number leads.
                parent[a.max(b)] = a.min(b);
            }
        }
        let mut groups: Vec<Vec<usize>> = Vec::new();
        let mut of_root = vec![usize::MAX; self.of.len()];
        for node in (0..self.of.len()).filter(|node| !self.of[*node].is_empty()) {
            let root = root(&mut parent, node);
            if of_root[root] == usize::MAX {
                of_root[root] = groups.len();
                groups.push(Vec::new());
            }
            groups[of_root[root]].push(node);
        }
        groups
    }
}
