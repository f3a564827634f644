use super::*;
use crate::system::NOWHERE;
use glam::{DVec2, DVec3};
use scene_io::synthetic::{Mouth, MouthOptions, Orbit, OrbitOptions, Snapshot, SnapshotHit, mouth, orbit};
use scene_io::{ImageStore, Scene, Split, StoreOptions};
use std::sync::Arc;

const SIDE: u32 = 48;

fn options() -> OrbitOptions {
    OrbitOptions { width: SIDE, height: SIDE, train: 1, test: 6, rays: 1, ..OrbitOptions::default() }
}

/// The held-out views.
fn data(longest_side: Option<u32>) -> Dataset {
    held_out(&orbit(&options()), longest_side)
}

fn held_out(scene: &Scene, longest_side: Option<u32>) -> Dataset {
    let store = StoreOptions::default().with_longest_side(longest_side);
    let store = Arc::new(ImageStore::new(&scene.frames, store).unwrap());
    Dataset::new(scene, store, scene.split(Split::Test).collect()).unwrap()
}

/// Scores of a system that says of each point seen in a snapshot what `canonical` says.
fn scored(data: &Dataset, canonical: impl Fn(&Snapshot, &SnapshotHit) -> [f64; 3]) -> Vec<Transfer> {
    let stage = Orbit::new(options().seed, options().motion);
    scored_at(|time| stage.at(time), data, canonical)
}

/// The same of what `at` says is there at each time.
fn scored_at(
    at: impl Fn(f64) -> Snapshot,
    data: &Dataset,
    canonical: impl Fn(&Snapshot, &SnapshotHit) -> [f64; 3],
) -> Vec<Transfer> {
    let mut points = Correspondence::of(data).unwrap();
    for (i, view) in data.views().iter().enumerate() {
        let snapshot = at(view.time);
        let (w, h) = (view.camera.width, view.camera.height);
        let centre = |k: u32| DVec2::new(f64::from(k % w) + 0.5, f64::from(k / w) + 0.5);
        let point = |k| snapshot.hit(&view.camera, centre(k)).map_or(NOWHERE, |hit| canonical(&snapshot, &hit));
        assert!(points.wants(i));
        points.keep(i, (0..w * h).map(point).collect());
    }
    let scores = points.scores(data);
    assert!(scores.iter().map(|s| s.0).eq(0..data.len()), "each view has a score: {scores:?}");
    scores.into_iter().map(|s| s.1).collect()
}

/// Where the point is at time 0.
fn exact(hit: &SnapshotHit) -> [f64; 3] {
    Orbit::new(options().seed, options().motion).at(0.0).place(hit).to_array()
}

fn means(scores: &[Transfer]) -> Transfer {
    let mean = |value: fn(&Transfer) -> f64| scores.iter().map(value).sum::<f64>() / scores.len() as f64;
    Transfer { error: mean(|s| s.error), found: mean(|s| s.found) }
}

#[test]
fn exact_canonical_points_are_found_and_others_are_not() {
    let data = data(None);
    let each = scored(&data, |_, hit| exact(hit));
    println!("exact: {each:?}");
    // What is seen at a grazing angle there may have no pixel centre near.
    assert!(each.iter().all(|s| s.error < 0.8 && s.found > 0.94), "{each:?}");
    let exact = means(&each);
    assert!(exact.error < 0.6 && exact.found > 0.98, "{exact:?}");
    let still = means(&scored(&data, |_, hit| hit.x.to_array()));
    let collapsed = means(&scored(&data, |_, _| [0.1, 0.2, 0.3]));
    let nothing = means(&scored(&data, |_, _| NOWHERE));
    println!("still {still:?}, collapsed {collapsed:?}, nothing {nothing:?}");
    assert!(still.error > 2.0 && still.found < 0.9, "{still:?}");
    // All distances of canonical points are 0, and that must not help.
    assert!(collapsed.error > 8.0 && collapsed.found < 0.1, "{collapsed:?}");
    assert_eq!(nothing, Transfer { error: f64::from(SIDE), found: 0.0 });
    let broken = means(&scored(&data, |_, _| [f64::NAN; 3]));
    assert_eq!(broken, nothing);
}

