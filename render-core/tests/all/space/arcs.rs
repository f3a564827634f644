//! Arcs, rails, the order of cameras, and up.

use glam::{DMat3, DVec3};
use render_core::path::order::{farthest_points, is_sequence, path_length, pose_distance, tour, without_outliers};
use render_core::path::{Arc, Ends, Rail};
use render_core::pose::Pose;
use render_core::rig::{geometric_median, mean_up, robust_focus_point, up_axis};
use std::f64::consts::TAU;

const CENTRE: DVec3 = DVec3::new(1.0, 2.0, 3.0);

/// A camera at an azimuth, distance from the axis and height, that looks at the centre.
fn at(azimuth: f64, radius: f64, height: f64) -> Pose {
    let (sin, cos) = azimuth.sin_cos();
    Pose::look_at(CENTRE + DVec3::new(radius * cos, radius * sin, height), CENTRE, DVec3::Z).unwrap()
}

/// Numbers in `[0, 1)` that look like chance.
fn chance(i: usize) -> f64 {
    (i as f64 * 0.754_877_666 + 0.1).fract()
}

fn near(a: &Pose, b: &Pose, bound: f64) -> bool {
    (a.c - b.c).length() < bound && a.r.abs_diff_eq(b.r, bound)
}

#[test]
fn up_is_upright_where_all_cameras_look_down_from_one_side() {
    let poses: Vec<Pose> = (0..20).map(|i| at(2.0 * f64::from(i) / 19.0, 2.0, 3.5)).collect();
    let leaning = mean_up(&poses).unwrap().angle_between(DVec3::Z).to_degrees();
    assert!(leaning > 40.0, "the mean leans by {leaning}");
    assert!(up_axis(&poses).unwrap().angle_between(DVec3::Z) < 1e-6);
    // Its side is where the tops of the pictures are, also where the world is upside down.
    let turned: Vec<Pose> = poses.iter().map(|p| Pose { r: DMat3::from_rotation_x(3.0) * p.r, c: -p.c }).collect();
    let up = up_axis(&turned).unwrap();
    assert!(up.angle_between(DMat3::from_rotation_x(3.0) * DVec3::Z) < 1e-6, "{up}");
}

#[test]
fn up_of_cameras_that_face_one_way_is_their_mean_up() {
    let eye = |i: i32| DVec3::new(0.0, 0.3 * f64::from(i % 3), 0.2 * f64::from(i / 3));
    let poses: Vec<Pose> = (0..9).map(|i| Pose::look_at(eye(i), DVec3::X * 90.0, DVec3::Z).unwrap()).collect();
    assert!(up_axis(&poses).unwrap().angle_between(DVec3::Z) < 0.01);
    assert!(up_axis(&[]).is_none());
    assert!(up_axis(&[Pose::IDENTITY]).unwrap().angle_between(DVec3::NEG_Y) < 1e-9);
}

#[test]
fn up_of_a_ring_with_the_camera_held_both_ways_is_its_normal() {
    let side = DMat3::from_rotation_z(TAU / 4.0);
    let held = |i: i32| {
        let pose = at(TAU * f64::from(i) / 24.0, 4.0, 1.0);
        if i % 2 == 0 { pose } else { Pose { r: pose.r * side, c: pose.c } }
    };
    let up = up_axis(&(0..24).map(held).collect::<Vec<_>>()).unwrap();
    assert!(up.angle_between(DVec3::Z) < 1e-6, "{up}");
}

#[test]
fn a_camera_that_looks_elsewhere_does_not_move_the_focus() {
    let mut poses: Vec<Pose> = (0..20).map(|i| at(TAU * f64::from(i) / 20.0, 4.0, 1.0)).collect();
    poses.push(Pose::look_at(DVec3::ZERO, DVec3::new(-9.0, 30.0, 1.0), DVec3::Z).unwrap());
    assert!(robust_focus_point(&poses).unwrap().distance(CENTRE) < 0.02);
    assert_eq!(robust_focus_point(&[]), None);
    let points = [DVec3::ZERO, DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::splat(1e6)];
    assert!(geometric_median(&points).unwrap().length() < 0.6);
    assert!(geometric_median(&[DVec3::X; 9]).unwrap().distance(DVec3::X) < 1e-12);
    assert_eq!(geometric_median(&[]), None);
}

