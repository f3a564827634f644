use super::*;
use scene_io::synthetic::{OrbitOptions, TabletopOptions, orbit, tabletop};
use scene_io::{ImageStore, Scene, Split, StoreOptions};
use std::sync::Arc;

const OPTIONS: StartOptions = StartOptions { degree: 2, max: 1_000_000, random: 500, seed: 4 };

/// Photos that show red wherever they are asked.
fn red(_: DVec3) -> Option<[f32; 3]> {
    Some([1.0, 0.0, 0.0])
}

const UNIT: Bounds = Bounds { min: DVec3::NEG_ONE, max: DVec3::ONE };

fn at(x: f64, y: f64, z: f64) -> Point {
    Point { xyz: DVec3::new(x, y, z), rgb: [255, 0, 51] }
}

/// Points spread over a ball about `centre`.
fn ball(n: u64, centre: DVec3, radius: f64) -> Vec<Point> {
    let rng = Rng::new(9, 0);
    let point = |i| {
        let [x, y, z, c] = rng.uniform4_at(i);
        let xyz = centre + radius * (2.0 * DVec3::new(x.into(), y.into(), z.into()) - 1.0);
        Point { xyz, rgb: [(255.0 * c) as u8; 3] }
    };
    (0..n).map(point).collect()
}

fn sizes(cloud: &Gaussians) -> Vec<f32> {
    cloud.log_scale[..cloud.len()].iter().map(|s| s.exp()).collect()
}

/// Whatever the start: everything finite, in its range, and the same along all axes.
#[track_caller]
fn is_sound(start: &Start, n: usize) {
    let cloud = &start.cloud;
    assert_eq!(cloud.len(), n);
    cloud.check().unwrap();
    assert!(cloud.fields().iter().all(|(_, values)| values.iter().all(|x| x.is_finite())));
    assert!(sizes(cloud).iter().all(|s| (3.1e-4..=0.1 + 1e-6).contains(s)));
    assert!(cloud.log_scale[..n] == cloud.log_scale[n..2 * n] && cloud.log_scale[..n] == cloud.log_scale[2 * n..]);
    assert!(cloud.logit.iter().all(|x| (1.0 / (1.0 + (-x).exp()) - 0.1).abs() < 1e-6));
    assert!(cloud.wxyz[..n].iter().all(|w| *w == 1.0) && cloud.wxyz[n..].iter().all(|q| *q == 0.0));
    assert!(cloud.rest.iter().all(|c| *c == 0.0));
    assert!(!start.notes.is_empty());
}

#[test]
fn gaussians_begin_at_the_points_with_their_colours_and_the_distance_of_their_neighbours() {
    // A tetrahedron: every point has the three others at squared distances 0.02.
    let d = 0.1;
    let points = [at(d, d, d), at(d, -d, -d), at(-d, d, -d), at(-d, -d, d)];
    let frame = CloudFrame { centre: [0.0; 3], scale: 4.0 };
    let start = Start::from_points(&points, &frame, &OPTIONS).unwrap();
    is_sound(&start, 4);
    let cloud = &start.cloud;
    assert_eq!(cloud.degree(), 2);
    assert_eq!(cloud.mean[..4], [0.025, 0.025, -0.025, -0.025]);
    let want = (8.0_f32 * 0.01).sqrt() / 4.0;
    assert!(sizes(cloud).iter().all(|s| (s - want).abs() < 1e-6), "{:?} {want}", sizes(cloud));
    for (channel, value) in [1.0, 0.0, 0.2].into_iter().enumerate() {
        assert!(cloud.dc[4 * channel..][..4].iter().all(|dc| (SH_0 * dc + 0.5 - value).abs() < 1e-6));
    }
}

#[test]
fn a_scene_in_other_units_and_far_from_zero_begins_alike() {
    let cameras: Vec<DVec3> = ball(7, DVec3::ZERO, 3.0).iter().map(|p| p.xyz).collect();
    let points = ball(300, DVec3::new(0.5, 0.0, 1.0), 1.0);
    let here = Start::from_points(&points, &CloudFrame::around(&cameras, &[]).0, &OPTIONS).unwrap();
    let (scale, shift) = (1000.0, DVec3::new(1e6, -1e6, 2e6));
    let there = |x: DVec3| scale * x + shift;
    let cameras: Vec<DVec3> = cameras.iter().map(|c| there(*c)).collect();
    let points: Vec<Point> = points.iter().map(|p| Point { xyz: there(p.xyz), ..*p }).collect();
    let far = Start::from_points(&points, &CloudFrame::around(&cameras, &[]).0, &OPTIONS).unwrap();
    is_sound(&far, 300);
    for (a, b) in here.cloud.mean.iter().zip(&far.cloud.mean) {
        assert!((a - b).abs() < 1e-6, "{a} {b}");
    }
    for (a, b) in here.cloud.log_scale.iter().zip(&far.cloud.log_scale) {
        assert!((a - b).abs() < 1e-4, "{a} {b}");
    }
}

