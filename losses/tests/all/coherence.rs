//! Coherence: against its definition, gradients, what moves as a whole, and ways of no length.

use losses::LossError;
use losses::coherence::{SCALE, coherence, coherence_backward};
use losses::kernel::general;
use proptest::prelude::*;
use testkit::gradient::{PairTolerances, Tolerance, check_f32_pair};

/// Length of each column of `[3][n]`.
fn lengths(v: &[f64]) -> Vec<f64> {
    let n = v.len() / 3;
    (0..n).map(|s| (0..3).map(|r| v[r * n + s] * v[r * n + s]).sum::<f64>().sqrt()).collect()
}

fn wide(x: &[f32]) -> Vec<f64> {
    x.iter().map(|&x| f64::from(x)).collect()
}

fn twin(e: &[f64], there: &[f64], w: &[f64], c: f64) -> f64 {
    let ways = lengths(e).into_iter().zip(lengths(there)).zip(w);
    ways.map(|((was, now), w)| w * ((1.0 + ((now / was - 1.0) / c).powi(2)).sqrt() - 1.0)).sum()
}

fn twin_backward(e: &[f64], there: &[f64], w: &[f64], c: f64, loss_bar: f64, there_bar: &mut [f64]) {
    let (was, now, n) = (lengths(e), lengths(there), w.len());
    for (i, bar) in there_bar.iter_mut().enumerate() {
        let s = i % n;
        let r = now[s] / was[s] - 1.0;
        let derivative = r / c / (c * c + r * r).sqrt();
        *bar += loss_bar * w[s] * derivative * there[i] / (now[s] * was[s]);
    }
}

/// Columns of `[3][n]` turned by a (not normalised) quaternion and shifted.
fn moved(v: &[f64], q: [f64; 4], by: [f64; 3]) -> Vec<f64> {
    let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    let [w, x, y, z] = if length > 1e-3 { q.map(|x| x / length) } else { [1.0, 0.0, 0.0, 0.0] };
    let rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ];
    let n = v.len() / 3;
    let of = |r: usize, s: usize| (0..3).map(|k| rows[r][k] * v[k * n + s]).sum::<f64>() + by[r];
    (0..3).flat_map(|r| (0..n).map(move |s| (r, s))).map(|(r, s)| of(r, s)).collect()
}

/// Ways of length 0.17 and more, at most 9 of them.
fn ways() -> impl Strategy<Value = Vec<f32>> {
    let away = |x: f32| x + 0.1_f32.copysign(x);
    prop::collection::vec((-1.0_f32..1.0).prop_map(away), 27)
}

proptest! {
    #![proptest_config(testkit::property::cases(96))]

    #[test]
    fn pair_matches_its_twin(
        n in 1_usize..9, e in ways(), there in ways(), w in prop::collection::vec(0.0_f32..1.0, 9),
        c in 0.05_f32..2.0, loss_bar in -2.0_f32..2.0,
    ) {
        let (e, there, w) = (&e[..3 * n], &there[..3 * n], &w[..n]);
        let (e_wide, w_wide, c_wide) = (wide(e), wide(w), f64::from(c));
        check_f32_pair(
            there, &[loss_bar],
            (
                |there: &[f32], out: &mut [f32]| out[0] = coherence(e, there, w, c).unwrap() as f32,
                |there: &[f32], bar: &[f32], there_bar: &mut [f32]| {
                    coherence_backward(e, there, w, c, bar[0].into(), there_bar).unwrap();
                },
            ),
            (
                |there: &[f64], out: &mut [f64]| out[0] = twin(&e_wide, there, &w_wide, c_wide),
                |there: &[f64], bar: &[f64], there_bar: &mut [f64]| {
                    twin_backward(&e_wide, there, &w_wide, c_wide, bar[0], there_bar);
                },
            ),
            // Differences lose digits to curvature where a way is short and `c` is small.
            PairTolerances { values: Tolerance::new(1e-6, 1e-7), twin: Tolerance::new(1e-5, 1e-7), gradients: Tolerance::new(1e-6, 1e-7) },
        ).unwrap();
        // The backward function answers with the sum, to the last bit.
        let sum = coherence_backward(e, there, w, c, 1.0, &mut vec![0.0; 3 * n]).unwrap();
        prop_assert_eq!(sum, coherence(e, there, w, c).unwrap());
    }

    #[test]
    fn what_moves_as_a_whole_costs_nothing_and_what_is_stretched_does(
        x in ways(), y in ways(), q in prop::array::uniform4(-1.0_f64..1.0), by in prop::array::uniform3(-3.0_f64..3.0),
        s in 0.2_f64..3.0,
    ) {
        let (x, y) = (wide(&x), wide(&y));
        let way = |x: &[f64], y: &[f64]| y.iter().zip(x).map(|(y, x)| (y - x) as f32).collect::<Vec<f32>>();
        let e = way(&x, &y);
        prop_assume!(lengths(&wide(&e)).iter().all(|length| *length > 0.05));
        let w = [1.0; 9];
        let whole = way(&moved(&x, q, by), &moved(&y, q, by));
        let cost = coherence(&e, &whole, &w, SCALE).unwrap();
        // Stretches of about 1e-6 by rounding.
        prop_assert!(cost < 1e-7, "{}", cost);
        let stretched: Vec<f32> = whole.iter().map(|x| (s * f64::from(*x)) as f32).collect();
        let want = 9.0 * ((1.0 + ((s - 1.0) / f64::from(SCALE)).powi(2)).sqrt() - 1.0);
        let cost = coherence(&e, &stretched, &w, SCALE).unwrap();
        prop_assert!((cost - want).abs() < 1e-3 * want + 1e-6, "{} {}", cost, want);
    }

    #[test]
    fn every_way_costs_a_finite_number(
        there in prop::array::uniform3(prop::sample::select(vec![0.0_f32, -0.0, 1e-45, 1e-20, 1e-3, 1.0, 1e20, f32::MAX, f32::MIN])),
        e in prop::sample::select(vec![1e-4_f32, 1e-2, 1.0, 1e20]), c in prop::sample::select(vec![1e-6_f32, 0.1, 1e3]),
    ) {
        let e = [e, 0.0, -e];
        let mut bar = [0.0; 3];
        let loss = coherence_backward(&e, &there, &[1.0], c, 1.0, &mut bar).unwrap();
        prop_assert!(loss.is_finite() && loss >= 0.0 && bar.iter().all(|b| b.is_finite()), "{there:?}: {loss} {bar:?}");
    }
}

