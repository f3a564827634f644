//! A circle around what a set of cameras looks at.

use alloc::vec::Vec;
use core::f64::consts::TAU;
use float_core::m64;
use glam::DVec3;

use crate::{
    pose::Pose,
    rig::{focus_point, mean_up},
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
