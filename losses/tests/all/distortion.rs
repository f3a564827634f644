//! Distortion: against its definition, gradients, what it does not depend on, known values.

use losses::{Edges, LossError, RayIntervals, Reduction, distortion};
use proptest::prelude::*;
use testkit::gradient::{PairTolerances, Tolerance, check_f32_pair};
use testkit::strategies::any_histogram;

/// The definition.
fn naive(s: &[f64], w: &[f64]) -> f64 {
    let m = |i: usize| 0.5 * (s[i] + s[i + 1]);
    let mut loss = 0.0;
    for i in 0..w.len() {
        for j in 0..w.len() {
            loss += w[i] * w[j] * (m(i) - m(j)).abs();
        }
        loss += w[i] * w[i] * (s[i + 1] - s[i]) / 3.0;
    }
    loss
}

fn naive_backward(s: &[f64], w: &[f64], loss_bar: f64, w_bar: &mut [f64]) {
    let m = |i: usize| 0.5 * (s[i] + s[i + 1]);
    for i in 0..w.len() {
        for (j, &w) in w.iter().enumerate() {
            w_bar[i] += loss_bar * 2.0 * w * (m(i) - m(j)).abs();
        }
        w_bar[i] += loss_bar * 2.0 / 3.0 * w[i] * (s[i + 1] - s[i]);
    }
}

fn wide(x: &[f32]) -> Vec<f64> {
    x.iter().map(|&x| f64::from(x)).collect()
}

/// One ray without gaps.
fn one(s: &[f32], w: &[f32]) -> f64 {
    let offsets = [0, w.len() as u32];
    distortion::distortion(RayIntervals { offsets: &offsets, edges: Edges::Joined(s) }, w, Reduction::Sum).unwrap()
}

proptest! {
    #![proptest_config(testkit::property::cases(96))]

    #[test]
    fn linear_time_matches_definition(h in any_histogram(1..65)) {
        let (s, w) = (&h.0, &h.1);
        let want = naive(&wide(s), &wide(w));
        let span = f64::from(s[s.len() - 1] - s[0]);
        let mass: f64 = wide(w).iter().sum();
        // Rounding is that of f64 on the scale of positions and mass.
        let reach = f64::from(s[0].abs().max(s[s.len() - 1].abs())) + span;
        prop_assert!((one(s, w) - want).abs() <= 1e-12 * (want + mass * mass * reach), "{} {want}", one(s, w));
        prop_assert!(want >= 0.0);
    }

    #[test]
    fn gradient_matches_twin_and_differences(h in any_histogram(1..33), loss_bar in -2.0_f32..2.0) {
        let (s, offsets) = (&h.0, [0, h.1.len() as u32]);
        let twin_s = wide(s);
        let intervals = RayIntervals { offsets: &offsets, edges: Edges::Joined(s) };
        let scale = f64::from(s[s.len() - 1] - s[0]).max(1e-30);
        let tight = Tolerance::new(1e-6, 1e-8 * scale);
        check_f32_pair(
            &h.1,
            &[loss_bar],
            (
                |w: &[f32], out: &mut [f32]| distortion::per_ray(intervals, w, out).unwrap(),
                |w: &[f32], bar: &[f32], w_bar: &mut [f32]| {
                    distortion::distortion_backward(intervals, w, Reduction::Sum, bar[0].into(), w_bar).unwrap();
                },
            ),
            (
                |w: &[f64], out: &mut [f64]| out[0] = naive(&twin_s, w),
                |w: &[f64], bar: &[f64], w_bar: &mut [f64]| naive_backward(&twin_s, w, bar[0], w_bar),
            ),
            PairTolerances { values: Tolerance::new(1e-6, 1e-12), twin: tight, gradients: Tolerance::new(1e-5, 1e-6 * scale) },
        ).unwrap();
    }

    #[test]
    fn splitting_an_interval_changes_nothing(h in any_histogram(1..33), at in 0_usize..32) {
        let at = at % h.1.len();
        let (mut s, mut w) = (h.0.clone(), h.1.clone());
        // Powers of two: the halves are exact.
        for s in &mut s { *s = (*s * 1024.0).round() / 1024.0; }
        let before = one(&s, &w);
        s.insert(at + 1, 0.5 * (s[at] + s[at + 1]));
        w[at] *= 0.5;
        w.insert(at, w[at]);
        let after = one(&s, &w);
        prop_assert!((before - after).abs() <= 1e-9 * before.abs() + 1e-12, "{before} {after}");
    }

    #[test]
    fn twice_the_weight_costs_four_times(h in any_histogram(1..33)) {
        let double: Vec<f32> = h.1.iter().map(|w| 2.0 * w).collect();
        prop_assert_eq!(4.0 * one(&h.0, &h.1), one(&h.0, &double));
    }

    #[test]
    fn a_batch_is_its_rays(rays in prop::collection::vec(any_histogram(1..17), 0..9)) {
        let (mut offsets, mut s, mut start, mut end, mut w) = (vec![0_u32], vec![], vec![], vec![], vec![]);
        for h in &rays {
            s.extend_from_slice(&h.0);
            start.extend_from_slice(&h.0[..h.1.len()]);
            end.extend_from_slice(&h.0[1..]);
            w.extend_from_slice(&h.1);
            offsets.push(w.len() as u32);
        }
        let want: Vec<f32> = rays.iter().map(|h| one(&h.0, &h.1) as f32).collect();
        let total: f64 = rays.iter().map(|h| one(&h.0, &h.1)).sum();
        for edges in [Edges::Joined(&s), Edges::Apart { start: &start, end: &end }] {
            let intervals = RayIntervals { offsets: &offsets, edges };
            let mut got = vec![f32::NAN; rays.len()];
            distortion::per_ray(intervals, &w, &mut got).unwrap();
            prop_assert_eq!(&got, &want);
            for (reduction, by) in
                [(Reduction::Sum, 1), (Reduction::PerRay, rays.len()), (Reduction::PerInterval, w.len())] {
                let got = distortion::distortion(intervals, &w, reduction).unwrap();
                prop_assert!((got - total / by.max(1) as f64).abs() <= 1e-14 * total);
            }
        }
    }
}

