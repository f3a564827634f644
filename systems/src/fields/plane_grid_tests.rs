//! Planes that only points change: what no point has seen stays, and the rest is as if all had been stepped.

use super::*;

const SETTINGS: PlaneGridSettings = PlaneGridSettings {
    plane_vertices: 16,
    plane_scales: Vec::new(),
    plane_features: 3,
    plane_times: 4,
    plane_variation: 0.0,
    plane_smoothness: 0.1,
    plane_transients: 1e-3,
};

fn made(variation: f32) -> Box<dyn Features> {
    let settings = PlaneGridSettings { plane_scales: vec![1, 2], plane_variation: variation, ..SETTINGS };
    PlaneGridSource::new(settings, [-1.0, 0.0, 1.0].into()).features(Rng::new(5, 1)).unwrap()
}

/// Points in a corner of the cube.
fn points(n: usize) -> (Vec<f32>, Vec<f32>) {
    let (mut x, mut times) = (vec![0.0; 3 * n], vec![0.0; n]);
    Rng::new(6, 1).fill_uniform(0, &mut x);
    Rng::new(6, 2).fill_uniform(0, &mut times);
    x.iter_mut().for_each(|x| *x = 0.2 * *x + 0.1);
    times.iter_mut().for_each(|t| *t = 2.0 * *t - 1.0);
    (x, times)
}

fn step(features: &mut dyn Features, n: usize) -> usize {
    let (x, times) = points(n);
    let raw_bar: Vec<f32> = (0..features.rows() * n).map(|i| 0.1 + (i % 7) as f32).collect();
    features.step(0.01, &[Part { places: Places { x: &x, times: &times }, raw_bar: &raw_bar }])
}

#[test]
fn a_first_step_is_that_of_all_numbers_and_what_no_point_saw_never_moves() {
    // Variation so small that its gradient is lost in rounding, but for which all numbers are stepped.
    let (mut all, mut seen) = (made(1e-30), made(0.0));
    let before = seen.parameters().to_vec();
    assert_eq!((step(&mut *all, 40), step(&mut *seen, 40)), (0, 0));
    for (i, (a, b)) in all.parameters().iter().zip(seen.parameters()).enumerate() {
        // Where nothing was seen, next to nothing is a whole step for Adam.
        assert!(a == b || *b == before[i], "{i}: {a} and {b}");
    }
    for _ in 0..5 {
        assert_eq!(step(&mut *seen, 40), 0);
    }
    let moved = seen.parameters().iter().zip(&before).filter(|(a, b)| a != b).count();
    let share = moved as f64 / before.len() as f64;
    println!("{share}");
    assert!((0.05..0.6).contains(&share), "{share}");
    // None of the rows far from all points: of the planes of space, whose rows are long.
    let far = |x: f32| (0.5 - x).abs() < 0.1;
    let (mut x, times) = points(40);
    x.iter_mut().for_each(|x| *x += 0.5);
    assert!(x.iter().all(|x| !far(*x)));
    let at = |features: &dyn Features| {
        let mut out = vec![0.0; features.rows() * 40];
        features.encode(Places { x: &x, times: &times }, &mut out, &mut Vec::new());
        out
    };
    // Planes of time are smooth everywhere: what is there at rest stays at rest.
    assert_eq!(at(&*seen), at(&*made(0.0)));
}

#[test]
fn no_points_change_no_plane_of_space() {
    let mut features = made(0.0);
    let before = features.parameters().to_vec();
    assert_eq!(step(&mut *features, 0), 0);
    assert_eq!(features.parameters(), before, "planes of time are at rest from the beginning");
}
