//! Rigs and camera paths.

use glam::{DMat3, DQuat, DVec3};
use render_core::path::{Ends, Orbit, Spiral, through};
use render_core::pose::Pose;
use render_core::rig::{focus_point, mean_pose, mean_up, recentre, rms_distance, spherify};

fn is_rotation(r: DMat3) -> bool {
    (r.transpose() * r).abs_diff_eq(DMat3::IDENTITY, 1e-12) && r.determinant() > 0.0
}

/// Cameras on a circle around `(1, 2, 3)`, one above it.
fn inward() -> Vec<Pose> {
    let centre = DVec3::new(1.0, 2.0, 3.0);
    (0..12)
        .map(|i| {
            let (sin, cos) = (f64::from(i) * std::f64::consts::TAU / 12.0).sin_cos();
            Pose::look_at(centre + DVec3::new(4.0 * cos, 4.0 * sin, 1.5), centre, DVec3::Z).unwrap()
        })
        .collect()
}

/// Cameras on a small grid, all looking roughly along world `+x`, z up.
fn forward() -> Vec<Pose> {
    let eye = |i: i32| DVec3::new(0.1 * f64::from(i % 2), 0.3 * f64::from(i % 3 - 1), 0.2 * f64::from(i / 3 - 1));
    (0..9).map(|i| Pose::look_at(eye(i), DVec3::new(8.0, 0.0, 0.0), DVec3::Z).unwrap()).collect()
}

#[test]
fn the_focus_of_an_inward_rig_is_its_centre() {
    let poses = inward();
    let focus = focus_point(&poses).unwrap();
    assert!((focus - DVec3::new(1.0, 2.0, 3.0)).length() < 1e-12, "{focus}");
    let up = mean_up(&poses).unwrap();
    assert!((up - DVec3::Z).length() < 1e-12, "{up}");
    assert_eq!(focus_point(&[]), None);
    assert_eq!(focus_point(&[Pose::IDENTITY; 5]), None, "parallel axes meet nowhere");
    assert_eq!(mean_up(&[]), None);
}

#[test]
fn spherify_puts_the_focus_at_the_origin_and_cameras_at_one() {
    let poses = inward();
    let s = spherify(&poses).unwrap();
    let moved: Vec<Pose> = poses.iter().map(|p| s.pose(p)).collect();
    assert!(focus_point(&moved).unwrap().length() < 1e-12);
    assert!((rms_distance(&moved, DVec3::ZERO) - 1.0).abs() < 1e-12);
    assert!((mean_up(&moved).unwrap() - DVec3::Z).length() < 1e-12);
    assert!(moved.iter().all(|p| is_rotation(p.r)));
    // What a camera sees is unchanged, and the way back is exact.
    let x = DVec3::new(0.5, 1.5, 2.5);
    let (before, after) = (poses[3].to_camera(x), moved[3].to_camera(s.point(x)));
    assert!((after - before * s.scale).length() < 1e-12);
    assert!((s.inverse().point(s.point(x)) - x).length() < 1e-12);
    assert_eq!(spherify(&[]), None);
    assert_eq!(spherify(&[Pose::IDENTITY]), None);
}

#[test]
fn recentre_brings_the_mean_pose_to_the_identity() {
    let poses = forward();
    let s = recentre(&poses).unwrap();
    let moved: Vec<Pose> = poses.iter().map(|p| s.pose(p)).collect();
    let mean = mean_pose(&moved).unwrap();
    assert!(mean.r.abs_diff_eq(DMat3::IDENTITY, 1e-12) && mean.c.length() < 1e-12, "{mean:?}");
    assert_eq!(s.scale, 1.0);
    // A full circle of flat cameras has no mean direction.
    let flat: Vec<Pose> = (0..8)
        .map(|i| {
            let (sin, cos) = (f64::from(i) * std::f64::consts::TAU / 8.0).sin_cos();
            Pose::look_at(DVec3::ZERO, DVec3::new(cos, sin, 0.0), DVec3::Z).unwrap()
        })
        .collect();
    assert_eq!(recentre(&flat), None);
    assert_eq!(recentre(&[]), None);
}

