//! Which photos are compared: those that show the same from an angle that tells depth.
//!
//! How far away things are is not known at first. So a few corners of each photo are matched with photos whose cameras stand near
//! and farther; where two of those agree on a depth, it is believed, and angles follow.

use super::matching::{Corner, Match, matches};
use super::photo::Photo;
use super::triangulate::along_ray;
use glam::DVec3;
use rayon::prelude::*;

/// Places, in the order of distance, of the photos that a photo is first matched with.
const FIRST: [usize; 8] = [0, 1, 2, 4, 7, 11, 17, 26];
/// Optical axes further apart than this (cosine) see different things.
const SAME_WAY: f64 = 0.55;
/// Corners of a photo in the first round.
const FEW: usize = 400;
/// Depths agree within this share.
const AGREE: f64 = 0.1;
/// A photo's depths: no more than this many are used, fewer say nothing.
const DEPTHS: usize = 64;
const LEAST_DEPTHS: usize = 6;
/// Parallax in the first round, radians: less says nothing about depth.
const LEAST_THETA: f64 = 0.01;
/// The best parallax, radians, and how fast smaller and greater ones lose.
const BEST: f64 = 0.16;
const SMALLER: f64 = 0.07;
const GREATER: f64 = 0.14;

/// Pairs of photos to match, `(smaller, larger)`, ascending.
pub(super) fn choose(photos: &[Photo], corners: &[Vec<Corner>], most: usize) -> Vec<(usize, usize)> {
    let near: Vec<Vec<usize>> = (0..photos.len()).into_par_iter().map(|a| first_round(photos, a)).collect();
    let pairs = united(&near);
    let found: Vec<Vec<Match>> = pairs
        .par_iter()
        .map(|&(a, b)| {
            let few = &corners[a][..corners[a].len().min(FEW)];
            matches(&photos[a], &photos[b], few, &corners[b])
        })
        .collect();
    let mut depths: Vec<Vec<(u32, f64)>> = vec![Vec::new(); photos.len()];
    for (&(a, b), found) in pairs.iter().zip(&found) {
        for m in found.iter().filter(|m| m.theta >= LEAST_THETA) {
            let (from, to) = (&corners[a][m.i as usize], &corners[b][m.j as usize]);
            let (o, p) = (photos[a].centre(), photos[b].centre());
            if let (Some(t), Some(s)) = (along_ray(o, from.d, p, to.d), along_ray(p, to.d, o, from.d)) {
                depths[a].push((m.i, t));
                depths[b].push((m.j, s));
            }
        }
    }
    let known: Vec<Vec<DVec3>> = depths
        .par_iter_mut()
        .enumerate()
        .map(|(a, depths)| {
            believed(depths).iter().map(|(i, t)| photos[a].centre() + corners[a][*i as usize].d * *t).collect()
        })
        .collect();
    let chosen = (0..photos.len()).into_par_iter().map(|a| {
        if known[a].len() < LEAST_DEPTHS {
            return near[a].iter().copied().take(most).collect();
        }
        best_for(photos, a, &known[a], most)
    });
    united(&chosen.collect::<Vec<_>>())
}

/// Photos near a photo and farther off, that look the same way.
fn first_round(photos: &[Photo], a: usize) -> Vec<usize> {
    let (o, axis) = (photos[a].centre(), photos[a].camera().optical_axis());
    let mut others: Vec<(f64, usize)> = (0..photos.len())
        .filter(|b| *b != a && photos[*b].camera().optical_axis().dot(axis) >= SAME_WAY)
        .map(|b| (photos[b].centre().distance(o), b))
        .filter(|(distance, _)| *distance > 0.0 && distance.is_finite())
        .collect();
    others.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    FIRST.iter().filter_map(|place| others.get(*place)).map(|(_, b)| *b).collect()
}

/// Depths of corners on which two matches agree, spread over the photo's.
fn believed(depths: &mut [(u32, f64)]) -> Vec<(u32, f64)> {
    depths.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let mut agreed: Vec<(u32, f64)> = Vec::new();
    for of_corner in depths.chunk_by(|a, b| a.0 == b.0) {
        let close = of_corner.windows(2).find(|w| w[1].1 - w[0].1 <= AGREE * w[1].1);
        agreed.extend(close.map(|w| w[0]));
    }
    if agreed.len() < LEAST_DEPTHS {
        // Two photos are all there is: the middle half is right more often than not.
        let mut all: Vec<(u32, f64)> = depths.to_vec();
        all.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
        agreed = all[all.len() / 4..all.len() - all.len() / 4].to_vec();
    }
    let count = agreed.len().min(DEPTHS);
    (0..count).map(|k| agreed[k * agreed.len() / count]).collect()
}

/// The photos that see the most of these points at a good angle.
fn best_for(photos: &[Photo], a: usize, points: &[DVec3], most: usize) -> Vec<usize> {
    let o = photos[a].centre();
    let score = |b: usize| -> f64 {
        let p = photos[b].centre();
        let of = |x: &DVec3| {
            let at = photos[b].project(*x)?;
            let (to_a, to_b) = (o - *x, p - *x);
            let size = to_a.length() / to_b.length();
            let off = to_a.angle_between(to_b) - BEST;
            let width = if off < 0.0 { SMALLER } else { GREATER };
            photos[b].holds(at, 0.0).then(|| (-0.5 * (off / width).powi(2)).exp() * size.min(1.0 / size))
        };
        points.iter().filter_map(of).sum()
    };
    let mut others: Vec<(f64, usize)> = (0..photos.len()).filter(|b| *b != a).map(|b| (score(b), b)).collect();
    // Of next to nothing there is nothing to match.
    others.retain(|(score, _)| *score > 0.01 * points.len() as f64);
    others.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    others.into_iter().take(most).map(|(_, b)| b).collect()
}

/// Each pair once.
fn united(of: &[Vec<usize>]) -> Vec<(usize, usize)> {
    let both = of.iter().enumerate().flat_map(|(a, of)| of.iter().map(move |b| (a.min(*b), a.max(*b))));
    let mut pairs: Vec<(usize, usize)> = both.collect();
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}