#[test]
fn an_arc_ends_where_cameras_end_and_follows_their_height() {
    let height = |azimuth: f64| 1.0 + 0.8 * azimuth;
    let poses: Vec<Pose> = (0..40).map(|i| 0.3 + 2.0 * f64::from(i) / 39.0).map(|a| at(a, 4.0, height(a))).collect();
    let arc = Arc::fit(&poses, CENTRE, DVec3::Z).unwrap();
    for [from, to] in [[f64::NAN, 1.0], [1.0, f64::NAN], [f64::INFINITY, 0.0]] {
        // Azimuths that are none give a part that is none, and no panic.
        let _ = arc.part(from, to).pose(from);
    }
    assert_eq!(arc.ends, Ends::Open);
    assert!((arc.to - arc.from - 2.0).abs() < 1e-9, "{} {}", arc.from, arc.to);
    for (i, a) in [(0, 0.3), (20, 0.3 + 40.0 / 39.0), (39, 2.3)] {
        let pose = arc.pose(arc.from + a - 0.3).unwrap();
        // An end takes its values from one side.
        assert!((pose.c - poses[i].c).length() < 0.25, "{i}: {pose:?} {:?}", poses[i]);
        assert!(pose.r.z_axis.angle_between(poses[i].r.z_axis) < 0.05);
    }
    // To and fro, without a jerk at the ends, and back where it began.
    let frames = arc.poses(60);
    let steps: Vec<f64> = (0..60).map(|i| frames[i].c.distance(frames[(i + 1) % 60].c)).collect();
    let longest = steps.iter().copied().fold(0.0, f64::max);
    for i in 0..60 {
        assert!((steps[i] - steps[(i + 1) % 60]).abs() < 0.2 * longest, "{i}");
    }
    let part = arc.part(arc.from + 0.5, arc.from + 0.7);
    assert!(part.poses(60).iter().all(|p| p.c.distance(arc.pose(arc.from + 0.6).unwrap().c) < 0.5));
}

#[test]
fn cameras_all_round_make_a_circle() {
    let poses: Vec<Pose> = (0..12).map(|i| at(TAU * f64::from(i) / 12.0, 4.0, 1.5)).collect();
    let arc = Arc::fit(&poses, CENTRE, DVec3::Z).unwrap();
    assert_eq!(arc.ends, Ends::Closed);
    for (frame, pose) in arc.poses(12).iter().zip(&poses) {
        assert!(near(frame, pose, 1e-6), "{frame:?} {pose:?}");
    }
    // The longest run counts: the two beyond wide gaps are left out.
    let some: Vec<Pose> = [0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 2.4, 4.0].map(|a| at(a, 4.0, 1.5)).to_vec();
    let arc = Arc::fit(&some, CENTRE, DVec3::Z).unwrap();
    assert!(arc.ends == Ends::Open && (arc.to - arc.from - 1.0).abs() < 1e-9);
}

#[test]
fn heights_that_are_chance_make_no_bumps() {
    let somewhere = |i: usize| {
        let above = 0.2 + 1.1 * chance(i);
        at(TAU * chance(7 * i + 3), 4.0 * above.cos(), 4.0 * above.sin())
    };
    let poses: Vec<Pose> = (0..100).map(somewhere).collect();
    let arc = Arc::fit(&poses, CENTRE, DVec3::Z).unwrap();
    let heights: Vec<f64> = arc.poses(60).iter().map(|p| p.c.z).collect();
    let [low, high] = [f64::min, f64::max].map(|f| heights.iter().copied().reduce(f).unwrap());
    assert!(high - low < 1.2, "{low} {high}");
    for pose in arc.poses(60) {
        let aim = (CENTRE - pose.c).angle_between(pose.r.z_axis).to_degrees();
        assert!(aim < 8.0, "{aim}");
    }
}

#[test]
fn what_is_no_arc_is_none() {
    assert_eq!(Arc::fit(&[], CENTRE, DVec3::Z), None);
    assert_eq!(Arc::fit(&[at(0.0, 4.0, 1.0)], CENTRE, DVec3::Z), None);
    assert_eq!(Arc::fit(&[at(0.0, 4.0, 1.0); 9], CENTRE, DVec3::Z), None);
    assert_eq!(Arc::fit(&[Pose { c: CENTRE, ..Pose::IDENTITY }; 9], CENTRE, DVec3::Z), None);
    let two = Arc::fit(&[at(0.1, 4.0, 1.0), at(0.5, 4.0, 1.0)], CENTRE, DVec3::Z).unwrap();
    assert!((two.to - two.from - 0.4).abs() < 1e-9, "{} {}", two.from, two.to);
    let nan = Pose { c: DVec3::NAN, ..Pose::IDENTITY };
    assert_eq!(Arc::fit(&[nan; 4], CENTRE, DVec3::Z), None);
}

#[test]
fn a_rail_runs_at_constant_speed_near_its_keys() {
    // Uneven keys with jitter.
    let azimuths: Vec<f64> = (0..30).map(|i| 0.1 * i as f64 + 0.06 * chance(i)).collect();
    let keys: Vec<Pose> = azimuths.iter().enumerate().map(|(i, a)| at(*a, 4.0 + 0.1 * chance(2 * i), 1.0)).collect();
    let rail = Rail::new(&keys, Ends::Open, 4.0, 0.15).unwrap();
    let frames = rail.poses(90);
    let steps: Vec<f64> = frames.windows(2).map(|w| pose_distance(&w[0], &w[1], 4.0)).collect();
    let mean = steps.iter().sum::<f64>() / steps.len() as f64;
    assert!(steps.iter().all(|s| (s / mean - 1.0).abs() < 0.03), "{steps:?}");
    for w in steps.windows(2) {
        assert!((w[1] - w[0]).abs() < 0.03 * mean);
    }
    for frame in &frames {
        let away = keys.iter().map(|k| pose_distance(k, frame, 4.0)).fold(f64::INFINITY, f64::min);
        assert!(away < 0.15, "{away}");
    }
    assert!(near(&frames[0], &keys[0], 0.15) && near(&frames[89], &keys[29], 0.15));
    let part = rail.part(0.25 * rail.length(), 0.5 * rail.length());
    assert!((part.length() / rail.length() - 0.25).abs() < 0.01);
}

