//! How far two sets of cameras of the same photos are apart, once one is moved onto the other.

use glam::{DMat3, DVec3};
use render_core::camera::Pose;
use render_core::pose::{Similarity, nearest_rotation};
use std::collections::HashMap;

/// Differences of cameras after alignment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Comparison {
    /// Photos that both sets hold.
    pub common: usize,
    /// Mean angle between the rotations, degrees.
    pub rotation_mean: f64,
    /// Largest angle, degrees.
    pub rotation_max: f64,
    /// Mean distance between the centres, as a share of the mean distance of the true centres from their middle.
    pub centre_mean: f64,
    /// Largest such distance.
    pub centre_max: f64,
    /// What moves the found cameras onto the true ones.
    pub alignment: Similarity,
}

/// Compares found cameras with true ones by name. The rotation that aligns them is the mean of those that turn each found
/// camera onto its true one, so that cameras on a line can be compared as well; scale and shift are the least-squares ones for
/// the centres.
///
/// `None` with fewer than two common photos, with centres that are all at one place, or where the rotations have no mean.
#[must_use]
pub fn compare(truth: &[(String, Pose)], found: &[(String, Pose)]) -> Option<Comparison> {
    let by_name: HashMap<&str, &Pose> = found.iter().map(|(name, pose)| (name.as_str(), pose)).collect();
    let pairs: Vec<(&Pose, &Pose)> =
        truth.iter().filter_map(|(name, pose)| Some((pose, *by_name.get(name.as_str())?))).collect();
    let n = pairs.len() as f64;
    if pairs.len() < 2 {
        return None;
    }
    let sum = pairs.iter().fold(DMat3::ZERO, |sum, (t, f)| sum + t.r * f.r.transpose());
    let (r, _) = nearest_rotation(sum * (1.0 / n)).ok()?;
    let mean = |pick: fn(&(&Pose, &Pose)) -> DVec3| pairs.iter().map(pick).sum::<DVec3>() / n;
    let (middle_t, middle_f) = (mean(|p| p.0.c), mean(|p| p.1.c));
    let (mut dot, mut square) = (0.0, 0.0);
    for (t, f) in &pairs {
        let turned = r * (f.c - middle_f);
        dot += turned.dot(t.c - middle_t);
        square += turned.length_squared();
    }
    let scale = dot / square;
    if !scale.is_finite() || scale <= 0.0 {
        return None;
    }
    let alignment = Similarity { scale, r, t: middle_t - r * middle_f * scale };
    let radius = pairs.iter().map(|(t, _)| (t.c - middle_t).length()).sum::<f64>() / n;
    let angles = pairs.iter().map(|(t, f)| angle(t.r * (r * f.r).transpose()).to_degrees());
    let distances = pairs.iter().map(|(t, f)| (alignment.point(f.c) - t.c).length() / radius);
    let (rotation_mean, rotation_max) = mean_and_max(angles);
    let (centre_mean, centre_max) = mean_and_max(distances);
    Some(Comparison { common: pairs.len(), rotation_mean, rotation_max, centre_mean, centre_max, alignment })
}

/// Angle of a rotation, radians: by its sine, which keeps small angles.
fn angle(r: DMat3) -> f64 {
    let axis = DVec3::new(r.y_axis.z - r.z_axis.y, r.z_axis.x - r.x_axis.z, r.x_axis.y - r.y_axis.x);
    let trace = r.x_axis.x + r.y_axis.y + r.z_axis.z;
    (0.5 * axis.length()).atan2(0.5 * (trace - 1.0))
}

fn mean_and_max(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (sum, max, n) = values.fold((0.0, 0.0, 0.0), |(sum, max, n), x| (sum + x, f64::max(max, x), n + 1.0));
    (sum / n, max)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ring(n: usize) -> Vec<(String, Pose)> {
        let camera = |i: usize| {
            let a = i as f64 * 0.3;
            let eye = DVec3::new(4.0 * a.cos(), 4.0 * a.sin(), 1.0 + 0.1 * a);
            (format!("{i}"), Pose::look_at(eye, DVec3::ZERO, DVec3::Z).unwrap())
        };
        (0..n).map(camera).collect()
    }

    fn moved(cameras: &[(String, Pose)]) -> Vec<(String, Pose)> {
        let r = DMat3::from_euler(glam::EulerRot::XYZ, 0.5, -1.1, 2.0);
        let similarity = Similarity { scale: 0.21, r, t: DVec3::new(5.0, -3.0, 11.0) };
        cameras.iter().map(|(name, pose)| (name.clone(), similarity.pose(pose))).collect()
    }

    #[test]
    fn a_similarity_makes_no_difference() {
        let truth = ring(12);
        let c = compare(&truth, &moved(&truth)).unwrap();
        assert_eq!(c.common, 12);
        assert!(c.rotation_max < 1e-9 && c.centre_max < 1e-9, "{c:?}");
        assert!((c.alignment.scale - 1.0 / 0.21).abs() < 1e-9);
    }

    #[test]
    fn one_camera_that_is_off_shows() {
        let truth = ring(20);
        let mut found = moved(&truth);
        let pose = &mut found[3].1;
        pose.r *= DMat3::from_rotation_y(0.1);
        let c = compare(&truth, &found).unwrap();
        // The mean rotation follows it by a twentieth.
        assert!((c.rotation_max - 0.1_f64.to_degrees() * 0.95).abs() < 0.05, "{c:?}");
        assert!(c.centre_max > 0.0 && c.centre_max < 0.02, "{c:?}");
    }

    #[test]
    fn too_little_is_no_comparison() {
        let truth = ring(5);
        assert_eq!(compare(&truth, &truth[..1]), None);
        assert_eq!(compare(&truth, &[]), None);
        let still: Vec<_> = truth.iter().map(|(n, p)| (n.clone(), Pose { c: DVec3::ZERO, ..*p })).collect();
        assert_eq!(compare(&truth, &still), None);
    }
}
