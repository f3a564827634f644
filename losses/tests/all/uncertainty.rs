//! The likelihood with learned uncertainty: gradients, optimum, floor; the price of transient density.

use losses::LossError;
use losses::uncertainty::{Channels, Likelihood, transient_density, transient_density_backward};
use proptest::prelude::*;
use testkit::gradient::{PairTolerances, check_f32_pair, cotangent};

fn colours(x: &[f32]) -> Vec<[f32; 3]> {
    x.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect()
}

/// The square that a ray pays for, from the definition, and its derivative by `e2`.
fn shortened(tail: f64, e2: f64) -> (f64, f64) {
    let root = (1.0 + e2 / (tail * tail)).sqrt();
    if tail > 0.0 { (2.0 * tail * tail * (root - 1.0), 1.0 / root) } else { (e2, 1.0) }
}

/// One ray, from the definition. `x` holds the prediction, then beta.
fn naive(Likelihood { channels, tail, .. }: Likelihood, x: &[f64], target: &[f32; 3]) -> f64 {
    let sum: f64 = (0..3).map(|c| (x[c] - f64::from(target[c])).powi(2)).sum();
    let e2 = if channels == Channels::Mean { sum / 3.0 } else { sum };
    shortened(tail.into(), e2).0 / (2.0 * x[3] * x[3]) + x[3].ln()
}

fn naive_backward(
    Likelihood { channels, tail, .. }: Likelihood,
    x: &[f64],
    target: &[f32; 3],
    bar: f64,
    x_bar: &mut [f64],
) {
    let share = if channels == Channels::Mean { 1.0 / 3.0 } else { 1.0 };
    let d = [0, 1, 2].map(|c| x[c] - f64::from(target[c]));
    let (k2, slope) = shortened(tail.into(), share * d.iter().map(|d| d * d).sum::<f64>());
    (0..3).for_each(|c| x_bar[c] += bar * share * slope * d[c] / x[3].powi(2));
    x_bar[3] += bar * (1.0 / x[3] - k2 / x[3].powi(3));
}

