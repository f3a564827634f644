//! What a set of cameras has in common: mean pose, up, the point all look at; and the similarities that bring a scene
//! into a frame of its own.

use alloc::vec::Vec;
use core::f64::consts::TAU;
use float_core::m64;
use glam::{DMat3, DVec3};

use crate::bounds::percentile;
use crate::pose::{Pose, Similarity};
use crate::symmetric::eigen;

/// Below this, relative to its terms, a sum of unit vectors has no direction.
const BALANCED: f64 = 1e-6;
/// Determinant of the mean of `I - d d^T` below which all axes count as parallel (a spread of about 1e-4 rad).
const PARALLEL: f64 = 1e-8;
/// Middle eigenvalue of the mean `x x^T` of the cameras' `x` axes above which they turn about something (8 degrees or more).
const TURNED: f64 = 0.02;
/// Its smallest eigenvalue below which they are level: a roll of 15 degrees, root mean square.
const LEVEL: f64 = 0.067;

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

/// The axis that the cameras stand upright about, unit: the direction most nearly at right angles to all of their `x` axes,
/// pointing to where the images' tops are. Cameras that all look down on a thing have a [`mean_up`] that leans to the middle
/// of their arc; this axis does not.
///
/// Where the `x` axes do not say (a phone held both ways), the normal of a ring of cameras; where they are nearly parallel
/// (cameras that face one way), the mean up at right angles to them. `None` without cameras, and when nothing is up.
#[must_use]
pub fn up_axis(poses: &[Pose]) -> Option<DVec3> {
    let n = poses.len() as f64;
    let (values, axes) = axes(second_moment(poses.iter().map(|p| p.r.x_axis)));
    let axis = if values[1] > TURNED && values[0] < LEVEL && values[0] < 0.25 * values[1] {
        axes[0]
    } else if values[1] <= TURNED {
        let up = mean_up(poses)?;
        return up.reject_from_normalized(axes[2]).try_normalize();
    } else if let Some(normal) = ring_normal(poses) {
        normal
    } else {
        return mean_up(poses);
    };
    let share = |of: fn(&Pose) -> DVec3| poses.iter().map(|p| of(p).dot(axis)).sum::<f64>() / n;
    let upward = share(|p| -p.r.y_axis);
    // Cameras that look straight down have no tops; they are above what they see.
    let way = if upward.abs() > 0.05 { upward } else { -share(|p| p.r.z_axis) };
    axis.is_normalized().then_some(if way < 0.0 { -axis } else { axis })
}

/// Eigenvalues, ascending, and unit eigenvectors of a symmetric matrix.
fn axes(m: DMat3) -> ([f64; 3], [DVec3; 3]) {
    let (values, vectors) = eigen(m.to_cols_array_2d());
    (values, vectors.map(|v| DVec3::from_array(v).normalize_or_zero()))
}

/// Mean of `v v^T`; zero without vectors.
fn second_moment(vectors: impl Iterator<Item = DVec3>) -> DMat3 {
    let (mut sum, mut n) = (DMat3::ZERO, 0.0_f64);
    for v in vectors {
        sum += DMat3::from_cols(v * v.x, v * v.y, v * v.z);
        n += 1.0;
    }
    sum * (1.0 / n.max(1.0))
}

/// Normal of the plane of the camera centres, where they lie in one and go all round; its sign says nothing.
fn ring_normal(poses: &[Pose]) -> Option<DVec3> {
    let middle = mean_centre(poses)?;
    let (values, axes) = axes(second_moment(poses.iter().map(|p| p.c - middle)));
    if values[0] > 0.02 * values[1] || values[1] < 0.2 * values[2] || values[2] <= 0.0 {
        return None;
    }
    let mut angles: Vec<f64> =
        poses.iter().map(|p| p.c - middle).map(|v| m64::atan2(v.dot(axes[2]), v.dot(axes[1]))).collect();
    angles.sort_unstable_by(f64::total_cmp);
    let seam = angles.first()? + TAU - angles.last()?;
    let widest = angles.windows(2).map(|w| w[1] - w[0]).fold(seam, f64::max);
    // Cameras side by side before a wall lie in a plane, too, and look at a right angle to it.
    let across = poses.iter().map(|p| p.r.z_axis.dot(axes[0]).abs()).sum::<f64>() < 0.9 * poses.len() as f64;
    (widest < 0.25 * TAU && across).then_some(axes[0])
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

/// [`focus_point`], with each axis weighted by one over its distance from the point: cameras that look elsewhere count little.
#[must_use]
pub fn robust_focus_point(poses: &[Pose]) -> Option<DVec3> {
    const ROUNDS: usize = 12;
    let origin = mean_centre(poses)?;
    let mut focus = focus_point(poses)?;
    for _ in 0..ROUNDS {
        let away = |p: &Pose| (focus - p.c).reject_from_normalized(p.r.z_axis).length();
        let mut distances: Vec<f64> = poses.iter().map(away).collect();
        distances.sort_unstable_by(f64::total_cmp);
        let typical = percentile(&distances, 0.5)?.max(1e-9 * (focus - origin).length());
        if typical <= 0.0 {
            break;
        }
        let (mut a, mut b) = (DMat3::ZERO, DVec3::ZERO);
        for pose in poses {
            let d = pose.r.z_axis;
            let weight = typical / m64::hypot(away(pose), typical);
            let across = (DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z)) * weight;
            a += across;
            b += across * (pose.c - origin);
        }
        if a.determinant() < PARALLEL {
            break;
        }
        focus = origin + a.inverse() * b;
    }
    focus.is_finite().then_some(focus)
}

/// The point with the smallest sum of distances to the others (Weiszfeld's iteration); `None` without points.
#[must_use]
pub fn geometric_median(points: &[DVec3]) -> Option<DVec3> {
    const ROUNDS: usize = 60;
    if points.is_empty() {
        return None;
    }
    let mut middle = points.iter().sum::<DVec3>() / points.len() as f64;
    let extent = points.iter().map(|p| p.distance(middle)).fold(0.0, f64::max);
    for _ in 0..ROUNDS {
        let weight = |p: &DVec3| 1.0 / p.distance(middle).max(1e-9 * extent).max(1e-300);
        let total: f64 = points.iter().map(weight).sum();
        middle = points.iter().map(|p| *p * (weight(p) / total)).sum();
    }
    middle.is_finite().then_some(middle)
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