#[test]
fn a_closed_rail_has_no_seam() {
    let keys: Vec<Pose> = (0..16).map(|i| at(TAU * f64::from(i) / 16.0, 4.0, 1.0)).collect();
    let rail = Rail::new(&keys, Ends::Closed, 4.0, 0.3).unwrap();
    let frames = rail.poses(64);
    for i in 0..64 {
        let next = pose_distance(&frames[i], &frames[(i + 1) % 64], 4.0);
        assert!((next * 64.0 / rail.length() - 1.0).abs() < 0.01, "{i}");
        assert!((frames[i].c.distance(CENTRE) - 17.0_f64.sqrt()).abs() < 0.2);
    }
    let over = rail.part(0.9 * rail.length(), 1.1 * rail.length()).pose(0.1 * rail.length());
    assert!(near(&over, &rail.pose(0.0), 0.05), "it goes on at its start");
}

#[test]
fn short_rails_are_legal() {
    assert_eq!(Rail::new(&[], Ends::Open, 1.0, 0.1), None);
    assert_eq!(Rail::new(&[Pose::IDENTITY], Ends::Open, 0.0, 0.1), None);
    for broken in [f64::NAN, f64::INFINITY] {
        let off = Pose { c: DVec3::new(0.0, broken, 0.0), ..Pose::IDENTITY };
        assert_eq!(Rail::new(&[Pose::IDENTITY, off], Ends::Open, 1.0, 0.1), None);
    }
    // Far apart, the way has no length that can be told: still no panic.
    let far = [-1e308, 1e308].map(|x| Pose { c: DVec3::new(x, 0.0, 0.0), ..Pose::IDENTITY });
    for ends in [Ends::Open, Ends::Closed] {
        let rail = Rail::new(&far, ends, 1e-300, 0.1);
        assert!(rail.is_none_or(|rail| rail.poses(5).len() == 5));
    }
    for ends in [Ends::Open, Ends::Closed] {
        let still = Rail::new(&[Pose::IDENTITY; 3], ends, 1.0, 0.1).unwrap();
        assert_eq!(still.length(), 0.0);
        assert!(still.poses(4).iter().all(|p| near(p, &Pose::IDENTITY, 1e-12)));
        assert!(still.poses(0).is_empty());
    }
    let two = [at(0.0, 4.0, 1.0), at(0.4, 4.0, 1.0)];
    let rail = Rail::new(&two, Ends::Open, 4.0, 0.05).unwrap();
    // The smoothing moves the ends by a part of its width.
    assert!(near(&rail.poses(2)[0], &two[0], 0.02) && near(&rail.poses(2)[1], &two[1], 0.02));
}

#[test]
fn a_video_is_a_sequence_and_a_shuffled_one_is_not() {
    let video: Vec<Pose> = (0..50).map(|i| at(0.1 * f64::from(i), 4.0, 1.0)).collect();
    assert!(is_sequence(&video, 4.0));
    let shuffled: Vec<Pose> = (0..50).map(|i| video[i * 19 % 50]).collect();
    assert!(!is_sequence(&shuffled, 4.0));
    assert!(!is_sequence(&video[..3], 4.0) && !is_sequence(&[], 4.0));
    // The shortest way finds the order again, from one end or the other.
    let way: Vec<Pose> = tour(&shuffled, 4.0).into_iter().map(|i| shuffled[i]).collect();
    assert!(path_length(&way, 4.0) < 1.01 * path_length(&video, 4.0));
    assert!(tour(&[], 4.0).is_empty() && tour(&video[..1], 4.0) == [0]);
}

#[test]
fn cameras_far_from_all_others_are_left_out() {
    let mut poses: Vec<Pose> = (0..20).map(|i| at(0.1 * f64::from(i), 4.0, 1.0)).collect();
    poses.insert(7, at(2.0, 40.0, 9.0));
    let kept = without_outliers(&poses, 4.0);
    assert_eq!(kept.len(), 20);
    assert!(!kept.contains(&7));
    assert_eq!(without_outliers(&poses[5..9], 4.0), [0, 1, 2, 3], "of few none is off");
    let few = farthest_points(&poses[8..], 4.0, 4);
    assert_eq!(few.len(), 4);
    assert!(few.contains(&0) && few.contains(&(poses.len() - 9)), "both ends are among them: {few:?}");
    assert_eq!(farthest_points(&poses, 4.0, 99).len(), 21);
    assert!(farthest_points(&[], 4.0, 3).is_empty() && farthest_points(&[Pose::IDENTITY; 5], 4.0, 3).len() == 3);
}
