//! Opacities over the picture: Binary Concrete, their smoothness, what prefers less of them and of density.

use losses::LossError;
use losses::concrete::{Annealing, BinaryConcrete, ln_odds, ln_odds_derivative, noise};
use losses::smoothness::{smoothness, smoothness_backward};
use losses::sparsity;
use proptest::prelude::*;
use testkit::gradient::{PairTolerances, Tolerance, check_f32_pair, cotangent};

fn softplus(h: f64) -> f64 {
    h.max(0.0) + (-h.abs()).exp().ln_1p()
}

fn logistic(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

/// `alpha` and its derivative, from the definition.
fn twin(h: f64, u: f64, temperature: f64) -> (f64, f64) {
    let eps = f64::from(1e-8_f32);
    let x = (softplus(h).ln() + (u + eps).ln() - (1.0 - u + eps).ln()) / temperature;
    (logistic(x), logistic(x) * logistic(-x) / temperature * logistic(h) / softplus(h))
}

proptest! {
    #![proptest_config(testkit::property::cases(96))]

    #[test]
    fn concrete_matches_twin_and_differences(
        h in prop::collection::vec(-25.0_f32..25.0, 1..16),
        u in prop::collection::vec(0.001_f32..0.999, 16),
        temperature in prop_oneof![Just(1.0_f32), 0.1_f32..3.0],
        seed in 0_u64..100,
    ) {
        let (concrete, u) = (BinaryConcrete { temperature }, &u[..h.len()]);
        for u in [Some(u), None] {
            let at = |i: usize| f64::from(u.map_or(0.5, |u| u[i]));
            let of = |h: &[f64], i: usize| twin(h[i], at(i), temperature.into());
            let bar: Vec<f32> = cotangent(h.len(), seed).iter().map(|&b| b as f32).collect();
            check_f32_pair(
                &h,
                &bar,
                (
                    |h, alpha| concrete.forward(h, u, alpha).unwrap(),
                    |h, bar, h_bar| concrete.backward(h, u, bar, h_bar).unwrap(),
                ),
                (
                    |h, alpha| (0..h.len()).for_each(|i| alpha[i] = of(h, i).0),
                    |h, bar, h_bar| (0..h.len()).for_each(|i| h_bar[i] += bar[i] * of(h, i).1),
                ),
                PairTolerances { twin: Tolerance::new(1e-6, 1e-8), ..PairTolerances::default() },
            )
            .unwrap();
        }
    }

    #[test]
    fn opacity_is_a_coin_toss_with_the_right_odds(odds in 0.02_f32..50.0, temperature in 0.05_f32..3.0) {
        // Every 1000th of the unit interval: P(alpha > 1/2) = x / (1 + x), whatever the temperature.
        let concrete = BinaryConcrete { temperature };
        let draws = (0..1000).map(|i| concrete.sample(odds.ln(), noise((i as f32 + 0.5) / 1000.0)));
        let heads = draws.filter(|&a| a > 0.5).count() as f32 / 1000.0;
        prop_assert!((heads - odds / (1.0 + odds)).abs() <= 1.01e-3, "{heads}");
    }

    #[test]
    fn exchanging_the_sides_exchanges_the_outcome(ln_odds in -20.0_f32..20.0, u in 0.0_f32..=1.0, temperature in 0.1_f32..3.0) {
        let concrete = BinaryConcrete { temperature };
        // A number whose distance from 1 is exact: a rounded one has other odds.
        let u = (u * 16_777_216.0).round() / 16_777_216.0;
        let (one, other) = (concrete.sample(ln_odds, noise(u)), concrete.sample(-ln_odds, noise(1.0 - u)));
        prop_assert!((one + other - 1.0).abs() < 2e-5 / temperature, "{one} {other}");
        prop_assert!((0.0..=1.0).contains(&one));
    }

    #[test]
    fn smoothness_matches_twin_and_differences(d in prop::collection::vec(-2.0_f32..2.0, 24), octaves in 1_usize..5, seed in 0_u64..100) {
        let n = 24 / (octaves * 2);
        let d = &d[..octaves * 2 * n];
        prop_assume!(d.iter().all(|d| d.abs() > 1e-4));
        let factor = move |i: usize| 2.0_f64.powi((i / (2 * n)) as i32) / n as f64;
        check_f32_pair(
            d,
            &[cotangent(1, seed)[0] as f32],
            (
                |d, out| out[0] = smoothness(d, octaves, 2).unwrap() as f32,
                |d, bar, d_bar| smoothness_backward(d, octaves, 2, bar[0].into(), d_bar).unwrap(),
            ),
            (
                |d, out| out[0] = d.iter().enumerate().map(|(i, d)| factor(i) * d.abs()).sum(),
                |d, bar, d_bar| d.iter().enumerate().for_each(|(i, d)| d_bar[i] += bar[0] * factor(i) * d.signum()),
            ),
            PairTolerances::default(),
        )
        .unwrap();
    }

    /// What the term is for: times pi it bounds how steep the opacity is over the picture.
    #[test]
    fn smoothness_bounds_the_slope_over_the_picture(w in prop::collection::vec(-1.0_f64..1.0, 20), p in [0.0_f64..1.0, 0.0_f64..1.0]) {
        // alpha = logistic(w . gamma(p)), gamma the sines and cosines of 5 octaves: rows sin x, sin y, cos x, cos y.
        let angle = |k: usize, axis: usize, p: &[f64]| 2.0_f64.powi(k as i32) * std::f64::consts::PI * p[axis];
        let inner = |p: &[f64]| -> f64 {
            (0..5).map(|k| (0..4).map(|r| {
                let a = angle(k, r % 2, p);
                w[4 * k + r] * if r < 2 { a.sin() } else { a.cos() }
            }).sum::<f64>()).sum()
        };
        let alpha = logistic(inner(&p));
        let d: Vec<f32> = w.iter().map(|w| (alpha * (1.0 - alpha) * w) as f32).collect();
        let slope: f64 = (0..2).map(|axis| {
            let (mut up, mut down) = (p, p);
            up[axis] += 1e-7;
            down[axis] -= 1e-7;
            ((logistic(inner(&up)) - logistic(inner(&down))) / 2e-7).abs()
        }).sum();
        let loss = smoothness(&d, 5, 4).unwrap();
        prop_assert!(slope <= std::f64::consts::PI * loss * (1.0 + 1e-5) + 1e-6, "{slope} above pi times {loss}");
    }

    #[test]
    fn density_prior_matches_twin_and_differences(sigma in prop::collection::vec(0.0_f32..50.0, 1..20), seed in 0_u64..100) {
        let n = sigma.len() as f64;
        check_f32_pair(
            &sigma,
            &[cotangent(1, seed)[0] as f32],
            (
                |s, out| out[0] = sparsity::density(s) as f32,
                |s, bar, s_bar| sparsity::density_backward(s, bar[0].into(), s_bar).unwrap(),
            ),
            (
                |s, out| out[0] = s.iter().map(|s| (2.0 * s * s).ln_1p()).sum::<f64>() / n,
                |s, bar, s_bar| s_bar.iter_mut().zip(s).for_each(|(b, s)| *b += bar[0] * 4.0 * s / (1.0 + 2.0 * s * s) / n),
            ),
            PairTolerances::default(),
        )
        .unwrap();
        check_f32_pair(
            &sigma,
            &[1.5],
            (
                |s, out| out[0] = sparsity::opacity(s) as f32,
                |_, bar, s_bar| sparsity::opacity_backward(bar[0].into(), s_bar),
            ),
            (
                |s, out| out[0] = s.iter().sum::<f64>() / n,
                |_, bar, s_bar| s_bar.iter_mut().for_each(|b| *b += bar[0] / n),
            ),
            PairTolerances::default(),
        )
        .unwrap();
    }
}

#[test]
fn evaluation_is_the_odds_at_one_half() {
    for h in [-10.0_f32, -1.0, 0.0, 0.7, 5.0, 40.0] {
        let odds = softplus(h.into());
        for temperature in [0.1_f32, 0.5, 1.0] {
            let mut alpha = [f32::NAN];
            BinaryConcrete { temperature }.forward(&[h], None, &mut alpha).unwrap();
            let power = odds.powf(1.0 / f64::from(temperature));
            assert!((f64::from(alpha[0]) - power / (1.0 + power)).abs() < 2e-6, "{h}, {temperature}: {}", alpha[0]);
        }
    }
}

#[test]
fn a_cold_concrete_is_a_coin() {
    let cold = BinaryConcrete { temperature: 1e-3 };
    for u in [0.1_f32, 0.3, 0.4, 0.6, 0.9] {
        // Odds 1: heads above one half.
        assert_eq!(cold.sample(0.0, noise(u)), if u > 0.5 { 1.0 } else { 0.0 });
    }
}

#[test]
fn logarithm_of_the_odds_has_no_seam_and_no_end() {
    for h in [-15.001_f32, -14.999, -8.0, 0.0, 3.0, 20.0, 90.0] {
        let want = softplus(h.into()).ln();
        assert!((f64::from(ln_odds(h)) - want).abs() <= 3e-7 * want.abs().max(1.0), "{h}: {} {want}", ln_odds(h));
        let want = logistic(h.into()) / softplus(h.into());
        assert!(
            (f64::from(ln_odds_derivative(h)) - want).abs() <= 1e-6 * want,
            "{h}: {} {want}",
            ln_odds_derivative(h)
        );
    }
    let ends = [f32::MIN, -1e30, -1e4, -200.0, -104.0, 1e4, 1e30, f32::MAX];
    for h in ends {
        let (value, slope) = (ln_odds(h), ln_odds_derivative(h));
        assert!(value.is_finite() && (0.0..=1.0).contains(&slope), "{h}: {value}, {slope}");
    }
    for (h, u) in ends.into_iter().flat_map(|h| [0.0, 1e-45, 0.5, 0.999_999_94, 1.0].map(|u| (h, u))) {
        let (concrete, mut alpha, mut h_bar) = (BinaryConcrete { temperature: 0.1 }, [f32::NAN], [0.0]);
        concrete.forward(&[h], Some(&[u]), &mut alpha).unwrap();
        concrete.backward(&[h], Some(&[u]), &[1.0], &mut h_bar).unwrap();
        assert!((0.0..=1.0).contains(&alpha[0]) && h_bar[0].is_finite(), "{h}, {u}: {alpha:?} {h_bar:?}");
    }
    assert!(ln_odds(f32::NAN).is_nan() && noise(0.5) == 0.0);
    assert!(noise(0.0) > -18.5 && noise(1.0) < 18.5);
}

#[test]
fn temperature_falls_to_its_floor() {
    let annealing = Annealing { start: 1.0, rate: 1e-3, floor: 0.1 };
    let temperatures = [0, 1000, 100_000].map(|step| annealing.at(step).temperature);
    assert_eq!(temperatures, [1.0, (-1.0_f64).exp() as f32, 0.1]);
}

#[test]
fn smoothness_is_zero_where_the_place_does_not_matter() {
    assert_eq!(smoothness(&[0.0; 12], 3, 4), Ok(0.0));
    let mut bar = [0.0; 12];
    smoothness_backward(&[0.0; 12], 3, 4, 1.0, &mut bar).unwrap();
    assert_eq!(bar, [0.0; 12]);
}

#[test]
fn density_prior_holds_at_extremes() {
    let sigma = [0.0_f32, 1e-45, 1e-20, 1e15, f32::MAX, f32::INFINITY];
    assert!(sparsity::density(&sigma[..5]).is_finite());
    let mut bar = [0.0; 6];
    sparsity::density_backward(&sigma, 6.0, &mut bar).unwrap();
    assert!(bar.iter().all(|b| b.is_finite() && *b >= 0.0), "{bar:?}");
}

#[test]
fn empty_batches_and_wrong_arguments() {
    let concrete = BinaryConcrete::default();
    concrete.forward(&[], None, &mut []).unwrap();
    concrete.backward(&[], Some(&[]), &[], &mut []).unwrap();
    assert_eq!((sparsity::density(&[]), sparsity::opacity(&[])), (0.0, 0.0));
    sparsity::opacity_backward(1.0, &mut []);
    assert_eq!((smoothness(&[], 5, 4), smoothness(&[], 0, 4)), (Ok(0.0), Ok(0.0)));
    smoothness_backward(&[], 5, 4, 1.0, &mut []).unwrap();
    assert_eq!(smoothness(&[0.0; 9], 2, 4), Err(LossError::Shape { what: "d", want: 16, got: 9 }));
    assert_eq!(smoothness(&[0.0; 9], 0, 4), Err(LossError::Shape { what: "d", want: 0, got: 9 }));
    assert_eq!(concrete.forward(&[0.0], None, &mut []), Err(LossError::Shape { what: "alpha", want: 1, got: 0 }));
    assert!(concrete.forward(&[0.0], Some(&[]), &mut [0.0]).is_err());
    for temperature in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        let error = BinaryConcrete { temperature }.forward(&[], None, &mut []);
        assert!(matches!(error, Err(LossError::Parameter { .. })));
    }
}