#[test]
fn points_at_one_place_have_the_smallest_size() {
    let mut points = vec![at(0.3, 0.2, 0.1); 10_000];
    points.extend(ball(50, DVec3::ZERO, 1.0));
    let start = Start::from_points(&points, &CloudFrame::WORLD, &OPTIONS).unwrap();
    is_sound(&start, 10_050);
    let sizes = sizes(&start.cloud);
    assert!(sizes[..10_000].iter().all(|s| (s - 1e-7_f32.sqrt()).abs() < 1e-8));
    assert!(sizes[10_000..].iter().all(|s| *s > 1e-2));
}

#[test]
fn points_on_a_line_are_as_large_as_their_spacing_says() {
    let points: Vec<Point> = (0..400).map(|i| at(0.0, 0.01 * f64::from(i), 0.0)).collect();
    let start = Start::from_points(&points, &CloudFrame::WORLD, &OPTIONS).unwrap();
    is_sound(&start, 400);
    // Neighbours at 1, 1 and 2 steps; at the end of the line at 1, 2 and 3.
    let sizes = sizes(&start.cloud);
    assert!((sizes[200] - 0.01 * 2.0_f32.sqrt()).abs() < 1e-6, "{}", sizes[200]);
    assert!((sizes[0] - 0.01 * (14.0_f32 / 3.0).sqrt()).abs() < 1e-6, "{}", sizes[0]);
}

#[test]
fn a_stray_far_away_is_kept_small_and_changes_no_other() {
    let mut points = ball(200, DVec3::ZERO, 1.0);
    let without = Start::from_points(&points, &CloudFrame::WORLD, &OPTIONS).unwrap();
    points.push(at(1e6, -1e6, 1e6));
    let with = Start::from_points(&points, &CloudFrame::WORLD, &OPTIONS).unwrap();
    is_sound(&with, 201);
    assert_eq!(sizes(&with.cloud)[..200], sizes(&without.cloud));
    assert!((sizes(&with.cloud)[200] - 0.1).abs() < 1e-6 && with.cloud.mean[200] == 1e6);
}

#[test]
fn few_points_take_what_neighbours_there_are() {
    let points = [at(0.0, 0.0, 0.0), at(0.05, 0.0, 0.0), at(0.0, 0.02, 0.0)];
    for (n, want) in [(0, vec![]), (1, vec![0.01]), (2, vec![0.05, 0.05])] {
        let start = Start::from_points(&points[..n], &CloudFrame::WORLD, &OPTIONS).unwrap();
        is_sound(&start, n);
        assert!(sizes(&start.cloud).iter().zip(&want).all(|(s, want): (&f32, &f32)| (s - want).abs() < 1e-6));
    }
    let three = Start::from_points(&points, &CloudFrame::WORLD, &OPTIONS).unwrap();
    is_sound(&three, 3);
    assert!((sizes(&three.cloud)[0] - (0.5 * (0.0025_f32 + 0.0004)).sqrt()).abs() < 1e-6);
}

#[test]
fn no_more_than_max_are_taken_evenly() {
    let points: Vec<Point> = (0..1000).map(|i| at(f64::from(i), 0.0, 0.0)).collect();
    for (max, want) in [(4, vec![0.0, 250.0, 500.0, 750.0]), (1, vec![0.0]), (0, vec![])] {
        let start = Start::from_points(&points, &CloudFrame::WORLD, &StartOptions { max, ..OPTIONS }).unwrap();
        is_sound(&start, max);
        assert_eq!(start.cloud.mean[..max], want);
        assert!(start.notes[0].contains("over its 1000"), "{:?}", start.notes);
    }
    let most = Start::from_points(&points, &CloudFrame::WORLD, &StartOptions { max: 999, ..OPTIONS }).unwrap();
    let distinct: std::collections::BTreeSet<u32> = most.cloud.mean[..999].iter().map(|x| x.to_bits()).collect();
    assert_eq!(distinct.len(), 999, "no point twice");
    let random = Start::random(UNIT, &CloudFrame::WORLD, &StartOptions { max: 20, ..OPTIONS }, red).unwrap();
    is_sound(&random, 20);
}

#[test]
fn points_that_are_no_numbers_are_left_out_and_counted() {
    let mut points = ball(10, DVec3::ZERO, 1.0);
    points[3].xyz.y = f64::NAN;
    points[7].xyz.x = 1e300;
    let start = Start::from_points(&points, &CloudFrame::WORLD, &OPTIONS).unwrap();
    is_sound(&start, 8);
    assert!(start.notes[0].starts_with("2 of 10 points left out"), "{:?}", start.notes);
    assert!(Start::from_points(&[at(f64::NAN, 0.0, 0.0)], &CloudFrame::WORLD, &OPTIONS).unwrap().cloud.is_empty());
}

