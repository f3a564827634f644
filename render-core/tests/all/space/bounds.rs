//! Boxes, rays through them, percentiles and depth ranges.

use glam::DVec3;
use proptest::prelude::*;
use render_core::bounds::{Aabb, depth_ranges, intersect_box, percentile, robust_box, visible_depths};
use render_core::camera::{Camera, Pose};
use testkit::strategies::any_ray;

const UNIT: Aabb = Aabb { min: DVec3::ZERO, max: DVec3::ONE };

proptest! {
    #![proptest_config(testkit::property::cases(256))]

    #[test]
    fn the_interval_is_where_the_ray_is_inside((o, d) in any_ray(), size in 0.1..10.0_f64) {
        let (o, d) = (DVec3::from_array(o), DVec3::from_array(d));
        let cube = Aabb::cube(DVec3::new(0.3, -0.2, 0.1), size);
        let slack = 1e-9 * (1.0 + o.length());
        let inside = |t: f64, grow: f64| Aabb { min: cube.min - grow, max: cube.max + grow }.contains(o + d * t);
        match cube.intersect(o, d, 0.0, 1e6) {
            Some([t0, t1]) => {
                prop_assert!((0.0..=1e6).contains(&t0) && t0 <= t1 && t1 <= 1e6);
                for u in [0.0, 0.3, 1.0] {
                    prop_assert!(inside(t0 + u * (t1 - t0), slack));
                }
                // And nowhere else.
                prop_assert!(t0 == 0.0 || !inside(t0 - 1e-6 * (1.0 + t0) - slack, -slack));
                prop_assert!(t1 == 1e6 || !inside(t1 + 1e-6 * (1.0 + t1) + slack, -slack));
            }
            None => {
                for i in 0..200 {
                    prop_assert!(!inside(f64::from(i) * 0.1, -slack));
                }
            }
        }
    }
}

#[test]
fn axis_parallel_rays_hit_or_miss_without_nan() {
    let hit = |o: [f64; 3], d: [f64; 3]| UNIT.intersect(o.into(), d.into(), 0.0, f64::INFINITY);
    assert_eq!(hit([0.5, 0.5, -1.0], [0.0, 0.0, 1.0]), Some([1.0, 2.0]));
    assert_eq!(hit([0.5, 0.5, -1.0], [-0.0, -0.0, 1.0]), Some([1.0, 2.0]));
    assert_eq!(hit([1.5, 0.5, -1.0], [0.0, 0.0, 1.0]), None);
    // In a face and along an edge: inside. This is where 0 * inf would be.
    assert_eq!(hit([0.0, 0.5, -1.0], [0.0, 0.0, 1.0]), Some([1.0, 2.0]));
    assert_eq!(hit([1.0, 1.0, 3.0], [0.0, 0.0, -1.0]), Some([2.0, 3.0]));
    // From a face outward and inward.
    assert_eq!(hit([0.0, 0.5, 0.5], [1.0, 0.0, 0.0]), Some([0.0, 1.0]));
    assert_eq!(hit([0.0, 0.5, 0.5], [-1.0, 0.0, 0.0]), Some([0.0, 0.0]));
    assert_eq!(hit([0.5, 0.5, 2.0], [0.0, 0.0, 1.0]), None, "behind");
    // Denormal direction: 1 / d is infinite, (min - o) / d is not 0 * inf.
    assert_eq!(hit([0.0, 0.5, 0.5], [5e-324, 0.0, 0.0]), Some([0.0, f64::INFINITY]));
    assert_eq!(hit([0.5, 0.5, 0.5], [0.0, 0.0, 0.0]), Some([0.0, f64::INFINITY]), "it stays inside");
}

