//! Regularisers of feature planes against their definitions in `f64`, gradients, extremes.

use crate::SUMS;
use losses::LossError;
use losses::planes::{
    Along, PlaneShape, distance_from_one, distance_from_one_backward, plane_variation, plane_variation_backward,
    time_smoothness, time_smoothness_backward,
};
use proptest::prelude::*;
use testkit::gradient::{Tolerance, check_f32_pair, check_kinked};

/// Entry of a plane `[rows][columns][features]`.
fn at(shape: PlaneShape, row: usize, column: usize, feature: usize) -> usize {
    (row * shape.columns + column) * shape.features + feature
}

/// Index lists of all differences along an axis, with their factors, grouped: `order + 1` entries each.
fn differences(shape: PlaneShape, in_rows: bool, order: usize) -> Vec<Vec<(usize, f64)>> {
    let factors: &[f64] = if order == 1 { &[-1.0, 1.0] } else { &[1.0, -2.0, 1.0] };
    let mut all = Vec::new();
    for row in 0..shape.rows {
        for column in 0..shape.columns {
            let room = if in_rows { shape.rows - row } else { shape.columns - column };
            for feature in 0..if room > order { shape.features } else { 0 } {
                let step = |k: usize| if in_rows { (row + k, column) } else { (row, column + k) };
                let entry = |k: usize| at(shape, step(k).0, step(k).1, feature);
                all.push(factors.iter().enumerate().map(|(k, f)| (entry(k), *f)).collect());
            }
        }
    }
    all
}

fn mean_square(x: &[f64], differences: &[Vec<(usize, f64)>]) -> f64 {
    let square = |d: &Vec<(usize, f64)>| d.iter().map(|&(i, f)| f * x[i]).sum::<f64>().powi(2);
    differences.iter().map(square).sum::<f64>() / differences.len().max(1) as f64
}

fn mean_square_backward(x: &[f64], differences: &[Vec<(usize, f64)>], bar: f64, x_bar: &mut [f64]) {
    for d in differences {
        let value: f64 = d.iter().map(|&(i, f)| f * x[i]).sum();
        d.iter().for_each(|&(i, f)| x_bar[i] += bar * 2.0 * value * f / differences.len() as f64);
    }
}

fn planes() -> impl Strategy<Value = (PlaneShape, Vec<f32>)> {
    (0..6_usize, 0..6_usize, 1..4_usize).prop_flat_map(|(rows, columns, features)| {
        let shape = PlaneShape { rows, columns, features };
        (Just(shape), prop::collection::vec(-2.0_f32..2.0, rows * columns * features))
    })
}

proptest! {
    #![proptest_config(testkit::property::cases(96))]

    #[test]
    fn variation_is_its_definition((shape, plane) in planes(), both in any::<bool>(), bar in 0.1..2.0_f32) {
        let along = if both { Along::Both } else { Along::First };
        let rows = if both { differences(shape, true, 1) } else { Vec::new() };
        let columns = differences(shape, false, 1);
        check_f32_pair(
            &plane,
            &[bar],
            (
                |x: &[f32], out: &mut [f32]| out[0] = plane_variation(x, shape, along).unwrap() as f32,
                |x: &[f32], bar: &[f32], x_bar: &mut [f32]| {
                    plane_variation_backward(x, shape, along, bar[0].into(), x_bar).unwrap();
                },
            ),
            (
                |x: &[f64], out: &mut [f64]| out[0] = 0.5 * (mean_square(x, &rows) + mean_square(x, &columns)),
                |x: &[f64], bar: &[f64], x_bar: &mut [f64]| {
                    mean_square_backward(x, &rows, 0.5 * bar[0], x_bar);
                    mean_square_backward(x, &columns, 0.5 * bar[0], x_bar);
                },
            ),
            SUMS,
        ).unwrap();
    }

    #[test]
    fn smoothness_is_its_definition((shape, plane) in planes(), bar in 0.1..2.0_f32) {
        let triples = differences(shape, true, 2);
        check_f32_pair(
            &plane,
            &[bar],
            (
                |x: &[f32], out: &mut [f32]| out[0] = time_smoothness(x, shape).unwrap() as f32,
                |x: &[f32], bar: &[f32], x_bar: &mut [f32]| {
                    time_smoothness_backward(x, shape, bar[0].into(), x_bar).unwrap();
                },
            ),
            (
                |x: &[f64], out: &mut [f64]| out[0] = mean_square(x, &triples),
                |x: &[f64], bar: &[f64], x_bar: &mut [f64]| mean_square_backward(x, &triples, bar[0], x_bar),
            ),
            SUMS,
        ).unwrap();
    }

    #[test]
    fn the_distance_from_one_is_its_definition((_, plane) in planes()) {
        let wide: Vec<f64> = plane.iter().map(|&p| p.into()).collect();
        let mean = |x: &[f64]| x.iter().map(|x| (1.0 - x).abs()).sum::<f64>() / x.len().max(1) as f64;
        prop_assert!((distance_from_one(&plane) - mean(&wide)).abs() < 1e-12);
        check_kinked(
            &wide,
            &[1.0],
            |x: &[f64], out: &mut [f64]| out[0] = mean(x),
            |x: &[f64], bar: &[f64], x_bar: &mut [f64]| {
                let x: Vec<f32> = x.iter().map(|&x| x as f32).collect();
                let mut own = vec![0.0; x.len()];
                distance_from_one_backward(&x, bar[0], &mut own).unwrap();
                x_bar.iter_mut().zip(&own).for_each(|(x, &o)| *x += f64::from(o));
            },
            Tolerance::new(1e-6, 1e-6),
            1.0,
        ).unwrap();
    }

    #[test]
    fn motion_at_a_steady_rate_is_smooth(steps in 0..8_usize, width in 0..5_usize, rate in -8..8_i32) {
        // Halves are exact, and so are their differences.
        let row = |t: usize| (0..width).map(move |i| 0.5 * (rate * t as i32) as f32 + i as f32);
        let plane: Vec<f32> = (0..steps).flat_map(row).collect();
        let shape = PlaneShape { rows: steps, columns: width, features: 1 };
        prop_assert_eq!(time_smoothness(&plane, shape).unwrap(), 0.0);
        let mut bar = vec![0.0; plane.len()];
        time_smoothness_backward(&plane, shape, 1.0, &mut bar).unwrap();
        prop_assert!(bar.iter().all(|b| *b == 0.0));
    }
}

