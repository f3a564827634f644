//! Depth losses: fits that don't depend on what they fit away, gradients, batches without shape.

use losses::LossError;
use losses::depth::median::{Alignment, aligned, aligned_backward};
use losses::depth::pearson::{STEEPEST, pearson, pearson_backward};
use losses::depth::ranking::{ranking, ranking_backward};
use losses::depth::{ENDO_DELTA, ScaleShift, supervised, supervised_backward};
use losses::kernel::Kernel;
use proptest::prelude::*;
use testkit::gradient::{PairTolerances, Tolerance, central_difference, check_f32_pair, check_pair};

fn wide(x: &[f32]) -> Vec<f64> {
    x.iter().map(|&x| f64::from(x)).collect()
}

/// Prediction, target and weights of a batch.
fn batches(least: usize) -> impl Strategy<Value = (Vec<f32>, Vec<f32>, Vec<f32>)> {
    (least..40).prop_flat_map(|n| {
        (
            prop::collection::vec(0.5_f32..5.0, n),
            prop::collection::vec(-2.0_f32..3.0, n),
            prop::collection::vec(prop_oneof![2 => Just(1.0_f32), 1 => Just(0.0), 1 => 0.1_f32..3.0], n),
        )
    })
}

/// Scale, shift, loss from the normal equations.
fn fit_twin(p: &[f64], t: &[f64], w: &[f64]) -> [f64; 3] {
    let sum = |f: &dyn Fn(usize) -> f64| (0..p.len()).map(|i| w[i] * f(i)).sum::<f64>();
    let (a, b, m) = (sum(&|i| p[i] * p[i]), sum(&|i| p[i]), sum(&|_| 1.0));
    let (c, d) = (sum(&|i| p[i] * t[i]), sum(&|i| t[i]));
    let det = a * m - b * b;
    let (scale, shift) = ((m * c - b * d) / det, (a * d - b * c) / det);
    [scale, shift, sum(&|i| (scale * p[i] + shift - t[i]).powi(2)) / (2.0 * m)]
}

/// The aligned loss by sorting.
fn aligned_twin(p: &[f64], t: &[f64]) -> f64 {
    let normal = |d: &[f64]| -> Vec<f64> {
        let mut sorted = d.to_vec();
        sorted.sort_by(f64::total_cmp);
        let median = sorted[(d.len() - 1) / 2];
        let deviation = d.iter().map(|d| (d - median).abs()).sum::<f64>() / d.len() as f64;
        d.iter().map(|d| (d - median) / deviation).collect()
    };
    normal(p).iter().zip(normal(t)).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / p.len() as f64
}

fn spread(w: &[f32], p: &[f32]) -> f64 {
    let seen: Vec<f64> = p.iter().zip(w).filter(|(_, w)| **w > 0.0).map(|(&p, _)| f64::from(p)).collect();
    let mean = seen.iter().sum::<f64>() / seen.len().max(1) as f64;
    seen.iter().map(|p| (p - mean).powi(2)).sum::<f64>()
}