#[test]
fn near_and_far_cut_and_nan_misses() {
    let at = |o: [f32; 3], d: [f32; 3], near: f32, far: f32| intersect_box(o, d, [0.0; 3], [1.0; 3], near, far);
    let (o, d) = ([0.5, 0.5, -1.0], [0.0, 0.0, 1.0]);
    assert_eq!(at(o, d, 1.25, 1.5), Some([1.25, 1.5]));
    assert_eq!(at(o, d, 2.5, 9.0), None);
    assert_eq!(at(o, d, 1.5, 1.25), None, "far before near");
    for bad in 0..3 {
        let mut poisoned = (o, d);
        poisoned.0[bad] = f32::NAN;
        assert_eq!(at(poisoned.0, d, 0.0, 9.0), None);
        poisoned.1[bad] = f32::NAN;
        assert_eq!(at(o, poisoned.1, 0.0, 9.0), None);
    }
    assert_eq!(at(o, d, f32::NAN, 9.0), None);
    assert_eq!(at(o, d, 0.0, f32::NAN), None);
    assert_eq!(at([f32::INFINITY, 0.5, 0.5], [-1.0, 0.0, 0.0], 0.0, 9.0), None);
}

#[test]
fn boxes_hold_their_points() {
    assert_eq!(Aabb::around([]), None);
    let points = [DVec3::new(1.0, -2.0, 3.0), DVec3::new(-1.0, 5.0, 0.0)];
    let around = Aabb::around(points).unwrap();
    assert_eq!((around.min, around.max), (DVec3::new(-1.0, -2.0, 0.0), DVec3::new(1.0, 5.0, 3.0)));
    assert!(points.iter().all(|&p| around.contains(p)) && !around.contains(DVec3::new(0.0, 0.0, -0.1)));
    assert_eq!(around.centre(), DVec3::new(0.0, 1.5, 1.5));
    assert_eq!(around.scaled(2.0).size(), around.size() * 2.0);
}

#[test]
fn strays_do_not_stretch_a_robust_box() {
    let mut points: Vec<DVec3> =
        (0..1000).map(|i| DVec3::new(f64::from(i % 10), f64::from(i / 10 % 10), f64::from(i / 100))).collect();
    points.extend([DVec3::splat(1e6), DVec3::splat(-1e9), DVec3::splat(f64::NAN), DVec3::splat(f64::INFINITY)]);
    let found = robust_box(&points, 0.01).unwrap();
    assert_eq!((found.min, found.max), (DVec3::ZERO, DVec3::splat(9.0)));
    assert_eq!(robust_box(&[], 0.01), None);
    assert_eq!(robust_box(&[DVec3::splat(f64::NAN)], 0.01), None);
    let one = robust_box(&[DVec3::ONE], 0.01).unwrap();
    assert_eq!((one.min, one.max), (DVec3::ONE, DVec3::ONE));
}

#[test]
fn percentiles_interpolate() {
    let sorted = [1.0, 2.0, 4.0, 8.0, 16.0];
    let want = [(0.0, 1.0), (0.5, 4.0), (0.625, 6.0), (1.0, 16.0), (2.0, 16.0), (-1.0, 1.0)];
    for (q, value) in want {
        assert_eq!(percentile(&sorted, q), Some(value), "{q}");
    }
    assert_eq!(percentile(&[], 0.5), None);
    assert_eq!(percentile(&[3.0], 0.99), Some(3.0));
}

#[test]
fn depth_ranges_come_from_the_points_in_the_image() {
    let camera = Camera::pinhole(100, 100, 100.0, 100.0, 50.0, 50.0, Pose::IDENTITY);
    let mut points: Vec<DVec3> = (0..=100).map(|i| DVec3::new(0.0, 0.1, 2.0 + f64::from(i) * 0.01)).collect();
    points.push(DVec3::new(0.0, 0.0, -5.0)); // behind
    points.push(DVec3::new(50.0, 0.0, 1.0)); // beside
    assert_eq!(visible_depths(&camera, &points).len(), 101);
    // Looks the other way, sees the one point behind: takes what the others have.
    let back = Pose::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::NEG_Y).unwrap();
    let blind = Camera { pose: back, ..camera };
    let ranges = depth_ranges(&[camera, blind], &points, 0.05, 10).unwrap();
    assert!((ranges[0][0] - 2.05).abs() < 1e-12 && (ranges[0][1] - 2.95).abs() < 1e-12, "{ranges:?}");
    assert_eq!(ranges[1], ranges[0]);
    assert_eq!(depth_ranges(&[blind], &points, 0.05, 10), None);
    assert_eq!(depth_ranges(&[], &points, 0.05, 1), None);
}