#[test]
fn what_touches_at_one_time_needs_more_than_space_to_be_told_apart() {
    let options =
        MouthOptions { width: SIDE, height: SIDE, train: 1, val: 0, test: 6, rays: 1, ..MouthOptions::default() };
    let stage = Mouth::new(options.seed);
    let data = held_out(&mouth(&options), None);
    let score = |canonical: &dyn Fn(&SnapshotHit) -> DVec3| {
        means(&scored_at(|time| stage.at(time), &data, |_, hit| canonical(hit).to_array()))
    };
    // Closed lips lie on each other: the points of two cuts have one place there. Not so where each lip has a place of its own.
    let start = stage.at(0.0);
    let closed = score(&|hit: &SnapshotHit| start.place(hit));
    let apart = score(&|hit: &SnapshotHit| start.place(hit) + DVec3::Z * (10.0 * hit.thing as f64));
    println!("closed {closed:?}, apart {apart:?}");
    assert!(apart.error < 1.5 && apart.found > 0.9, "{apart:?}");
    assert!(closed.found < apart.found && closed.error > apart.error, "{closed:?} against {apart:?}");
}

#[test]
fn pictures_that_are_scaled_down_are_scored_in_their_own_pixels() {
    let exact = means(&scored(&data(Some(SIDE / 2)), |_, hit| exact(hit)));
    println!("exact at half the size: {exact:?}");
    // At 24 pixels a side things are a few pixels wide, and a twentieth of the picture is one of them.
    assert!(exact.error < 1.5 && exact.found > 0.8, "{exact:?}");
}

#[test]
fn a_view_without_the_other_one_has_no_score() {
    let scene = orbit(&options());
    let store = Arc::new(ImageStore::new(&scene.frames, StoreOptions::default()).unwrap());
    let first = scene.split(Split::Test).next().unwrap();
    let alone = Dataset::new(&scene, store.clone(), vec![first]).unwrap();
    let mut points = Correspondence::of(&alone).unwrap();
    assert!(!points.wants(0));
    points.keep(0, vec![[0.0; 3]; (SIDE * SIDE) as usize]);
    assert!(points.scores(&alone).is_empty());
    let training = Dataset::new(&scene, store, scene.split(Split::Train).collect()).unwrap();
    assert!(Correspondence::of(&training).unwrap().pairs.is_empty());
}

#[test]
fn the_same_bits_with_1_2_and_4_threads() {
    let there: Vec<[f64; 3]> = (0..600).map(|k| [f64::from(k).sin(), f64::from(k).cos(), 0.1]).collect();
    let sought: Vec<Sought> = (0..200)
        .map(|k| Sought { canonical: [f64::from(k).sin(), 0.3, 0.0], truth: [f64::from(k) / 10.0, 3.0] })
        .collect();
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| transfer(&sought, &there, 30)).unwrap()
    };
    let one = on(1);
    assert!(on(2) == one && on(4) == one);
}

#[test]
fn a_point_is_brought_to_the_nearest_pixel_and_ties_to_the_first() {
    let there: Vec<[f64; 3]> = (0..40).map(|k| [f64::from(k % 20), f64::from(k / 20), 0.0]).collect();
    let at = |canonical, truth| transfer(&[Sought { canonical, truth }], &there, 20).unwrap();
    assert_eq!(at([7.2, 0.9, 5.0], [7.5, 1.5]), Transfer { error: 0.0, found: 1.0 });
    // A twentieth of 20 columns is one pixel.
    assert_eq!(at([7.2, 0.9, 5.0], [8.5, 1.5]), Transfer { error: 1.0, found: 1.0 });
    assert_eq!(at([7.2, 0.9, 5.0], [9.5, 1.5]), Transfer { error: 2.0, found: 0.0 });
    assert_eq!(at([0.5, 0.0, 0.0], [0.5, 0.5]), Transfer { error: 0.0, found: 1.0 });
    assert_eq!(at(NOWHERE, [0.5, 0.5]), Transfer { error: 20.0, found: 0.0 });
    assert_eq!(transfer(&[], &there, 20), None);
    let unseen = [Sought { canonical: [0.0; 3], truth: [0.0; 2] }];
    assert_eq!(transfer(&unseen, &[], 20), Some(Transfer { error: 20.0, found: 0.0 }));
}
