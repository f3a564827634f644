//! A spline through given poses.

use alloc::vec::Vec;
use glam::DQuat;

use crate::pose::Pose;

/// Whether a path comes back to its first pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ends {
    /// From the first pose to the last, both included.
    Open,
    /// Around: after the last pose comes the first again.
    Closed,
}

/// `n` poses on a smooth curve through `keys`, evenly spaced in the parameter (equally many between two keys).
///
/// Centres follow a Catmull-Rom spline, rotations the shortest arc. Empty when `keys` is.
///
/// # Panics
/// If there is no memory for `n` poses.
#[must_use]
pub fn through(keys: &[Pose], n: usize, ends: Ends) -> Vec<Pose> {
    let k = keys.len();
    if k == 0 {
        return Vec::new();
    }
    let spans = match ends {
        Ends::Open => k - 1,
        Ends::Closed => k,
    };
    // An open path shows its last key in its last frame, a closed one stops a step before.
    let steps = match ends {
        Ends::Open => n.saturating_sub(1).max(1),
        Ends::Closed => n,
    };
    let key = |i: isize| match ends {
        Ends::Open => &keys[i.clamp(0, k as isize - 1) as usize],
        Ends::Closed => &keys[i.rem_euclid(k as isize) as usize],
    };
    let pose = |frame: usize| {
        let at = spans as f64 * frame as f64 / steps as f64;
        let span = (at as usize).min(spans.saturating_sub(1));
        let (u, i) = (at - span as f64, span as isize);
        let [a, b, c, d] = [key(i - 1).c, key(i).c, key(i + 1).c, key(i + 2).c];
        // Catmull-Rom: tangents are half the chord between the neighbours.
        let centre = b
            + (c - a) * (0.5 * u)
            + (a * 2.0 - b * 5.0 + c * 4.0 - d) * (0.5 * u * u)
            + ((b - c) * 3.0 + d - a) * (0.5 * u * u * u);
        let (from, to) = (DQuat::from_mat3(&key(i).r), DQuat::from_mat3(&key(i + 1).r));
        Pose { r: glam::DMat3::from_quat(from.slerp(to, u).normalize()), c: centre }
    };
    (0..n).map(pose).collect()
}