#[test]
fn an_orbit_fitted_to_a_circle_is_that_circle() {
    let poses = inward();
    let orbit = Orbit::fit(&poses).unwrap();
    assert!((orbit.radius - 4.0).abs() < 1e-12 && (orbit.height - 1.5).abs() < 1e-12, "{orbit:?}");
    let frames = orbit.poses(12);
    for (frame, pose) in frames.iter().zip(&poses) {
        assert!((frame.c - pose.c).length() < 1e-9 && frame.r.abs_diff_eq(pose.r, 1e-9), "{frame:?} {pose:?}");
    }
    assert!(orbit.poses(0).is_empty());
    assert_eq!(Orbit::fit(&[]), None);
}

#[test]
fn a_spiral_stays_among_the_cameras_and_looks_into_the_scene() {
    let poses = forward();
    let spiral = Spiral::fit(&poses, 4.0, 10.0).unwrap();
    // 1 / (0.25 / 3.6 + 0.75 / 50)
    assert!((spiral.focus - 11.842).abs() < 1e-3, "{}", spiral.focus);
    assert!(spiral.radii.max_element() < 0.35 && spiral.radii.x > 0.2, "{}", spiral.radii);
    let frames = spiral.poses(60);
    assert_eq!(frames.len(), 60);
    let target = spiral.frame.to_world(DVec3::Z * spiral.focus);
    for frame in &frames {
        assert!(is_rotation(frame.r));
        let seen = frame.to_camera(target);
        assert!(seen.truncate().length() < 1e-9 && seen.z > 5.0);
        assert!(frame.r.y_axis.z < -0.9, "down in the picture is down in the world");
        assert!((frame.c - spiral.frame.c).length() < 0.6);
    }
    // The end joins the start: the last step is like the others.
    let step = |a: &Pose, b: &Pose| (a.c - b.c).length();
    let longest = frames.windows(2).map(|w| step(&w[0], &w[1])).fold(0.0, f64::max);
    assert!(step(&frames[59], &frames[0]) <= longest * 1.01);
    assert_eq!(Spiral::fit(&poses, 0.0, 10.0), None);
    assert_eq!(Spiral::fit(&[], 1.0, 10.0), None);
}

#[test]
fn a_path_passes_through_its_keys() {
    let keys = inward();
    let open = through(&keys[..4], 31, Ends::Open);
    for (i, key) in keys[..4].iter().enumerate() {
        let at = &open[i * 10];
        assert!((at.c - key.c).length() < 1e-12 && at.r.abs_diff_eq(key.r, 1e-12), "key {i}");
    }
    assert!(open.iter().all(|p| is_rotation(p.r)));
    let closed = through(&keys, 48, Ends::Closed);
    for (i, key) in keys.iter().enumerate() {
        assert!((closed[i * 4].c - key.c).length() < 1e-12, "key {i}");
    }
    // On a circle of keys the spline stays near the circle, also across the seam.
    for p in &closed {
        let flat = (p.c - DVec3::new(1.0, 2.0, 4.5)).length();
        assert!((flat - 4.0).abs() < 0.02, "{flat}");
    }
}

#[test]
fn short_paths_are_legal() {
    assert!(through(&[], 10, Ends::Open).is_empty());
    let turned = Pose { r: DMat3::from_quat(DQuat::from_rotation_y(0.3)), c: DVec3::ONE };
    for ends in [Ends::Open, Ends::Closed] {
        assert!(through(&[turned, Pose::IDENTITY], 0, ends).is_empty());
        for p in through(&[turned], 5, ends) {
            assert!((p.c - turned.c).length() < 1e-14 && p.r.abs_diff_eq(turned.r, 1e-14));
        }
        assert_eq!(through(&[turned, Pose::IDENTITY], 1, ends)[0].c, turned.c);
    }
    let two = through(&[turned, Pose::IDENTITY], 2, Ends::Open);
    assert_eq!((two[0].c, two[1].c), (turned.c, Pose::IDENTITY.c));
}