#[test]
fn the_sum_stays_finite_for_the_longest_shortest_and_sharpest() {
    // 3e38 / 1e-45 in units of 1e-45: its square is within f64.
    let tiny = f32::from_bits(1);
    let loss = coherence(&[tiny, 0.0, 0.0], &[f32::MAX; 3], &[1.0], tiny).unwrap();
    assert!(loss.is_finite() && loss > 1e100, "{loss}");
}

#[test]
fn near_rest_it_is_half_the_square_and_far_from_it_the_stretch_in_units_of_its_scale() {
    let at = |r: f64| coherence(&[0.5, 0.0, 0.0], &[(0.5 * (1.0 + r)) as f32, 0.0, 0.0], &[1.0], SCALE).unwrap();
    for r in [1e-3, -1e-3] {
        assert!((at(r) / (0.5 * (r / 0.1_f64).powi(2)) - 1.0).abs() < 1e-3, "{}", at(r));
    }
    assert!((at(1e3) / 1e4 - 1.0).abs() < 1e-3, "{}", at(1e3));
    // The general kernel with shape 1.
    for r in [-0.5, -0.02, 0.01, 0.3, 4.0] {
        let want = f64::from(general(r as f32, 1.0, SCALE));
        assert!((at(r) - want).abs() < 1e-5 * want.max(1.0), "{r}: {} {want}", at(r));
    }
}

#[test]
fn ways_of_no_length_have_no_gradient() {
    // The neighbour is the sample itself: nothing to keep.
    let mut bar = [0.0; 3];
    assert_eq!(coherence_backward(&[0.0; 3], &[0.1, 0.2, 0.3], &[1.0], SCALE, 1.0, &mut bar), Ok(0.0));
    assert_eq!(bar, [0.0; 3]);
    // Both fall together: a stretch of -1, in no direction.
    let loss = coherence_backward(&[0.1, 0.0, 0.0], &[0.0, -0.0, 0.0], &[1.0], SCALE, 1.0, &mut bar).unwrap();
    assert!((loss - (101.0_f64.sqrt() - 1.0)).abs() < 1e-4, "{loss}");
    assert_eq!(bar, [0.0; 3]);
}

#[test]
fn no_samples_no_weight_and_wrong_shapes() {
    assert_eq!(coherence(&[], &[], &[], SCALE), Ok(0.0));
    assert_eq!(coherence_backward(&[], &[], &[], SCALE, 1.0, &mut []), Ok(0.0));
    // What weighs nothing is not looked at.
    let mut bar = [0.0; 3];
    assert_eq!(coherence_backward(&[f32::NAN; 3], &[f32::NAN; 3], &[0.0], SCALE, 1.0, &mut bar), Ok(0.0));
    assert_eq!(bar, [0.0; 3]);
    assert!(coherence(&[f32::NAN; 3], &[1.0; 3], &[1.0], SCALE).unwrap().is_nan());
    assert!(coherence(&[1.0; 3], &[f32::NAN; 3], &[1.0], SCALE).unwrap().is_nan());
    let shape = |what, want, got| LossError::Shape { what, want, got };
    assert_eq!(coherence(&[0.0; 4], &[0.0; 3], &[1.0], SCALE), Err(shape("e", 3, 4)));
    assert_eq!(coherence(&[0.0; 3], &[0.0; 2], &[1.0], SCALE), Err(shape("there", 3, 2)));
    let short = coherence_backward(&[0.0; 3], &[0.0; 3], &[1.0], SCALE, 1.0, &mut [0.0; 2]);
    assert_eq!(short, Err(shape("there_bar", 3, 2)));
    for c in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        assert!(matches!(coherence(&[1.0; 3], &[1.0; 3], &[1.0], c), Err(LossError::Parameter { .. })), "{c}");
    }
}
