//! Samples by piecewise-linear density: distribution, order, range, extremes.

use proptest::prelude::*;
use render_core::quadrature::{Rule, reference};
use render_core::sample::invert_linear;
use testkit::strategies::{any_densities, any_edges};

fn sample(t: &[f32], sigma: &[f32], u: &[f32]) -> (Vec<f64>, Vec<f32>) {
    let (mut depth, mut samples) = (vec![f64::NAN; t.len()], vec![f32::NAN; u.len()]);
    invert_linear(t, sigma, u, &mut depth, &mut samples);
    (depth, samples)
}

/// Optical depth in front of `x` under linear density between nodes, from its definition.
fn depth_at(t: &[f32], sigma: &[f32], x: f64) -> f64 {
    (0..t.len() - 1)
        .map(|i| {
            let (from, to) = (f64::from(t[i]), f64::from(t[i + 1]));
            let (a, b) = (f64::from(sigma[i]), f64::from(sigma[i + 1]));
            let length = (x.min(to) - from).max(0.0);
            if to > from { length * (a + 0.5 * (b - a) * length / (to - from)) } else { 0.0 }
        })
        .sum()
}

proptest! {
    #![proptest_config(testkit::property::cases(128))]

    #[test]
    fn the_opacity_up_to_a_sample_is_its_share(
        sigma in prop::collection::vec(prop_oneof![4 => 0.0_f32..8.0, 1 => Just(0.0), 1 => 1e-6_f32..1e-3], 2..40),
        step in 0.05_f32..0.5,
        u in prop::collection::vec(0.0_f32..1.0, 1..40),
    ) {
        let t: Vec<f32> = (0..sigma.len()).map(|i| 1.0 + i as f32 * step).collect();
        let total = depth_at(&t, &sigma, t[t.len() - 1].into());
        prop_assume!(total > 0.0);
        let (depth, samples) = sample(&t, &sigma, &u);
        prop_assert!((depth[t.len() - 1] / total - 1.0).abs() < 1e-12);
        for (&x, &u) in samples.iter().zip(&u) {
            let share = (-depth_at(&t, &sigma, x.into())).exp_m1() / (-total).exp_m1();
            // An ulp of the sample, at the largest density, over the opacity there is.
            let bound = 1e-9 + 2.0 * f64::from(x) * 6e-8 * 8.0 / -(-total).exp_m1();
            prop_assert!((share - f64::from(u)).abs() <= bound.max(1e-9), "{share} {u}");
        }
    }

    #[test]
    fn samples_are_ordered_and_inside(
        (t, sigma) in (1..40_usize).prop_flat_map(|n| (any_edges(n), any_densities(n + 1))),
        mut u in prop::collection::vec(prop_oneof![8 => 0.0_f32..1.0, 1 => Just(0.0), 1 => Just(1.0_f32)], 0..40),
    ) {
        u.sort_by(f32::total_cmp);
        let (depth, samples) = sample(&t, &sigma, &u);
        prop_assert!(depth.is_sorted());
        prop_assert!(samples.is_sorted(), "{samples:?}");
        prop_assert!(samples.iter().all(|x| (t[0]..=t[t.len() - 1]).contains(x)), "{samples:?} {t:?}");
    }
}

#[test]
fn the_mean_sample_is_the_centroid() {
    // One interval: the mean over u of the place is the mean position of absorption of the quadrature.
    let m = 4000;
    let u: Vec<f32> = (0..m).map(|k| (k as f32 + 0.5) / m as f32).collect();
    for (a, b) in [(0.0, 3.0), (3.0, 0.0), (2.0, 2.0), (1e-3, 2e-3), (0.5, 40.0), (40.0, 0.5)] {
        let (_, samples) = sample(&[0.0, 1.0], &[a, b], &u);
        let mean: f64 = samples.iter().map(|&x| f64::from(x)).sum::<f64>() / m as f64;
        let want = reference::centroid(a.into(), b.into());
        assert!((mean - want).abs() < 2e-4, "{a} {b}: {mean} {want}");
        let (tau, values) =
            reference::intervals(Rule::PiecewiseLinear, &[1.0, 0.0], &[a.into(), b.into()], &[[0.0], [1.0]]);
        assert_eq!((values[0][0], tau[1]), (want, 0.0));
    }
}

#[test]
fn known_places() {
    // Even density: an exponential, cut.
    let (_, x) = sample(&[0.0, 1.0, 2.0], &[1.5; 3], &[0.0, 0.5, 1.0]);
    let half = -(1.0 - 0.5 * (1.0 - (-3.0_f64).exp())).ln() / 1.5;
    assert!(x[0] == 0.0 && (f64::from(x[1]) - half).abs() < 1e-7 && x[2] == 2.0, "{x:?}");
    // Nothing in front and behind: samples stay where the density is.
    let (_, x) = sample(&[0.0, 1.0, 2.0, 3.0, 4.0], &[0.0, 0.0, 1.0, 0.0, 0.0], &[0.0, 1.0]);
    assert_eq!(x, [1.0, 3.0]);
    // Nothing anywhere: every interval the same.
    let (_, x) = sample(&[0.0, 1.0, 3.0], &[0.0; 3], &[0.0, 0.25, 0.5, 0.75, 1.0]);
    assert_eq!(x, [0.0, 0.5, 1.0, 2.0, 3.0]);
    // A wall: all samples at its face.
    let (_, x) = sample(&[0.0, 1.0, 2.0], &[f32::INFINITY; 3], &[0.0, 0.5, 0.999]);
    assert!(x.iter().all(|x| *x < 1e-6), "{x:?}");
}

#[test]
fn extremes_and_nothing() {
    let numbers = [0.0, f32::from_bits(1), 1e-38, 1e-20, 1.0, 1e20, f32::MAX, f32::INFINITY];
    let u = [0.0, 1e-30, 0.5, 1.0_f32.next_down(), 1.0];
    for a in numbers {
        for b in numbers {
            for step in [0.0, 1e-38, 1.0, 1e38] {
                let (_, x) = sample(&[0.0, step, 2.0 * step], &[a, b, a], &u);
                assert!(
                    x.is_sorted() && x.iter().all(|x| (0.0..=2.0 * step).contains(x)),
                    "{a:e} {b:e} {step:e}: {x:?}"
                );
            }
        }
    }
    assert_eq!(sample(&[], &[], &[]), (vec![], vec![]));
    assert_eq!(sample(&[1.0], &[2.0], &[]), (vec![0.0], vec![]));
    assert!(sample(&[0.0, 1.0], &[1.0; 2], &[]).1.is_empty());
}
