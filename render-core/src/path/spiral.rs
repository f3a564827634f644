//! A spiral among forward-facing cameras.

use alloc::vec::Vec;
use core::f64::consts::TAU;
use float_core::m64;
use glam::DVec3;

use crate::{
    bounds::percentile,
    pose::Pose,
    rig::{mean_pose, mean_up},
};

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