proptest! {
    #![proptest_config(testkit::property::cases(96))]

    #[test]
    fn scale_and_shift_solve_the_normal_equations((p, t, w) in batches(3)) {
        prop_assume!(spread(&w, &p) > 0.1);
        let fit = ScaleShift::fit(&p, &t, &w).unwrap().unwrap();
        let want = fit_twin(&wide(&p), &wide(&t), &wide(&w));
        for (got, want) in [fit.scale, fit.shift, fit.loss].iter().zip(want) {
            prop_assert!((got - want).abs() < 1e-9 * (1.0 + want.abs()), "{got} {want}");
        }
        let bars = [0.7, -0.4, 1.3];
        let (mut p_bar, mut t_bar) = (vec![0.5; p.len()], vec![0.5; p.len()]);
        fit.backward(&p, &t, &w, bars, &mut p_bar, &mut t_bar).unwrap();
        let along = |p: &[f64], t: &[f64]| fit_twin(p, t, &wide(&w)).iter().zip(bars).map(|(x, bar)| x * bar).sum::<f64>();
        let want_p = central_difference(&wide(&p), |p| along(p, &wide(&t)));
        let want_t = central_difference(&wide(&t), |t| along(&wide(&p), t));
        let largest = want_p.iter().chain(&want_t).fold(1.0_f64, |m, x| m.max(x.abs()));
        for (got, want) in p_bar.iter().zip(&want_p).chain(t_bar.iter().zip(&want_t)) {
            prop_assert!((f64::from(*got) - 0.5 - want).abs() < 1e-5 * largest, "{got} {want}");
        }
    }

    #[test]
    fn a_target_on_a_line_costs_nothing((p, _, w) in batches(3), a in 0.1_f32..4.0, b in -3.0_f32..3.0) {
        prop_assume!(spread(&w, &p) > 0.1);
        let t: Vec<f32> = p.iter().map(|p| a * p + b).collect();
        let fit = ScaleShift::fit(&p, &t, &w).unwrap().unwrap();
        prop_assert!(fit.loss < 1e-11 && (fit.scale - f64::from(a)).abs() < 1e-4 && (fit.shift - f64::from(b)).abs() < 1e-3);
    }

    #[test]
    fn aligned_depth_matches_sorting_and_differences((p, t, _) in batches(2)) {
        let mut scratch = Vec::new();
        let shaped = |d: &[f32]| Alignment::of(d, &mut Vec::new()).is_some_and(|a| a.deviation > 0.01);
        prop_assume!(shaped(&p) && shaped(&t));
        let got = aligned(&p, &t, &mut scratch).unwrap();
        let want = aligned_twin(&wide(&p), &wide(&t));
        prop_assert!((got - want).abs() < 1e-9 * (1.0 + want), "{got} {want}");
        // The order statistics must not change over a difference.
        let mut sorted = p.clone();
        sorted.sort_by(f32::total_cmp);
        prop_assume!(sorted.windows(2).all(|w| w[1] - w[0] > 1e-5));
        let mut bar = vec![0.0; p.len()];
        aligned_backward(&p, &t, 1.5, &mut bar, &mut scratch).unwrap();
        let want = central_difference(&wide(&p), |p| 1.5 * aligned_twin(p, &wide(&t)));
        let largest = want.iter().fold(1.0_f64, |m, x| m.max(x.abs()));
        for (got, want) in bar.iter().zip(&want) {
            prop_assert!((f64::from(*got) - want).abs() < 1e-5 * largest, "{bar:?} {want:?}");
        }
    }

    #[test]
    fn aligned_depth_does_not_see_lines((p, t, _) in batches(3), a in 0.5_f32..4.0, b in -3.0_f32..3.0) {
        let mut scratch = Vec::new();
        let shaped = |d: &[f32]| Alignment::of(d, &mut Vec::new()).is_some_and(|a| a.deviation > 0.1);
        prop_assume!(shaped(&p) && shaped(&t));
        let line: Vec<f32> = p.iter().map(|p| a * p + b).collect();
        let (got, want) = (aligned(&line, &t, &mut scratch).unwrap(), aligned(&p, &t, &mut scratch).unwrap());
        prop_assert!((got - want).abs() < 1e-3 * (1.0 + want), "{got} {want}");
        // A wrong sign, for an odd count whose median mirrors: four times the mean square of one side.
        if p.len() % 2 == 1 {
            let mirrored: Vec<f32> = p.iter().map(|p| -p).collect();
            let side = Alignment::of(&p, &mut scratch).unwrap();
            let square = p.iter().map(|&p| side.normal(p).powi(2)).sum::<f64>() / p.len() as f64;
            prop_assert!((aligned(&mirrored, &p, &mut scratch).unwrap() - 4.0 * square).abs() < 1e-3 * square);
        }
    }

    #[test]
    fn supervised_depth_is_a_weighted_sum_of_its_kernel((p, t, w) in batches(1), loss_bar in -2.0_f32..2.0) {
        let delta = f64::from(ENDO_DELTA);
        let kernel = Kernel::Huber { delta: ENDO_DELTA };
        // Not within a difference of the corner of the slope.
        prop_assume!(p.iter().zip(&t).all(|(p, t)| ((f64::from(*p) - f64::from(*t)).abs() - delta).abs() > 1e-4));
        let (targets, weights) = (wide(&t), wide(&w));
        let huber = |x: f64| if x.abs() <= delta { 0.5 * x * x } else { delta * (x.abs() - 0.5 * delta) };
        check_f32_pair(
            &p, &[loss_bar],
            (
                |p: &[f32], out: &mut [f32]| out[0] = supervised(kernel, p, &t, &w).unwrap() as f32,
                |p: &[f32], bar: &[f32], p_bar: &mut [f32]| supervised_backward(kernel, p, &t, &w, bar[0].into(), p_bar).unwrap(),
            ),
            (
                |p: &[f64], out: &mut [f64]| out[0] = (0..p.len()).map(|i| weights[i] * huber(p[i] - targets[i])).sum(),
                |p: &[f64], bar: &[f64], p_bar: &mut [f64]| {
                    for i in 0..p.len() {
                        p_bar[i] += bar[0] * weights[i] * (p[i] - targets[i]).clamp(-delta, delta);
                    }
                },
            ),
            PairTolerances { values: Tolerance::new(1e-5, 1e-6), twin: Tolerance::new(1e-6, 1e-7), gradients: Tolerance::new(1e-5, 1e-6) },
        ).unwrap();
    }
}

