//! What a set of cameras has in common: mean pose, up, the point all look at; and the similarities that bring a scene
//! into a frame of its own.

use float_core::m64;
use glam::{DMat3, DVec3};

use crate::pose::{Pose, Similarity};

/// Below this, relative to its terms, a sum of unit vectors has no direction.
const BALANCED: f64 = 1e-6;
/// Determinant of the mean of `I - d d^T` below which all axes count as parallel (a spread of about 1e-4 rad).
const PARALLEL: f64 = 1e-8;

/// Mean of the camera centres; `None` without cameras.
#[must_use]
pub fn mean_centre(poses: &[Pose]) -> Option<DVec3> {
    let sum: DVec3 = poses.iter().map(|p| p.c).sum();
    (!poses.is_empty()).then(|| sum / poses.len() as f64)
}

/// Mean up direction (the images' `-y`), unit; `None` without cameras, or when the directions cancel.
#[must_use]
pub fn mean_up(poses: &[Pose]) -> Option<DVec3> {
    let sum: DVec3 = poses.iter().map(|p| -p.r.y_axis).sum();
    (sum.length() > BALANCED * poses.len() as f64).then(|| sum.normalize())
}

/// The pose in the middle: mean centre, mean viewing direction, mean up.
///
/// `None` without cameras, and where there is no such thing: viewing directions that cancel (a full circle), or an up
/// direction parallel to them.
///
/// Source: Mildenhall et al., "Local Light Field Fusion", 2019 (released code).
#[must_use]
pub fn mean_pose(poses: &[Pose]) -> Option<Pose> {
    let c = mean_centre(poses)?;
    let n = poses.len() as f64;
    let forward: DVec3 = poses.iter().map(|p| p.r.z_axis).sum();
    let down: DVec3 = poses.iter().map(|p| p.r.y_axis).sum();
    let across = down.cross(forward);
    if forward.length() <= BALANCED * n || across.length() <= BALANCED * n * forward.length() {
        return None;
    }
    let (right, forward) = (across.normalize(), forward.normalize());
    Some(Pose { r: DMat3::from_cols(right, forward.cross(right), forward), c })
}

/// The point nearest to all optical axes, least squares: what an inward-facing capture looks at.
///
/// Minimises `sum |(I - d d^T)(p - c)|^2`. `None` without cameras and when all axes are parallel.
#[must_use]
pub fn focus_point(poses: &[Pose]) -> Option<DVec3> {
    let origin = mean_centre(poses)?; // around it: worlds far from zero keep their digits
    let (mut a, mut b) = (DMat3::ZERO, DVec3::ZERO);
    for pose in poses {
        let d = pose.r.z_axis;
        let across = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        a += across;
        b += across * (pose.c - origin);
    }
    let n = poses.len() as f64;
    let (a, b) = (a * (1.0 / n), b / n);
    if a.determinant() < PARALLEL {
        return None;
    }
    let p = origin + a.inverse() * b;
    p.is_finite().then_some(p)
}

/// Root mean square distance of the cameras from a point; 0 without cameras.
#[must_use]
pub fn rms_distance(poses: &[Pose], point: DVec3) -> f64 {
    if poses.is_empty() {
        return 0.0;
    }
    let sum: f64 = poses.iter().map(|p| (p.c - point).length_squared()).sum();
    m64::sqrt(sum / poses.len() as f64)
}

/// The motion that brings the mean pose to the identity, for forward-facing scenes. No scale.
///
/// `None` where [`mean_pose`] has none.
#[must_use]
pub fn recentre(poses: &[Pose]) -> Option<Similarity> {
    let inverse = mean_pose(poses)?.inverse();
    Some(Similarity { scale: 1.0, r: inverse.r, t: inverse.c })
}

/// The similarity that brings [`focus_point`] to the origin, the mean up to `+z`, and the cameras to an RMS distance of
/// 1, for inward-facing scenes.
///
/// Where there is no mean up the world is not turned. `None` where there is no focus point, or all cameras stand in it.
#[must_use]
pub fn spherify(poses: &[Pose]) -> Option<Similarity> {
    let focus = focus_point(poses)?;
    let distance = rms_distance(poses, focus);
    if distance <= 0.0 || !distance.is_finite() {
        return None;
    }
    let r = mean_up(poses).map_or(DMat3::IDENTITY, |up| {
        let x = up.any_orthonormal_vector();
        DMat3::from_cols(x, up.cross(x), up).transpose()
    });
    let scale = 1.0 / distance;
    Some(Similarity { scale, r, t: -(r * focus) * scale })
}
