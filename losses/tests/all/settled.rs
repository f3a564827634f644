//! What draws a field to a decision: rays that end on something or nothing, weight in few samples, samples that have the colour of
//! their pixel.

use losses::LossError;
use losses::entropy::{LEAST_WEIGHT, binary, binary_backward, weights, weights_backward};
use losses::point_colour::{of_ray, of_ray_backward};
use proptest::prelude::*;
use testkit::gradient::{PairTolerances, check_f32_pair};

/// From the definition.
fn entropy_twin(p: f64) -> f64 {
    let p = p.clamp(1e-6, 1.0 - 1e-6);
    -p * p.ln() - (1.0 - p) * (1.0 - p).ln()
}

/// From the definition.
fn weights_twin(w: &[f64]) -> f64 {
    -w.iter().map(|&w| w * w.max(1e-12).ln()).sum::<f64>()
}

fn colour_twin(w: &[f64], rgb: &[f64], target: &[f64]) -> f64 {
    let n = w.len();
    (0..3 * n).map(|j| w[j % n] * (rgb[j] - target[j / n]).powi(2)).sum()
}

proptest! {
    #![proptest_config(testkit::property::cases(96))]

    #[test]
    fn entropy_matches_its_twin_and_differences(p in prop::collection::vec(0.001_f32..0.999, 1..20), bar in -2.0_f32..2.0) {
        check_f32_pair(
            &p,
            &[bar],
            (
                |p, out| out[0] = binary(p) as f32,
                |p, bar, p_bar| binary_backward(p, bar[0].into(), p_bar).unwrap(),
            ),
            (
                |p, out| out[0] = p.iter().map(|&p| entropy_twin(p)).sum(),
                |p, bar, p_bar| p.iter().zip(p_bar).for_each(|(p, g)| *g += bar[0] * ((1.0 - p) / p).ln()),
            ),
            PairTolerances::default(),
        )
        .unwrap();
    }

    #[test]
    fn entropy_is_symmetric_and_most_in_the_middle(k in 1_u32..1024) {
        let p = k as f32 / 1024.0;
        let (here, there) = (binary(&[p]), binary(&[1.0 - p]));
        prop_assert!((here - there).abs() < 1e-12 && here > 0.0 && here <= std::f64::consts::LN_2 + 1e-12);
    }

    #[test]
    fn entropy_of_weights_matches_its_twin_and_differences(
        w in prop::collection::vec(0.001_f32..1.0, 1..20),
        bar in -2.0_f32..2.0,
    ) {
        check_f32_pair(
            &w,
            &[bar],
            (
                |w, out| out[0] = weights(w) as f32,
                |w, bar, w_bar| weights_backward(w, bar[0].into(), w_bar).unwrap(),
            ),
            (
                |w, out| out[0] = weights_twin(w),
                |w, bar, w_bar| w.iter().zip(w_bar).for_each(|(w, g)| *g += bar[0] * (-w.ln() - 1.0)),
            ),
            PairTolerances::default(),
        )
        .unwrap();
    }

    #[test]
    fn weight_that_is_spread_costs_the_logarithm_of_how_far(n in 1_usize..200) {
        let spread = weights(&vec![1.0 / n as f32; n]);
        prop_assert!((spread - (n as f64).ln()).abs() < 1e-6, "{spread}");
    }

    #[test]
    fn point_colour_matches_its_twin_and_differences(
        samples in prop::collection::vec((0.0_f32..1.0, prop::array::uniform3(0.0_f32..1.0)), 1..20),
        target in prop::array::uniform3(0.0_f32..1.0),
        bar in -2.0_f32..2.0,
    ) {
        let n = samples.len();
        let w: Vec<f32> = samples.iter().map(|s| s.0).collect();
        let rgb: Vec<f32> = (0..3).flat_map(|c| samples.iter().map(move |s| s.1[c])).collect();
        let wide = |x: &[f32]| x.iter().map(|&x| f64::from(x)).collect::<Vec<f64>>();
        let (w64, target64) = (wide(&w), wide(&target));
        let rows = |x: &[f32]| [0, 1, 2].map(|c| x[c * n..][..n].to_vec());
        check_f32_pair(
            &rgb,
            &[bar],
            (
                |rgb, out| out[0] = of_ray(&w, rows(rgb).each_ref().map(|r| &r[..]), target).unwrap() as f32,
                |rgb, bar, rgb_bar| {
                    let (r, gb) = rgb_bar.split_at_mut(n);
                    let (g, b) = gb.split_at_mut(n);
                    let rows = rows(rgb);
                    of_ray_backward(&w, rows.each_ref().map(|r| &r[..]), target, bar[0].into(), [r, g, b]).unwrap();
                },
            ),
            (
                |rgb, out| out[0] = colour_twin(&w64, rgb, &target64),
                |rgb, bar, rgb_bar| {
                    (0..3 * n).for_each(|j| rgb_bar[j] += bar[0] * 2.0 * w64[j % n] * (rgb[j] - target64[j / n]));
                },
            ),
            PairTolerances::default(),
        )
        .unwrap();
    }
}

