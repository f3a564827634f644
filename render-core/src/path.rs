//! Camera paths for rendering: orbit, spiral, and through given poses.

use alloc::vec::Vec;
use core::f64::consts::TAU;
use float_core::m64;
use glam::{DQuat, DVec3};

use crate::{
    bounds::percentile,
    pose::Pose,
    rig::{focus_point, mean_pose, mean_up},
};

/// A circle around a point, looking at it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orbit {
    /// Point looked at.
    pub centre: DVec3,
    /// Axis of the circle, unit; up in the pictures.
    pub up: DVec3,
    /// Direction from the axis to the first camera, unit, at a right angle to `up`.
    pub start: DVec3,
    /// Radius of the circle, world units.
    pub radius: f64,
    /// Height of the circle above `centre`, along `up`, world units.
    pub height: f64,
}

impl Orbit {
    /// The circle nearest to where a set of cameras stands: around what they look at, at their mean distance from the
    /// axis and mean height, starting at the first camera.
    ///
    /// `None` without cameras, with parallel optical axes, or when no direction is up.
    #[must_use]
    pub fn fit(poses: &[Pose]) -> Option<Self> {
        let (centre, up) = (focus_point(poses)?, mean_up(poses)?);
        let n = poses.len() as f64;
        let height = poses.iter().map(|p| (p.c - centre).dot(up)).sum::<f64>() / n;
        let radius = poses.iter().map(|p| (p.c - centre).reject_from_normalized(up).length()).sum::<f64>() / n;
        let first = (poses[0].c - centre).reject_from_normalized(up);
        let start = first.try_normalize().unwrap_or_else(|| up.any_orthonormal_vector());
        Some(Self { centre, up, start, radius, height })
    }

    /// `n` poses, once around; the one after the last is the first again. Counter-clockwise seen from above.
    ///
    /// Empty when the circle has no size at all, since there is no direction to look into.
    #[must_use]
    pub fn poses(&self, n: usize) -> Vec<Pose> {
        let side = self.up.cross(self.start);
        let pose = |i: usize| {
            let (sin, cos) = m64::sin_cos(TAU * i as f64 / n as f64);
            let eye = self.centre + self.up * self.height + (self.start * cos + side * sin) * self.radius;
            Pose::look_at(eye, self.centre, self.up)
        };
        (0..n).filter_map(pose).collect()
    }
}

/// A spiral before a forward-facing scene, looking at a point inside of it.
///
/// Source: Mildenhall et al., "Local Light Field Fusion", 2019 (released code).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spiral {
    /// Pose in the middle of the spiral.
    pub frame: Pose,
    /// Up in the pictures, unit.
    pub up: DVec3,
    /// Half extent along the axes of `frame`, world units.
    pub radii: DVec3,
    /// Distance before `frame` of the point looked at, world units.
    pub focus: f64,
    /// Turns in the whole path.
    pub turns: f64,
    /// Periods of the motion along the viewing direction in each turn.
    pub z_rate: f64,
}

impl Spiral {
    /// A spiral that stays among a set of cameras: two turns, reaching the 90th percentile of their distances from the
    /// mean along each axis; its focus is three quarters of the way, in disparity, from `0.9 near` to `5 far`.
    ///
    /// `near` and `far` are z depths, world units, `0 < near <= far`. `None` where [`mean_pose`] has none.
    #[must_use]
    pub fn fit(poses: &[Pose], near: f64, far: f64) -> Option<Self> {
        let (frame, up) = (mean_pose(poses)?, mean_up(poses)?);
        let (close, inf) = (0.9 * near, 5.0 * far);
        let focus = 1.0 / (0.25 / close + 0.75 / inf);
        if focus <= 0.0 || !focus.is_finite() {
            return None;
        }
        let reach = |axis: usize| {
            let mut offsets: Vec<f64> = poses.iter().map(|p| frame.to_camera(p.c)[axis].abs()).collect();
            offsets.sort_unstable_by(f64::total_cmp);
            percentile(&offsets, 0.9).unwrap_or(0.0)
        };
        let radii = DVec3::new(reach(0), reach(1), reach(2));
        Some(Self { frame, up, radii, focus, turns: 2.0, z_rate: 0.5 })
    }

    /// `n` poses along the whole path; the one after the last is the first again when `turns` and `turns * z_rate` are
    /// whole numbers.
    #[must_use]
    pub fn poses(&self, n: usize) -> Vec<Pose> {
        let target = self.frame.to_world(DVec3::Z * self.focus);
        let pose = |i: usize| {
            let angle = TAU * self.turns * i as f64 / n as f64;
            let (sin, cos) = m64::sin_cos(angle);
            let offset = DVec3::new(cos, sin, m64::sin(angle * self.z_rate)) * self.radii;
            Pose::look_at(self.frame.to_world(offset), target, self.up)
        };
        (0..n).filter_map(pose).collect()
    }
}

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