proptest! {
    #![proptest_config(testkit::property::cases(96))]

    #[test]
    fn gradient_matches_twin_and_differences(
        colour in prop::collection::vec(0.0_f32..1.0, 6),
        beta in 0.1_f32..3.0,
        tail in prop_oneof![Just(0.0_f32), 0.02_f32..0.5],
        w in 0.0_f32..2.0,
        seed in 0_u64..1000,
    ) {
        let (target, mut x) = (colours(&colour[3..])[0], colour[..3].to_vec());
        x.push(beta);
        for channels in [Channels::Mean, Channels::Sum] {
            let likelihood = Likelihood::PHOTOGRAPHS.with_beta_min(0.03).with_channels(channels).with_tail(tail);
            let weighted = f64::from(w);
            check_f32_pair(
                &x,
                &[cotangent(1, seed)[0] as f32],
                (
                    |x, out| out[0] = likelihood.mean(&colours(&x[..3]), &[target], &x[3..], Some(&[w])).unwrap() as f32,
                    |x, bar, x_bar| {
                        let (colour_bar, beta_bar) = x_bar.split_at_mut(3);
                        let mut bars = colours(colour_bar);
                        let bar = f64::from(bar[0]);
                        likelihood
                            .mean_backward(&colours(&x[..3]), &[target], &x[3..], Some(&[w]), bar, &mut bars, beta_bar)
                            .unwrap();
                        colour_bar.copy_from_slice(&bars[0]);
                    },
                ),
                (
                    |x, out| out[0] = weighted * naive(likelihood, x, &target),
                    |x, bar, x_bar| naive_backward(likelihood, x, &target, weighted * bar[0], x_bar),
                ),
                PairTolerances::default(),
            )
            .unwrap();
        }
    }

    #[test]
    fn best_beta_is_the_error(colour in prop::collection::vec(0.0_f32..1.0, 6), factor in 1.02_f32..20.0) {
        let (prediction, target) = (colours(&colour[..3]), colours(&colour[3..]));
        for channels in [Channels::Mean, Channels::Sum] {
            let likelihood = Likelihood::PHOTOGRAPHS.with_beta_min(0.03).with_channels(channels);
            let cost = |beta: f32| likelihood.mean(&prediction, &target, &[beta], None).unwrap();
            let e2: f64 = (0..3).map(|c| f64::from(prediction[0][c] - target[0][c]).powi(2)).sum();
            let e = (if channels == Channels::Mean { e2 / 3.0 } else { e2 }).sqrt() as f32;
            let best = e.max(0.03);
            prop_assert!(cost(best) <= cost(best * factor) && cost(best) <= cost(best / factor));
            // As a function of ln(beta) it is convex: the middle lies below the chord, above the floor.
            let (a, b) = (best, best * factor * factor);
            prop_assert!(cost(best * factor) <= 0.5 * (cost(a) + cost(b)) + 1e-5 * (1.0 + cost(a).abs() + cost(b).abs()));
            let mut bars = (vec![[0.0; 3]], vec![0.0]);
            likelihood.mean_backward(&prediction, &target, &[best], None, 1.0, &mut bars.0, &mut bars.1).unwrap();
            // At the floor it may still want to go down, else it stands still.
            let slope = bars.1[0] * best;
            prop_assert!(if best > 0.03 { slope.abs() < 1e-4 } else { slope > -1e-4 }, "{}", slope);
        }
    }

    #[test]
    fn finite_for_every_beta(p in prop::collection::vec(-1.0_f32..2.0, 3), power in -44_i32..38, floor in 0.001_f32..0.3, tail in prop_oneof![Just(0.0_f32), 0.01_f32..0.5]) {
        let prediction = colours(&p);
        for beta in [10.0_f32.powi(power), 0.0, -1.0, floor, f32::MAX] {
            let likelihood = Likelihood::PHOTOGRAPHS.with_beta_min(floor).with_tail(tail);
            let cost = likelihood.mean(&prediction, &[[0.5; 3]], &[beta], None).unwrap();
            prop_assert!(cost.is_finite() && cost >= f64::from(floor).ln(), "{cost} for {beta}");
            let mut bars = (vec![[0.0; 3]], vec![0.0]);
            likelihood.mean_backward(&prediction, &[[0.5; 3]], &[beta], None, 1.0, &mut bars.0, &mut bars.1).unwrap();
            prop_assert!(bars.0[0].iter().chain(&bars.1).all(|b| b.is_finite()));
            // Under the floor: as at the floor, and nothing to learn.
            if beta < floor {
                prop_assert_eq!(cost, likelihood.mean(&prediction, &[[0.5; 3]], &[floor], None).unwrap());
                prop_assert_eq!(bars.1[0], 0.0);
            }
        }
    }

    #[test]
    fn with_a_tail_no_error_pulls_without_end(e in prop_oneof![-1e9_f32..1e9, -2.0_f32..2.0], tail in 0.01_f32..0.5, beta in 0.05_f32..1.0) {
        let tailed = Likelihood::PHOTOGRAPHS.with_tail(tail);
        let (prediction, target) = ([[e, 0.0, 0.0]], [[0.0; 3]]);
        let mut bars = (vec![[0.0; 3]], vec![0.0]);
        tailed.sum_backward(&prediction, &target, &[beta], None, 1.0, &mut bars.0, &mut bars.1).unwrap();
        prop_assert!(bars.0[0][0].abs() <= 1.001 * tail / (beta * beta), "{:?}", bars.0);
        // An error never costs more with a tail, and one well below its scale costs the same.
        let [with, without] = [tailed, Likelihood::PHOTOGRAPHS].map(|l| l.sum(&prediction, &target, &[beta], None).unwrap());
        prop_assert!(with.is_finite() && with <= without);
        if e.abs() < 0.01 * tail {
            prop_assert!((with - without).abs() <= 1e-4 * (without - f64::from(beta).ln()));
        }
    }

    #[test]
    fn batch_is_the_sum_of_rays(x in prop::collection::vec(0.1_f32..1.0, 40), w in prop::collection::vec(0.0_f32..2.0, 5)) {
        let (p, t, beta) = (colours(&x[..15]), colours(&x[15..30]), &x[30..35]);
        let likelihood = Likelihood::PHOTOGRAPHS;
        let mut each = [0.0; 5];
        likelihood.per_ray(&p, &t, beta, &mut each).unwrap();
        let want: f64 = each.iter().zip(&w).map(|(l, w)| f64::from(l * w)).sum();
        let got = likelihood.sum(&p, &t, beta, Some(&w)).unwrap();
        prop_assert!((got - want).abs() <= 1e-5 * each.iter().map(|l| f64::from(l.abs())).sum::<f64>() + 1e-5);
        prop_assert!((likelihood.mean(&p, &t, beta, Some(&w)).unwrap() - got / 5.0).abs() < 1e-12);
    }

    #[test]
    fn transient_density_matches_definition(lengths in prop::collection::vec(0_usize..5, 0..6), values in prop::collection::vec(0.0_f32..9.0, 25)) {
        let mut offsets = vec![0_u32];
        lengths.iter().for_each(|&l| offsets.push(offsets[offsets.len() - 1] + l as u32));
        let n = lengths.iter().sum::<usize>();
        let out_bar = [1.5_f32];
        let definition = |sigma: &[f64]| {
            let ray = |r: usize| {
                let s = &sigma[offsets[r] as usize..offsets[r + 1] as usize];
                if s.is_empty() { 0.0 } else { s.iter().sum::<f64>() / s.len() as f64 }
            };
            (0..lengths.len()).map(ray).sum::<f64>() / lengths.len().max(1) as f64
        };
        check_f32_pair(
            &values[..n],
            &out_bar,
            (
                |s, out| out[0] = transient_density(&offsets, s).unwrap() as f32,
                |_, bar, s_bar| transient_density_backward(&offsets, bar[0].into(), s_bar).unwrap(),
            ),
            (
                |s, out| out[0] = definition(s),
                |_, bar, s_bar| {
                    for (r, &l) in lengths.iter().enumerate() {
                        (offsets[r]..offsets[r + 1]).for_each(|i| s_bar[i as usize] += bar[0] / l as f64 / lengths.len() as f64);
                    }
                },
            ),
            PairTolerances::default(),
        )
        .unwrap();
    }
}