#[test]
fn batches_without_shape_cost_nothing_and_pull_nowhere() {
    let mut scratch = Vec::new();
    for (p, t) in [
        (vec![], vec![]),
        (vec![2.0], vec![3.0]),
        (vec![2.0; 8], vec![0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]),
        (vec![0.0, 1.0, 2.0, 3.0], vec![5.0; 4]),
        (vec![1e6, 1e6 + 0.125, 1e6], vec![1.0, 2.0, 3.0]),
        (vec![f32::NAN; 3], vec![1.0, 2.0, 3.0]),
    ] {
        let mut bar = vec![0.0; p.len()];
        assert_eq!(aligned(&p, &t, &mut scratch).unwrap(), 0.0, "{p:?} {t:?}");
        aligned_backward(&p, &t, 1.0, &mut bar, &mut scratch).unwrap();
        assert!(bar.iter().all(|&b| b == 0.0));
    }
    let ones = [1.0; 8];
    assert_eq!(ScaleShift::fit(&[], &[], &[]).unwrap(), None);
    assert_eq!(ScaleShift::fit(&[1.0], &[2.0], &[1.0]).unwrap(), None);
    assert_eq!(ScaleShift::fit(&[3.0; 8], &ones, &ones).unwrap(), None);
    assert_eq!(ScaleShift::fit(&[0.0; 8], &ones, &ones).unwrap(), None);
    assert_eq!(ScaleShift::fit(&[1.0, 2.0, 3.0], &[1.0, 2.0, 3.0], &[0.0; 3]).unwrap(), None);
    // One measurement among holes.
    assert_eq!(ScaleShift::fit(&[1.0, 2.0, 3.0], &[1.0, 2.0, 3.0], &[0.0, 1.0, 0.0]).unwrap(), None);
}

#[test]
fn holes_may_hold_anything() {
    let (p, t, w) = ([1.0, 2.0, f32::NAN, 4.0], [2.0, 4.5, 1.0, f32::NAN], [1.0, 1.0, 0.0, 0.0]);
    let kernel = Kernel::Huber { delta: ENDO_DELTA };
    assert!((supervised(kernel, &p, &t, &w).unwrap() - f64::from(0.2 * 0.9 + 0.2 * 2.4_f32)).abs() < 1e-6);
    let mut bar = [0.0; 4];
    supervised_backward(kernel, &p, &t, &w, 1.0, &mut bar).unwrap();
    assert_eq!(bar, [-ENDO_DELTA, -ENDO_DELTA, 0.0, 0.0]);
    let fit = ScaleShift::fit(&p, &t, &w).unwrap().unwrap();
    assert!((fit.scale - 2.5).abs() < 1e-12 && (fit.shift + 0.5).abs() < 1e-12 && fit.loss < 1e-24);
    let mut bars = ([0.0; 4], [0.0; 4]);
    fit.backward(&p, &t, &w, [1.0, 1.0, 1.0], &mut bars.0, &mut bars.1).unwrap();
    assert_eq!((bars.0[2], bars.0[3], bars.1[2], bars.1[3]), (0.0, 0.0, 0.0, 0.0));
    assert!(bars.0.iter().chain(&bars.1).all(|b| b.is_finite()));
}