#[test]
fn translation_changes_nothing() {
    let (s, w) = ([0.0, 0.25, 0.5, 1.0], [0.25, 0.5, 0.125]);
    let far = s.map(|s| s + 1_048_576.0);
    assert!((one(&far, &w) - one(&s, &w)).abs() < 1e-9);
    // One place, far away: nothing but the interval's own length is left.
    let far = [0.0, 0.25].map(|s| s + 1_048_576.0);
    assert!((one(&far, &[1.0]) - 0.25 / 3.0).abs() < 1e-9);
}

#[test]
fn scaling_positions_scales_the_loss() {
    let (s, w) = ([0.0, 0.25, 0.5, 1.0], [0.25, 0.5, 0.125]);
    assert_eq!(one(&s.map(|s| 8.0 * s), &w), 8.0 * one(&s, &w));
}

#[test]
fn known_values() {
    // One full interval.
    assert!((one(&[0.25, 0.75], &[0.5]) - 0.5 / 3.0 * 0.25).abs() < 1e-15);
    // Uniform mass on [0, 1], however it is cut.
    for n in [1, 2, 8, 64] {
        let s: Vec<f32> = (0..=n).map(|i| i as f32 / n as f32).collect();
        assert!((one(&s, &vec![1.0 / n as f32; n]) - 1.0 / 3.0).abs() < 1e-7, "{n}");
    }
    // Two halves at the ends of [0, 1]: the most there is.
    assert_eq!(one(&[0.0, 0.0, 1.0, 1.0], &[0.5, 0.0, 0.5]), 0.5);
}

#[test]
fn gaps_count_as_empty_intervals() {
    let joined = one(&[0.0, 0.1, 0.7, 0.9], &[0.3, 0.0, 0.6]);
    let apart = Edges::Apart { start: &[0.0, 0.7], end: &[0.1, 0.9] };
    let intervals = RayIntervals { offsets: &[0, 2], edges: apart };
    let got = distortion::distortion(intervals, &[0.3, 0.6], Reduction::Sum).unwrap();
    assert!((got - joined).abs() < 1e-15);
}

#[test]
fn one_step_of_descent_lowers_it() {
    let s: Vec<f32> = (0..=16).map(|i| i as f32 / 16.0).collect();
    let mut w: Vec<f32> = (0..16).map(|i| 0.02 + (i % 5) as f32 * 0.01).collect();
    let offsets = [0, 16];
    let intervals = RayIntervals { offsets: &offsets, edges: Edges::Joined(&s) };
    let mut w_bar = vec![0.0; 16];
    let before = distortion::distortion(intervals, &w, Reduction::PerRay).unwrap();
    distortion::distortion_backward(intervals, &w, Reduction::PerRay, 1.0, &mut w_bar).unwrap();
    w.iter_mut().zip(&w_bar).for_each(|(w, g)| *w -= 1e-3 * g);
    let slope: f64 = w_bar.iter().map(|g| f64::from(g * g)).sum();
    let after = distortion::distortion(intervals, &w, Reduction::PerRay).unwrap();
    assert!((before - after - 1e-3 * slope).abs() < 1e-2 * 1e-3 * slope, "{before} {after} {slope}");
}

#[test]
fn empty_input_costs_nothing() {
    let none = RayIntervals { offsets: &[], edges: Edges::Joined(&[]) };
    assert_eq!(distortion::distortion(none, &[], Reduction::PerRay), Ok(0.0));
    // Two rays without intervals: one edge each.
    let empty = RayIntervals { offsets: &[0, 0, 0], edges: Edges::Joined(&[0.0, 0.0]) };
    assert_eq!(distortion::distortion(empty, &[], Reduction::PerInterval), Ok(0.0));
    assert_eq!(distortion::distortion_backward(empty, &[], Reduction::PerRay, 1.0, &mut []), Ok(()));
}

#[test]
fn extreme_weights_stay_finite() {
    for scale in [1e-30_f32, 1e-12, 1e12, 1e30] {
        let w = [scale, 0.0, 0.5 * scale, f32::MIN_POSITIVE];
        let s = [0.0, 1e-30, 1e-30, 0.5, 1.0];
        let (got, want) = (one(&s, &w), naive(&wide(&s), &wide(&w)));
        assert!((got - want).abs() <= 1e-12 * want, "{scale}: {got} {want}");
    }
}

#[test]
fn arguments_that_do_not_fit_are_named() {
    let joined = RayIntervals { offsets: &[0, 2], edges: Edges::Joined(&[0.0, 1.0]) };
    let error = distortion::distortion(joined, &[0.5, 0.5], Reduction::Sum);
    assert_eq!(error, Err(LossError::Shape { what: "edges", want: 3, got: 2 }));
    let decreasing = RayIntervals { offsets: &[0, 2, 1], edges: Edges::Joined(&[]) };
    assert_eq!(distortion::distortion(decreasing, &[0.5], Reduction::Sum), Err(LossError::Order { what: "offsets" }));
    let fine = RayIntervals { offsets: &[0, 1], edges: Edges::Joined(&[0.0, 1.0]) };
    let error = distortion::distortion_backward(fine, &[0.5], Reduction::Sum, 1.0, &mut []);
    assert_eq!(error, Err(LossError::Shape { what: "w_bar", want: 1, got: 0 }));
}