#[test]
fn planes_of_ones_cost_nothing_at_all() {
    let shape = PlaneShape { rows: 4, columns: 3, features: 2 };
    let (plane, mut bar) = ([1.0; 24], [0.0; 24]);
    assert_eq!(plane_variation(&plane, shape, Along::Both), Ok(0.0));
    assert_eq!(time_smoothness(&plane, shape), Ok(0.0));
    assert_eq!(distance_from_one(&plane), 0.0);
    plane_variation_backward(&plane, shape, Along::Both, 1.0, &mut bar).unwrap();
    time_smoothness_backward(&plane, shape, 1.0, &mut bar).unwrap();
    distance_from_one_backward(&plane, 1.0, &mut bar).unwrap();
    assert_eq!(bar, [0.0; 24]);
}

#[test]
fn too_few_vertices_cost_nothing() {
    for (rows, columns, features) in [(0, 0, 0), (0, 3, 2), (3, 0, 2), (2, 1, 1), (1, 1, 4)] {
        let shape = PlaneShape { rows, columns, features };
        let plane: Vec<f32> = (0..rows * columns * features).map(|i| i as f32).collect();
        let mut bar = vec![0.0; plane.len()];
        assert_eq!(time_smoothness(&plane, shape), Ok(0.0));
        time_smoothness_backward(&plane, shape, 1.0, &mut bar).unwrap();
        assert_eq!(plane_variation(&plane, shape, Along::First), Ok(0.0));
        plane_variation_backward(&plane, shape, Along::First, 1.0, &mut bar).unwrap();
        assert!(bar.iter().all(|b| *b == 0.0));
    }
    assert_eq!(distance_from_one(&[]), 0.0);
    assert_eq!(distance_from_one_backward(&[], 1.0, &mut []), Ok(()));
}

#[test]
fn extremes_stay_finite_and_nan_is_seen() {
    let shape = PlaneShape { rows: 3, columns: 2, features: 1 };
    let plane = [1e18, -1e18, 1e-40, 0.0, -0.0, 1e18];
    let mut bar = [0.0; 6];
    assert!(plane_variation(&plane, shape, Along::Both).unwrap().is_finite());
    assert!(time_smoothness(&plane, shape).unwrap().is_finite());
    assert!(distance_from_one(&plane).is_finite());
    plane_variation_backward(&plane, shape, Along::Both, 1.0, &mut bar).unwrap();
    time_smoothness_backward(&plane, shape, 1.0, &mut bar).unwrap();
    distance_from_one_backward(&plane, 1.0, &mut bar).unwrap();
    assert!(bar.iter().all(|b| b.is_finite()), "{bar:?}");
    let plane = [f32::NAN, 0.0, 1.0, 2.0, 1.0, 0.0];
    assert!(time_smoothness(&plane, shape).unwrap().is_nan() && distance_from_one(&plane).is_nan());
    distance_from_one_backward(&plane, 1.0, &mut bar).unwrap();
    assert!(bar[0].is_nan() && bar[1..].iter().all(|b| b.is_finite()));
}

#[test]
fn wrong_shapes_are_named() {
    let shape = PlaneShape { rows: 3, columns: 2, features: 2 };
    let want = |what, want, got| LossError::Shape { what, want, got };
    assert_eq!(time_smoothness(&[0.0; 11], shape), Err(want("plane", 12, 11)));
    assert_eq!(time_smoothness_backward(&[0.0; 12], shape, 1.0, &mut [0.0]), Err(want("plane_bar", 12, 1)));
    assert_eq!(plane_variation(&[0.0; 11], shape, Along::Both), Err(want("x", 12, 11)));
    assert_eq!(distance_from_one_backward(&[0.0; 2], 1.0, &mut [0.0]), Err(want("plane_bar", 2, 1)));
    let huge = PlaneShape { rows: usize::MAX, columns: usize::MAX, features: 2 };
    assert_eq!(time_smoothness(&[], huge), Err(want("plane", usize::MAX, 0)));
}