#[test]
fn random_starts_fill_their_box_and_depend_on_the_seed_alone() {
    let within = Bounds { min: DVec3::new(10.0, -4.0, 0.0), max: DVec3::new(14.0, -2.0, 1.0) };
    let frame = CloudFrame { centre: [12.0, -3.0, 0.0], scale: 8.0 };
    let options = StartOptions { random: 4000, ..OPTIONS };
    let start = Start::random(within, &frame, &options, red).unwrap();
    is_sound(&start, 4000);
    let mut world = start.cloud.clone();
    frame.cloud_to_world(&mut world);
    for axis in 0..3 {
        let x = &world.mean[4000 * axis..][..4000];
        let (low, high) = (within.min[axis] as f32, within.max[axis] as f32);
        assert!(x.iter().all(|x| (low..=high).contains(x)));
        let mean = x.iter().sum::<f32>() / 4000.0;
        // Deviation of the mean: a width over sqrt(12 n).
        assert!((mean - 0.5 * (low + high)).abs() < 5.0 * (high - low) / 219.0, "{mean}");
        let red = [1.0, 0.0, 0.0][axis];
        assert!(start.cloud.dc[4000 * axis..][..4000].iter().all(|dc| (SH_0 * dc + 0.5 - red).abs() < 1e-6));
    }
    assert_eq!(Start::random(within, &frame, &options, red).unwrap().cloud, start.cloud);
    assert_ne!(Start::random(within, &frame, &StartOptions { seed: 5, ..options }, red).unwrap().cloud, start.cloud);
}

#[test]
fn places_that_photos_rule_out_stay_empty() {
    let right = |x: DVec3| (x.x > 0.5).then_some([0.5; 3]);
    let start = Start::random(UNIT, &CloudFrame::WORLD, &OPTIONS, right).unwrap();
    is_sound(&start, 500);
    assert!(start.cloud.mean[..500].iter().all(|x| *x > 0.5));
    // Where nothing is left there has to be something all the same.
    let start = Start::random(UNIT, &CloudFrame::WORLD, &OPTIONS, |_| None).unwrap();
    is_sound(&start, 500);
    assert!(start.notes[0].contains("no place"), "{:?}", start.notes);
}

#[test]
fn degrees_that_cannot_be_are_refused() {
    let options = StartOptions { degree: 4, ..OPTIONS };
    assert_eq!(Start::random(UNIT, &CloudFrame::WORLD, &options, red), Err(SplatError::Degree { got: 4 }));
}

fn data(scene: &Scene) -> Dataset {
    let store = Arc::new(ImageStore::new(&scene.frames, StoreOptions::default()).unwrap());
    Dataset::new(scene, store, scene.split(Split::Train).collect()).unwrap()
}

#[test]
fn points_behind_all_cameras_are_kept() {
    let mut scene = orbit(&OrbitOptions { width: 16, height: 12, ..OrbitOptions::default() });
    assert!(!scene.points.is_empty());
    let cameras: Vec<_> = data(&scene).views().iter().map(|v| v.camera.pose).collect();
    let (frame, _) = CloudFrame::around(&cameras.iter().map(|p| p.c).collect::<Vec<_>>(), &[]);
    // Upwards from cameras that look down or level.
    scene.points = (0..5).map(|i| at(0.1 * f64::from(i), 0.0, 1e4)).collect();
    assert!(scene.points.iter().all(|p| cameras.iter().all(|c| c.to_camera(p.xyz).z < 0.0)));
    let start = Start::from_points(&scene.points, &frame, &OPTIONS).unwrap();
    is_sound(&start, 5);
}

#[test]
fn the_box_of_a_scene_is_where_its_things_are() {
    let scene = tabletop(&TabletopOptions { width: 16, height: 12, ..TabletopOptions::default() });
    let data = data(&scene);
    let within = scene_box(&crate::layout::layout(&scene, &data), &data);
    assert!(within.min.cmplt(DVec3::ZERO).all() && within.max.cmpgt(DVec3::ZERO).all(), "{within:?}");
    assert!((within.max - within.min).max_element() < 20.0, "{within:?}");
    // Cameras that do not fit the space the layout names.
    let layout = crate::layout::Layout {
        kind: crate::space::SpaceKind::Ndc,
        reference: None,
        centre: DVec3::ONE,
        radius: 2.0,
        ..crate::layout::layout(&scene, &data)
    };
    assert_eq!(scene_box(&layout, &data), Bounds { min: DVec3::splat(-1.0), max: DVec3::splat(3.0) });
}
