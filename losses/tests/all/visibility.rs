//! The mask of occluders and the codes of images: gradients, optima in closed form, what gets no gradient.

use losses::LossError;
use losses::codes::{self, TwoModes, mode_seeking, mode_seeking_backward, view_consistency, view_consistency_backward};
use losses::visibility::{
    SizeSchedule, best_map, best_visibility, indecision, indecision_backward, masked, masked_backward, size,
    size_backward,
};
use proptest::prelude::*;
use testkit::gradient::{PairTolerances, Tolerance, check_f32_pair, cotangent};

fn mean(x: impl Iterator<Item = f64>) -> f64 {
    let x: Vec<f64> = x.collect();
    x.iter().sum::<f64>() / x.len().max(1) as f64
}

/// Absolute values have corners: a pair of values this close to one is left out.
fn apart(x: &[f32], y: &[f32]) -> bool {
    x.iter().zip(y).all(|(x, y)| (x - y).abs() > 1e-4)
}

fn sign(x: f64) -> f64 {
    if x == 0.0 { 0.0 } else { x.signum() }
}

proptest! {
    #![proptest_config(testkit::property::cases(64))]

    #[test]
    fn terms_of_the_map_match_twins(m in prop::collection::vec(0.0_f32..1.0, 1..20), e2 in prop::collection::vec(0.0_f32..1.0, 20), seed in 0_u64..100) {
        let n = m.len();
        let (bar, e2) = ([cotangent(1, seed)[0] as f32], &e2[..n]);
        let each = n as f64;
        // Colour through the map: both inputs at once.
        let both: Vec<f32> = m.iter().chain(e2).copied().collect();
        check_f32_pair(
            &both,
            &bar,
            (
                |x, out| out[0] = masked(&x[..n], &x[n..]).unwrap() as f32,
                |x, bar, x_bar| {
                    let (m_bar, e2_bar) = x_bar.split_at_mut(n);
                    masked_backward(&x[..n], &x[n..], bar[0].into(), Some(m_bar), e2_bar).unwrap();
                },
            ),
            (
                |x, out| out[0] = 0.5 * mean((0..n).map(|i| (1.0 - x[i]) * x[n + i])),
                |x, bar, x_bar| {
                    for i in 0..n {
                        x_bar[i] -= 0.5 * bar[0] * x[n + i] / each;
                        x_bar[n + i] += 0.5 * bar[0] * (1.0 - x[i]) / each;
                    }
                },
            ),
            PairTolerances::default(),
        )
        .unwrap();
        check_f32_pair(
            &m,
            &bar,
            (|m, out| out[0] = size(m) as f32, |m, bar, m_bar| size_backward(m, bar[0].into(), m_bar).unwrap()),
            (
                |m, out| out[0] = mean(m.iter().map(|m| m * m)),
                |m, bar, m_bar| m_bar.iter_mut().zip(m).for_each(|(b, m)| *b += bar[0] * 2.0 * m / each),
            ),
            PairTolerances::default(),
        )
        .unwrap();
        check_f32_pair(
            &m,
            &bar,
            (
                |m, out| out[0] = indecision(m) as f32,
                |m, bar, m_bar| indecision_backward(m, bar[0].into(), m_bar).unwrap(),
            ),
            (
                |m, out| out[0] = mean(m.iter().map(|m| 1.0 / ((m - 0.5).powi(2) + 0.02))),
                |m, bar, m_bar| {
                    for (b, m) in m_bar.iter_mut().zip(m) {
                        *b -= bar[0] * 2.0 * (m - 0.5) / ((m - 0.5).powi(2) + 0.02).powi(2) / each;
                    }
                },
            ),
            PairTolerances { twin: Tolerance::new(1e-6, 1e-7), ..PairTolerances::default() },
        )
        .unwrap();
        // Without a place for it the map is a constant, and colours learn the same.
        let (mut with, mut without, mut m_bar) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        masked_backward(&m, e2, 0.7, Some(&mut m_bar), &mut with).unwrap();
        masked_backward(&m, e2, 0.7, None, &mut without).unwrap();
        prop_assert_eq!(with, without);
    }

    #[test]
    fn descent_ends_at_the_closed_form(e2 in 0.0_f32..0.1, lambda in 0.005_f64..0.05) {
        let mut m = [0.5_f32];
        for _ in 0..2000 {
            let (mut m_bar, mut e2_bar) = ([0.0], [0.0]);
            masked_backward(&m, &[e2], 1.0, Some(&mut m_bar), &mut e2_bar).unwrap();
            size_backward(&m, lambda, &mut m_bar).unwrap();
            m[0] = (m[0] - 5.0 * m_bar[0]).clamp(0.0, 1.0);
        }
        let best = best_map(e2.into(), lambda);
        prop_assert!((f64::from(m[0]) - best).abs() < 1e-3, "{} {best}", m[0]);
        // Nothing near it is cheaper; the published form has its optimum, too.
        let cost = |m: f64| (1.0 - m) * f64::from(e2) / 2.0 + lambda * m * m;
        let published = |v: f64| v * f64::from(e2) + lambda * (1.0 - v) * (1.0 - v);
        let visible = best_visibility(e2.into(), lambda);
        for other in (0..=100).map(|i| f64::from(i) / 100.0) {
            prop_assert!(cost(best) <= cost(other) + 1e-15);
            prop_assert!(published(visible) <= published(other) + 1e-15);
        }
    }

    #[test]
    fn codes_match_twins(a in prop::collection::vec(-1.0_f32..1.0, 1..12), b in prop::collection::vec(-1.0_f32..1.0, 12), seed in 0_u64..100) {
        let n = a.len();
        let (bar, b) = ([cotangent(1, seed)[0] as f32], &b[..n]);
        prop_assume!(apart(&a, b));
        let wide: Vec<f64> = b.iter().map(|&b| b.into()).collect();
        check_f32_pair(
            &a,
            &bar,
            (
                |x, out| out[0] = view_consistency(x, b).unwrap() as f32,
                |x, bar, x_bar| view_consistency_backward(x, b, bar[0].into(), x_bar).unwrap(),
            ),
            (
                |x, out| out[0] = mean(x.iter().zip(&wide).map(|(x, b)| (x - b).abs())),
                |x, bar, x_bar| {
                    x_bar.iter_mut().zip(x).zip(&wide).for_each(|((o, x), b)| *o += bar[0] * sign(x - b) / n as f64);
                },
            ),
            PairTolerances::default(),
        )
        .unwrap();
        check_f32_pair(
            &a,
            &bar,
            (
                |x, out| out[0] = codes::size(x) as f32,
                |x, bar, x_bar| codes::size_backward(x, bar[0].into(), x_bar).unwrap(),
            ),
            (
                |x, out| out[0] = mean(x.iter().map(|x| x * x)),
                |x, bar, x_bar| x_bar.iter_mut().zip(x).for_each(|(o, x)| *o += bar[0] * 2.0 * x / n as f64),
            ),
            PairTolerances::default(),
        )
        .unwrap();
        // The render with the other code is what learns.
        let (own, code) = ([0.31_f32, 0.0], [0.2_f32, -0.4]);
        let fixed = TwoModes { own: b, other: &[], code_own: &own, code_other: &code };
        let g = (f64::from(0.31_f32) - f64::from(0.2_f32)).abs() / 2.0 + f64::from(0.4_f32) / 2.0;
        let d = |x: &[f64]| mean(x.iter().zip(&wide).map(|(x, b)| (x - b).abs()));
        check_f32_pair(
            &a,
            &bar,
            (
                |x, out| out[0] = mode_seeking(TwoModes { other: x, ..fixed }).unwrap() as f32,
                |x, bar, x_bar| mode_seeking_backward(TwoModes { other: x, ..fixed }, bar[0].into(), x_bar).unwrap(),
            ),
            (
                |x, out| out[0] = 1.0 / (d(x) / g + 1e-5),
                |x, bar, x_bar| {
                    let slope = -bar[0] / (d(x) / g + 1e-5).powi(2) / g / n as f64;
                    x_bar.iter_mut().zip(x).zip(&wide).for_each(|((o, x), b)| *o += slope * sign(x - b));
                },
            ),
            // Values of 1e3 where two pictures nearly agree: differences lose as much.
            PairTolerances { twin: Tolerance::new(1e-4, 1e-6), ..PairTolerances::default() },
        )
        .unwrap();
    }
}