#[test]
fn ties_of_the_median_send_its_gradient_to_one_element() {
    // The first of the two 2s holds the median: moving it moves every aligned depth.
    let d = [1.0, 2.0, 2.0, 5.0, 7.0_f32];
    let side = Alignment::of(&d, &mut Vec::new()).unwrap();
    assert_eq!((side.median, side.deviation), (2.0, 9.0 / 5.0));
    let mut bar = [0.0; 5];
    side.backward(&d, |i| f64::from(u8::from(i == 3)), &mut bar).unwrap();
    // n = (5 - m) / a: 1/a to itself and -n/(N a) for its own distance; -1/a and the distances of all others to the holder.
    let (a, n) = (1.8, 3.0 / 1.8);
    let want = [n / (5.0 * a), (n * 1.0 / 5.0 - 1.0) / a, 0.0, (1.0 - n / 5.0) / a, -n / (5.0 * a)];
    for (got, want) in bar.iter().zip(want) {
        assert!((f64::from(*got) - want).abs() < 1e-6, "{bar:?} {want:?}");
    }
}

#[test]
fn an_alignment_is_differentiated_with_respect_to_each_output() {
    let d = [0.4, 3.0, 1.7, 2.2, 0.9];
    let bars = [0.3, -1.0, 0.8, 0.5, 2.0];
    let side = |d: &[f64]| Alignment::of(&d.iter().map(|&d| d as f32).collect::<Vec<_>>(), &mut Vec::new()).unwrap();
    check_pair(
        &wide(&d),
        &bars,
        |d: &[f64], out: &mut [f64]| {
            let mut sorted = d.to_vec();
            sorted.sort_by(f64::total_cmp);
            let deviation = d.iter().map(|d| (d - sorted[2]).abs()).sum::<f64>() / 5.0;
            out.iter_mut().zip(d).for_each(|(out, d)| *out = (d - sorted[2]) / deviation);
        },
        |d: &[f64], bar: &[f64], d_bar: &mut [f64]| {
            let single: Vec<f32> = d.iter().map(|&d| d as f32).collect();
            let mut out = vec![0.0; 5];
            side(d).backward(&single, |i| bar[i], &mut out).unwrap();
            d_bar.iter_mut().zip(out).for_each(|(b, o)| *b += f64::from(o));
        },
        // The gradient is rounded to f32.
        Tolerance::new(1e-6, 1e-7),
    )
    .unwrap();
}

#[test]
fn wrong_shapes_are_refused() {
    let shape = |what, want, got| LossError::Shape { what, want, got };
    let mut scratch = Vec::new();
    assert_eq!(supervised(Kernel::L1, &[0.0; 2], &[0.0], &[0.0; 2]), Err(shape("target", 2, 1)));
    assert_eq!(supervised(Kernel::L1, &[0.0; 2], &[0.0; 2], &[0.0]), Err(shape("w", 2, 1)));
    assert_eq!(ScaleShift::fit(&[0.0; 2], &[0.0; 2], &[0.0; 3]), Err(shape("w", 2, 3)));
    assert_eq!(aligned(&[0.0; 2], &[0.0], &mut scratch), Err(shape("target", 2, 1)));
    assert_eq!(
        aligned_backward(&[0.0; 2], &[0.0; 2], 1.0, &mut [0.0], &mut scratch),
        Err(shape("prediction_bar", 2, 1))
    );
    let bad = Kernel::Huber { delta: -1.0 };
    assert!(matches!(supervised(bad, &[], &[], &[]), Err(LossError::Parameter { .. })));
}