#[test]
fn entropy_matches_values_made_elsewhere() {
    // Inputs and sums of an independent f64 implementation, with the same clamp.
    for (p, want) in [
        (vec![0.0625; 16], 3.7406665393033482),
        (vec![0.0, 0.0, 0.999_000_012_874_603_3, 0.0, 0.0, 0.0, 0.0, 0.0], 0.008010874760827411),
        (vec![0.0; 8], 0.00011852408046394287),
        (vec![1.0000000195414814e-25; 8], 0.00011852408046394287),
    ] {
        let p: Vec<f32> = p.iter().map(|&p: &f64| p as f32).collect();
        assert!((binary(&p) / want - 1.0).abs() < 1e-10, "{} {want}", binary(&p));
    }
}

#[test]
fn what_is_decided_has_no_slope_and_extremes_stay_finite() {
    let p = [0.0, 1e-45, 1e-30, 1e-7, 1.0 - f32::EPSILON / 2.0, 1.0, -1.0, 2.0];
    let mut p_bar = [0.0; 8];
    binary_backward(&p, 1.0, &mut p_bar).unwrap();
    assert!(binary(&p).is_finite() && p_bar == [0.0; 8], "{p_bar:?}");
    assert_eq!(binary(&[]), 0.0);
    for (w, c) in [(0.0, 1e30), (1.0, 1e15), (1e-45, 1e-45), (1e-20, 1e18)] {
        let mut bars = [[0.0]; 3];
        let loss = of_ray(&[w], [&[c]; 3], [0.5; 3]).unwrap();
        let [r, g, b] = &mut bars;
        of_ray_backward(&[w], [&[c]; 3], [0.5; 3], 1.0, [r, g, b]).unwrap();
        assert!(loss.is_finite() && bars.as_flattened().iter().all(|x| x.is_finite()), "{w} {c}");
    }
    assert_eq!(of_ray(&[], [&[]; 3], [0.5; 3]).unwrap(), 0.0);
}

#[test]
fn weight_in_one_sample_costs_nothing_and_extremes_stay_finite() {
    assert_eq!((weights(&[]), weights(&[0.0, 1.0, 0.0])), (0.0, 0.0));
    let w = [0.0, 1e-45, 1e-30, 1e-12, 1.0, 2.0];
    let mut w_bar = [0.0; 6];
    weights_backward(&w, 1.0, &mut w_bar).unwrap();
    assert!(weights(&w).is_finite() && w_bar.iter().all(|g| g.is_finite()), "{w_bar:?}");
    // Below the floor it is a line.
    let steepest = -LEAST_WEIGHT.ln() as f32;
    assert_eq!((w_bar[0], w_bar[2], w_bar[4]), (steepest, steepest, -1.0));
    assert!(weights(&[f32::NAN]).is_nan());
    weights_backward(&[f32::NAN], 1.0, &mut w_bar[..1]).unwrap();
    assert!(w_bar[0].is_nan());
}

#[test]
fn samples_of_the_right_colour_and_unseen_ones_cost_nothing() {
    assert_eq!(of_ray(&[0.7, 0.0], [&[0.25, 1.0]; 3], [0.25; 3]).unwrap(), 0.0);
    assert_eq!(of_ray(&[0.5], [&[1.0], &[0.0], &[0.0]], [0.0; 3]).unwrap(), 0.5);
}

#[test]
fn lengths_are_checked() {
    assert!(matches!(binary_backward(&[0.5], 1.0, &mut []), Err(LossError::Shape { .. })));
    assert!(matches!(weights_backward(&[0.5], 1.0, &mut []), Err(LossError::Shape { .. })));
    assert!(matches!(of_ray(&[0.5], [&[0.5], &[], &[0.5]], [0.0; 3]), Err(LossError::Shape { .. })));
    let bars: [&mut [f32]; 3] = [&mut [0.0], &mut [0.0], &mut []];
    assert!(of_ray_backward(&[0.5], [&[0.5]; 3], [0.0; 3], 1.0, bars).is_err());
}
