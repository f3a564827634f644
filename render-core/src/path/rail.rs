//! A smooth curve along given poses, travelled at constant speed.

use alloc::vec::Vec;
use float_core::m64;
use glam::{DMat3, DQuat, DVec3, DVec4};

use super::{Ends, order::pose_distance, through};
use crate::pose::Pose;

/// Poses that the curve is kept as.
const POSES: usize = 600;
/// Reach of the smoothing in standard deviations.
const REACH: f64 = 3.0;

/// A curve of cameras, smoothed, with its length in the measure of [`pose_distance`].
#[derive(Clone, Debug, PartialEq)]
pub struct Rail {
    poses: Vec<Pose>,
    /// Length up to each pose, and around to the first again for a closed rail.
    at: Vec<f64>,
    ends: Ends,
    scale: f64,
}

impl Rail {
    /// The spline through `keys`, averaged along its length with weights of standard deviation `width` (in the measure of
    /// [`pose_distance`], as `scale` is): the wider, the calmer, and the farther from the keys.
    ///
    /// `None` without keys, where one is not finite, or where `scale` is not positive.
    #[must_use]
    pub fn new(keys: &[Pose], ends: Ends, scale: f64, width: f64) -> Option<Self> {
        let finite = |key: &Pose| key.c.is_finite() && key.r.is_finite();
        if keys.is_empty() || !keys.iter().all(finite) || scale <= 0.0 || !scale.is_finite() {
            return None;
        }
        // Even in length first: the mean over a stretch shall not depend on how many keys are there.
        let even = Self::along(through(keys, POSES, ends), ends, scale).poses(POSES);
        let rough = Self::along(even, ends, scale);
        let calm = rough.smoothed(width.max(0.0));
        Some(Self::along(calm, ends, scale))
    }

    fn along(poses: Vec<Pose>, ends: Ends, scale: f64) -> Self {
        let mut at = Vec::with_capacity(poses.len() + 1);
        at.push(0.0);
        let last = match ends {
            Ends::Open => None,
            Ends::Closed => poses.last().zip(poses.first()),
        };
        let pairs = poses.windows(2).map(|w| (&w[0], &w[1])).chain(last);
        let mut sum = 0.0;
        for (a, b) in pairs {
            sum += pose_distance(a, b, scale);
            at.push(sum);
        }
        Self { poses, at, ends, scale }
    }

    /// Its length.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.at.last().copied().unwrap_or(0.0)
    }

    /// Whether it comes back to its start.
    #[must_use]
    pub fn ends(&self) -> Ends {
        self.ends
    }

    /// The pose at a length from the start; a closed rail goes round, an open one stops at its ends.
    #[must_use]
    pub fn pose(&self, at: f64) -> Pose {
        let length = self.length();
        let at = match self.ends {
            Ends::Closed if length > 0.0 => at - length * m64::floor(at / length),
            // Not `clamp`: a way too long to be a number has no upper end.
            _ => at.max(0.0).min(length),
        };
        let i = self.at.partition_point(|x| *x <= at).saturating_sub(1).min(self.poses.len() - 1);
        let (a, b) = (&self.poses[i], &self.poses[(i + 1) % self.poses.len()]);
        let Some(next) = self.at.get(i + 1).filter(|next| **next > self.at[i]) else { return *a };
        let u = (at - self.at[i]) / (next - self.at[i]);
        let r = DQuat::from_mat3(&a.r).slerp(DQuat::from_mat3(&b.r), u).normalize();
        Pose { r: DMat3::from_quat(r), c: a.c.lerp(b.c, u) }
    }

    /// Length at frame `i` of `n`: evenly from end to end, or once around.
    #[must_use]
    pub fn place(&self, i: usize, n: usize) -> f64 {
        let steps = match self.ends {
            Ends::Open => n.saturating_sub(1).max(1),
            Ends::Closed => n.max(1),
        };
        self.length() * i as f64 / steps as f64
    }

    /// `n` poses at constant speed.
    ///
    /// # Panics
    /// If there is no memory for `n` poses.
    #[must_use]
    pub fn poses(&self, n: usize) -> Vec<Pose> {
        (0..n).map(|i| self.pose(self.place(i, n))).collect()
    }

    /// The part between two lengths, open; beyond the end of a closed rail it goes on at its start.
    #[must_use]
    pub fn part(&self, from: f64, to: f64) -> Self {
        let n = self.poses.len();
        let last = n.saturating_sub(1).max(1) as f64;
        let poses = (0..n).map(|i| self.pose(from + (to - from) * i as f64 / last)).collect();
        Self::along(poses, Ends::Open, self.scale)
    }

    /// Local linear regression over the poses within reach, so that an end stays where it is and the speed up to it.
    fn smoothed(&self, width: f64) -> Vec<Pose> {
        let n = self.poses.len();
        let gap = self.length() / n as f64;
        let reach = if gap > 0.0 { ((REACH * width / gap) as usize).min(n / 2) } else { 0 };
        if reach == 0 {
            return self.poses.clone();
        }
        let turns: Vec<DVec4> = self.poses.iter().map(|p| DVec4::from(DQuat::from_mat3(&p.r))).collect();
        let smooth = |i: usize| {
            let (low, high) = match self.ends {
                Ends::Open => (i.saturating_sub(reach) as isize, (i + reach).min(n - 1) as isize),
                Ends::Closed => (i as isize - reach as isize, (i + reach) as isize),
            };
            let (mut s0, mut s1, mut s2) = (0.0, 0.0, 0.0);
            let (mut c0, mut c1, mut q0, mut q1) = (DVec3::ZERO, DVec3::ZERO, DVec4::ZERO, DVec4::ZERO);
            for j in low..=high {
                let k = j.rem_euclid(n as isize) as usize;
                let x = (j - i as isize) as f64 * gap / width;
                let w = m64::exp(-0.5 * x * x);
                // Two quaternions are one rotation; the nearer one is meant.
                let q = if turns[k].dot(turns[i]) < 0.0 { -turns[k] } else { turns[k] };
                (s0, s1, s2) = (s0 + w, s1 + w * x, s2 + w * x * x);
                (c0, c1) = (c0 + self.poses[k].c * w, c1 + self.poses[k].c * (w * x));
                (q0, q1) = (q0 + q * w, q1 + q * (w * x));
            }
            let bottom = s0 * s2 - s1 * s1;
            let (c, q) = if bottom > 1e-12 * s0 * s2 {
                ((c0 * s2 - c1 * s1) / bottom, (q0 * s2 - q1 * s1) / bottom)
            } else {
                (c0 / s0, q0 / s0)
            };
            let q = if q.length_squared() > 1e-12 { q.normalize() } else { turns[i] };
            Pose { r: DMat3::from_quat(DQuat::from_vec4(q)), c }
        };
        (0..n).map(smooth).collect()
    }
}
