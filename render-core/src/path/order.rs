//! Which cameras a path visits, and in which order.
//!
//! The distance of two cameras is that of their centres, in units of the distance to what they see, and the angle
//! between them, in radians, as the sides of a right angle: both move a picture by about as much.

use alloc::vec::Vec;
use core::cmp::Ordering;
use float_core::m64;
use glam::DQuat;

use crate::{bounds::percentile, pose::Pose};

/// A camera is an outlier if its third nearest neighbour is this many times farther than the median.
const OFF: f64 = 4.0;
/// Neighbours in a sequence are nearer than this part of what two cameras of it usually are.
const STEP: f64 = 0.35;
/// Rounds of [`tour`] at most; each makes the way shorter.
const ROUNDS: usize = 100;

/// Distance of two cameras; `scale` is how far away what they look at is, world units, positive.
#[must_use]
pub fn pose_distance(a: &Pose, b: &Pose, scale: f64) -> f64 {
    let turn = DQuat::from_mat3(&a.r).dot(DQuat::from_mat3(&b.r)).abs().min(1.0);
    m64::hypot(a.c.distance(b.c) / scale, 2.0 * m64::acos(turn))
}

/// Length of the way through cameras in the order given.
#[must_use]
pub fn path_length(poses: &[Pose], scale: f64) -> f64 {
    poses.windows(2).map(|w| pose_distance(&w[0], &w[1], scale)).sum()
}

/// Indices of the cameras that are not outliers, those that have others near them, ascending: all of fewer than six.
#[must_use]
pub fn without_outliers(poses: &[Pose], scale: f64) -> Vec<usize> {
    let all = (0..poses.len()).collect();
    if poses.len() < 6 {
        return all;
    }
    let third = |i: usize| {
        let mut away: Vec<f64> = poses.iter().map(|p| pose_distance(&poses[i], p, scale)).collect();
        away.select_nth_unstable_by(3, f64::total_cmp);
        away[3] // the nearest is the camera itself
    };
    let away: Vec<f64> = (0..poses.len()).map(third).collect();
    let mut sorted = away.clone();
    sorted.sort_unstable_by(f64::total_cmp);
    let usual = percentile(&sorted, 0.5).unwrap_or(0.0);
    all.into_iter().filter(|&i| away[i] <= OFF * usual || usual <= 0.0).collect()
}

/// Whether neighbours in the order given are near each other, as frames of a video are.
#[must_use]
pub fn is_sequence(poses: &[Pose], scale: f64) -> bool {
    const PAIRS: usize = 64; // cameras whose pairs are compared
    if poses.len() < 4 {
        return false;
    }
    let few: Vec<&Pose> = poses.iter().step_by(poses.len().div_ceil(PAIRS)).collect();
    let mut pairs: Vec<f64> =
        few.iter().enumerate().flat_map(|(i, a)| few[..i].iter().map(move |b| pose_distance(a, b, scale))).collect();
    let mut steps: Vec<f64> = poses.windows(2).map(|w| pose_distance(&w[0], &w[1], scale)).collect();
    pairs.sort_unstable_by(f64::total_cmp);
    steps.sort_unstable_by(f64::total_cmp);
    let (Some(usual), Some(middle), Some(long)) =
        (percentile(&pairs, 0.5), percentile(&steps, 0.5), percentile(&steps, 0.9))
    else {
        return false;
    };
    middle <= STEP * usual && long <= 2.0 * STEP * usual
}

/// At most `count` cameras that lie as far apart as they can, ascending: first the one nearest to all, then again and again
/// the one farthest from those taken.
#[must_use]
pub fn farthest_points(poses: &[Pose], scale: f64, count: usize) -> Vec<usize> {
    if poses.len() <= count {
        return (0..poses.len()).collect();
    }
    let first_of = |values: &[f64], better: Ordering| {
        (0..values.len()).fold(0, |best, i| if values[i].total_cmp(&values[best]) == better { i } else { best })
    };
    let sums: Vec<f64> = poses.iter().map(|a| poses.iter().map(|b| pose_distance(a, b, scale)).sum()).collect();
    let mut away = alloc::vec![f64::INFINITY; poses.len()];
    let mut taken = Vec::with_capacity(count);
    let mut next = first_of(&sums, Ordering::Less);
    while taken.len() < count {
        taken.push(next);
        for (away, pose) in away.iter_mut().zip(poses) {
            *away = away.min(pose_distance(&poses[next], pose, scale));
        }
        next = first_of(&away, Ordering::Greater);
    }
    taken.sort_unstable();
    taken
}

/// A short way through all cameras: nearest neighbours from the camera that is farthest from the others, then parts turned
/// round while that makes it shorter (2-opt). An open way, and the same for the same input.
#[must_use]
pub fn tour(poses: &[Pose], scale: f64) -> Vec<usize> {
    let n = poses.len();
    let away: Vec<f64> = poses.iter().flat_map(|a| poses.iter().map(move |b| pose_distance(a, b, scale))).collect();
    let away = |i: usize, j: usize| away[i * n + j];
    let sum = |i: usize| (0..n).map(|j| away(i, j)).sum::<f64>();
    let Some(start) = (0..n).reduce(|best, i| if sum(i) > sum(best) { i } else { best }) else { return Vec::new() };
    let mut way = alloc::vec![start];
    let mut left: Vec<usize> = (0..n).filter(|&i| i != start).collect();
    while let Some(k) = (0..left.len()).min_by(|&a, &b| {
        let last = way[way.len() - 1];
        away(last, left[a]).total_cmp(&away(last, left[b]))
    }) {
        way.push(left.remove(k));
    }
    for _ in 0..ROUNDS {
        let mut shorter = false;
        for i in 0..n {
            for j in i + 1..n {
                // Turn `i..=j` round; an open way has no edge before its first and after its last camera.
                let edge = |a: Option<usize>, b: Option<usize>| match (a, b) {
                    (Some(a), Some(b)) => away(a, b),
                    _ => 0.0,
                };
                let (before, after) = (i.checked_sub(1).map(|k| way[k]), way.get(j + 1).copied());
                let (first, last) = (Some(way[i]), Some(way[j]));
                let now = edge(before, first) + edge(last, after);
                if edge(before, last) + edge(first, after) < now - 1e-9 {
                    way[i..=j].reverse();
                    shorter = true;
                }
            }
        }
        if !shorter {
            break;
        }
    }
    way
}