#[test]
fn a_ray_is_dropped_from_the_stated_error_on() {
    // lambda = 0.006: an error of 0.155 a channel.
    assert_eq!(best_map(0.155 * 0.155, 6e-3), 1.0);
    assert!(best_map(0.154 * 0.154, 6e-3) < 1.0);
    assert_eq!(best_visibility(1.0, 6e-3), 0.0);
    assert_eq!(best_visibility(0.0, 6e-3), 1.0);
}

#[test]
fn size_of_the_map_gets_cheaper_up_to_a_floor() {
    let schedule = SizeSchedule::default();
    assert_eq!(schedule.at(0), 5e-2);
    assert!((schedule.at(1000) - 5e-2 * (-1.0_f64).exp()).abs() < 1e-12);
    assert!(schedule.at(2120) > 6e-3);
    assert_eq!([schedule.at(2121), schedule.at(600_000), schedule.at(u64::MAX)], [6e-3; 3]);
}

#[test]
fn equal_codes_say_nothing() {
    // The first step: the cache holds the image's own code, and both pictures are the same.
    let modes = TwoModes { own: &[0.5; 6], other: &[0.5; 6], code_own: &[0.1; 4], code_other: &[0.1; 4] };
    let mut other_bar = [0.0; 6];
    assert_eq!(mode_seeking(modes), Ok(0.0));
    mode_seeking_backward(modes, 1.0, &mut other_bar).unwrap();
    assert_eq!(other_bar, [0.0; 6]);
    // Different codes, same picture: dear, but finite.
    let modes = TwoModes { code_other: &[0.3; 4], ..modes };
    assert!((mode_seeking(modes).unwrap() - 1e5).abs() < 1e-3);
    mode_seeking_backward(modes, 1.0, &mut other_bar).unwrap();
    assert_eq!(other_bar, [0.0; 6]);
    assert_eq!(view_consistency(&[0.2; 3], &[0.2; 3]), Ok(0.0));
}

#[test]
fn empty_batches_and_wrong_arguments() {
    assert_eq!((masked(&[], &[]), size(&[]), indecision(&[]), codes::size(&[])), (Ok(0.0), 0.0, 0.0, 0.0));
    assert_eq!(view_consistency(&[], &[]), Ok(0.0));
    masked_backward(&[], &[], 1.0, Some(&mut []), &mut []).unwrap();
    assert_eq!(masked(&[0.0], &[]), Err(LossError::Shape { what: "e2", want: 1, got: 0 }));
    assert!(masked_backward(&[0.0], &[0.0], 1.0, Some(&mut []), &mut [0.0]).is_err());
    assert!(size_backward(&[0.0], 1.0, &mut []).is_err() && indecision_backward(&[0.0], 1.0, &mut []).is_err());
    assert!(view_consistency_backward(&[0.0], &[0.0], 1.0, &mut []).is_err());
    assert!(view_consistency(&[0.0], &[]).is_err());
    // NaN is not swallowed by the sign.
    let mut bar = [0.0];
    view_consistency_backward(&[f32::NAN], &[0.0], 1.0, &mut bar).unwrap();
    assert!(bar[0].is_nan() && view_consistency(&[f32::NAN], &[0.0]).unwrap().is_nan());
}