/// `1 - r` from the definition.
fn pearson_twin(x: &[f64], y: &[f64]) -> f64 {
    let n = x.len() as f64;
    let mean = |x: &[f64]| x.iter().sum::<f64>() / n;
    let (mx, my) = (mean(x), mean(y));
    let of = |a: &[f64], ma: f64, b: &[f64], mb: f64| a.iter().zip(b).map(|(a, b)| (a - ma) * (b - mb)).sum::<f64>();
    1.0 - of(x, mx, y, my) / (of(x, mx, x, mx) * of(y, my, y, my)).sqrt()
}

proptest! {
    #![proptest_config(testkit::property::cases(96))]

    #[test]
    fn correlation_is_that_of_the_definition_and_so_is_its_gradient((p, t, _) in batches(3)) {
        let ones = vec![1.0; p.len()];
        prop_assume!(spread(&ones, &p) > 0.1 && spread(&ones, &t) > 0.1);
        let (wide_p, wide_t) = (wide(&p), wide(&t));
        let mut bar = vec![0.0; p.len()];
        let loss = pearson_backward(&p, &t, 2, 0.7, &mut bar).unwrap();
        prop_assert!((loss - pearson_twin(&wide_p, &wide_t)).abs() < 1e-12);
        let want = central_difference(&wide_p, |p| 0.7 * pearson_twin(p, &wide_t));
        for (got, want) in bar.iter().zip(want) {
            prop_assert!((f64::from(*got) - want).abs() < 1e-5, "{got} {want}");
        }
    }

    #[test]
    fn correlation_does_not_see_a_line_that_rises_and_sees_its_sign((p, t, _) in batches(3)) {
        let ones = vec![1.0; p.len()];
        prop_assume!(spread(&ones, &p) > 0.1 && spread(&ones, &t) > 0.1);
        let of = |p: &[f32], t: &[f32]| pearson(p, t, 2).unwrap();
        let loss = of(&p, &t);
        let line = |x: &[f32], c: f32| x.iter().map(|x| c * x + 0.5).collect::<Vec<f32>>();
        prop_assert!((of(&line(&p, 3.0), &t) - loss).abs() < 1e-5);
        prop_assert!((of(&p, &line(&t, 0.25)) - loss).abs() < 1e-5);
        prop_assert!((of(&line(&p, -1.0), &t) + loss - 2.0).abs() < 1e-5);
        prop_assert!(of(&p, &line(&p, 2.0)).abs() < 1e-5);
        prop_assert!((-1e-9..=2.0 + 1e-9).contains(&loss));
    }
}

#[test]
fn depths_without_shape_correlate_with_nothing_and_gradients_have_a_bound() {
    let ramp: Vec<f32> = (0..64).map(|i| i as f32).collect();
    let of = |x: &[f32], y: &[f32], fewest: usize| {
        let mut bar = vec![0.0; x.len()];
        let loss = pearson_backward(x, y, fewest, 1.0, &mut bar).unwrap();
        (loss, bar)
    };
    let nothing = (0.0, vec![0.0; 64]);
    let almost: Vec<f32> = ramp.iter().map(|x| 1.0 + 1e-7 * x).collect();
    for flat in [vec![3.0; 64], vec![0.0; 64], almost, vec![f32::NAN; 64], vec![f32::INFINITY; 64]] {
        assert_eq!(of(&flat, &ramp, 2), nothing);
        assert_eq!(of(&ramp, &flat, 2), nothing);
    }
    assert_eq!(of(&ramp, &ramp, 65), nothing);
    assert_eq!(of(&[], &[], 0), (0.0, Vec::new()));
    assert_eq!(of(&[1.0], &[2.0], 0), (0.0, vec![0.0]));
    // Small numbers of little spread: steep.
    let tiny: Vec<f32> = (0..64).map(|i| 1e-6 * (i * 7 % 5) as f32).collect();
    let (loss, bar) = of(&tiny, &ramp, 64);
    assert!(loss.is_finite() && bar.iter().all(|g| f64::from(g.abs()) <= STEEPEST), "{bar:?}");
    assert!(bar.iter().any(|g| *g != 0.0));
    let short = Err(LossError::Shape { what: "y", want: 64, got: 3 });
    assert_eq!(pearson(&ramp, &ramp[..3], 2), short);
}