#[test]
fn cost_of_a_perfect_ray_is_the_logarithm() {
    let mut loss = [0.0; 2];
    Likelihood::PHOTOGRAPHS.per_ray(&[[0.5; 3]; 2], &[[0.5; 3]; 2], &[0.03, 1.0], &mut loss).unwrap();
    // Legitimately negative.
    assert!((loss[0] + 3.5066).abs() < 1e-3 && loss[1] == 0.0, "{loss:?}");
}

#[test]
fn nan_is_not_hidden_by_the_floor() {
    let likelihood = Likelihood::PHOTOGRAPHS;
    assert!(likelihood.mean(&[[0.5; 3]], &[[0.5; 3]], &[f32::NAN], None).unwrap().is_nan());
    let mut bars = (vec![[0.0; 3]], vec![0.0]);
    likelihood.mean_backward(&[[0.5; 3]], &[[0.4; 3]], &[f32::NAN], None, 1.0, &mut bars.0, &mut bars.1).unwrap();
    assert!(bars.0[0][0].is_nan() && bars.1[0].is_nan());
}

#[test]
fn empty_batches_and_wrong_arguments() {
    let likelihood = Likelihood::PHOTOGRAPHS;
    assert_eq!(likelihood.mean(&[], &[], &[], None), Ok(0.0));
    assert_eq!(transient_density(&[], &[]), Ok(0.0));
    assert_eq!(transient_density(&[0], &[]), Ok(0.0));
    transient_density_backward(&[0, 0, 0], 1.0, &mut []).unwrap();
    let error = likelihood.mean(&[[0.0; 3]], &[[0.0; 3]], &[], None);
    assert_eq!(error, Err(LossError::Shape { what: "beta", want: 1, got: 0 }));
    let error = likelihood.mean(&[[0.0; 3]], &[[0.0; 3]], &[1.0], Some(&[]));
    assert_eq!(error, Err(LossError::Shape { what: "w", want: 1, got: 0 }));
    assert_eq!(transient_density(&[0, 2, 1], &[0.0]), Err(LossError::Order { what: "offsets" }));
    assert_eq!(transient_density(&[0, 2], &[0.0]), Err(LossError::Shape { what: "sigma", want: 2, got: 1 }));
    for beta_min in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        let error = likelihood.with_beta_min(beta_min).mean(&[], &[], &[], None);
        assert!(matches!(error, Err(LossError::Parameter { .. })));
    }
    for tail in [-0.1, f32::NAN, f32::INFINITY] {
        let error = likelihood.with_tail(tail).mean(&[], &[], &[], None);
        assert!(matches!(error, Err(LossError::Parameter { .. })));
    }
}