/// The definition.
fn ranking_twin(x: &[f64], y: &[f64], margin: f64) -> f64 {
    let n = x.len() as f64;
    let pairs = (0..x.len()).flat_map(|i| (0..x.len()).map(move |j| (i, j))).filter(|&(i, j)| y[i] < y[j]);
    pairs.map(|(i, j)| (x[i] - x[j] + margin).max(0.0)).sum::<f64>() / (n * (n - 1.0) / 2.0)
}

proptest! {
    #![proptest_config(testkit::property::cases(96))]

    #[test]
    fn the_order_of_pairs_costs_what_its_definition_says_and_so_does_its_gradient((p, t, _) in batches(2)) {
        let (wide_p, wide_t) = (wide(&p), wide(&t));
        // No pair at the kink: differences there see both sides.
        let margin = 0.125_f32;
        let kink = |i: usize, j: usize| (wide_p[i] - wide_p[j] + 0.125).abs() < 1e-4;
        prop_assume!(!(0..p.len()).any(|i| (0..p.len()).any(|j| kink(i, j))));
        let mut bar = vec![0.0; p.len()];
        let loss = ranking_backward(&p, &t, margin, 0.7, &mut bar).unwrap();
        prop_assert!((loss - ranking_twin(&wide_p, &wide_t, 0.125)).abs() < 1e-12);
        let want = central_difference(&wide_p, |p| 0.7 * ranking_twin(p, &wide_t, 0.125));
        for (got, want) in bar.iter().zip(want) {
            prop_assert!((f64::from(*got) - want).abs() < 1e-5, "{got} {want}");
        }
        // Nothing pulls all of them one way, and only the order of the other side counts.
        prop_assert!(bar.iter().sum::<f32>().abs() < 1e-5);
        let bent: Vec<f32> = t.iter().map(|t| t.exp()).collect();
        let same_order = (0..t.len()).all(|i| (0..t.len()).all(|j| (t[i] < t[j]) == (bent[i] < bent[j])));
        prop_assume!(same_order);
        prop_assert_eq!(ranking(&p, &bent, margin).unwrap(), loss);
    }
}

#[test]
fn pairs_without_order_cost_nothing_and_a_margin_is_a_number() {
    let of = |x: &[f32], y: &[f32], margin: f32| {
        let mut bar = vec![0.0; x.len()];
        ranking_backward(x, y, margin, 1.0, &mut bar).map(|loss| (loss, bar))
    };
    assert_eq!(of(&[], &[], 0.1), Ok((0.0, Vec::new())));
    assert_eq!(of(&[1.0], &[2.0], 0.1), Ok((0.0, vec![0.0])));
    assert_eq!(of(&[5.0, 1.0], &[2.0, 2.0], 0.1), Ok((0.0, vec![0.0; 2])));
    assert_eq!(of(&[5.0, 1.0], &[2.0, f32::NAN], 0.1), Ok((0.0, vec![0.0; 2])));
    assert_eq!(of(&[f32::NAN, 1.0], &[2.0, 3.0], 0.1), Ok((0.0, vec![0.0; 2])));
    assert_eq!(of(&[5.0, 1.0], &[2.0, 3.0], 0.0), Ok((4.0, vec![1.0, -1.0])));
    assert_eq!(of(&[1.0, 5.0], &[2.0, 3.0], 0.0), Ok((0.0, vec![0.0; 2])));
    for margin in [-0.1, f32::NAN, f32::INFINITY] {
        assert!(matches!(of(&[1.0], &[2.0], margin), Err(LossError::Parameter { what: "margin", .. })), "{margin}");
    }
    assert_eq!(ranking(&[1.0], &[], 0.1), Err(LossError::Shape { what: "y", want: 1, got: 0 }));
}
