//! Sampling along rays: order, range, distribution, empty input.

use proptest::prelude::*;
use render_core::budget::{depth_limit, terminate, termination_bound};
use render_core::quadrature::{LastInterval, reference};
use render_core::sample::{
    Spacing, bin_edges, dt_from_edges, dt_from_points, invert_cdf, merge_sorted, mid_points, nerf_sample_pdf,
    stratified_bins, stratified_nerf,
};

const SPACINGS: [Spacing; 2] = [Spacing::Linear, Spacing::Disparity];

fn any_u(n: usize) -> impl Strategy<Value = Vec<f32>> {
    prop::collection::vec(prop_oneof![8 => 0.0_f32..1.0, 1 => Just(0.0), 1 => Just(1.0_f32.next_down())], n)
}

/// A histogram: edges and weights, with empty bins, bins without width, tiny and huge weights.
fn any_histogram() -> impl Strategy<Value = (Vec<f32>, Vec<f32>)> {
    let bin = (
        prop_oneof![4 => 0.0_f32..1.0, 1 => Just(0.0), 1 => 0.0_f32..1e-5],
        prop_oneof![4 => 0.0_f32..1.0, 2 => Just(0.0), 1 => 1e-38_f32..1e-30, 1 => 1e30_f32..1e38],
    );
    (0.0_f32..5.0, prop::collection::vec(bin, 1..65)).prop_map(|(start, bins)| {
        let mut edges = vec![start];
        for (width, _) in &bins {
            edges.push(edges[edges.len() - 1] + width);
        }
        (edges, bins.iter().map(|b| b.1).collect())
    })
}

proptest! {
    #![proptest_config(testkit::property::cases(128))]

    #[test]
    fn stratified_samples_are_ordered_and_stay_in_their_bins((near, span, u) in (0.01_f32..10.0, 0.0_f32..100.0, (0_usize..70).prop_flat_map(any_u))) {
        let far = near + span;
        for spacing in SPACINGS {
            let mut t = vec![0.0; u.len()];
            let mut edges = vec![0.0; u.len() + 1];
            bin_edges(near, far, spacing, &mut edges);
            stratified_bins(near, far, spacing, &u, &mut t);
            for (i, &t) in t.iter().enumerate() {
                prop_assert!(edges[i] <= t && t <= edges[i + 1], "{spacing:?} {i}: {t} in {edges:?}");
            }
            stratified_nerf(near, far, spacing, &u, &mut t);
            prop_assert!(t.is_sorted() && t.iter().all(|t| (near..=far).contains(t)), "{spacing:?}: {t:?}");
        }
    }

    #[test]
    fn samples_lie_in_bins_with_mass((edges, weights) in any_histogram(), u in any_u(40)) {
        let mut cdf = vec![0.0; edges.len()];
        let mut samples = vec![f32::NAN; u.len()];
        invert_cdf(&edges, &weights, 0.0, &u, &mut cdf, &mut samples);
        prop_assert!(cdf.is_sorted() && cdf[0] == 0.0 && cdf[edges.len() - 1] == 1.0);
        let empty = weights.iter().all(|&w| w == 0.0);
        for (&s, &u) in samples.iter().zip(&u) {
            prop_assert!(edges.windows(2).zip(&weights).any(|(e, &w)| e[0] <= s && s <= e[1] && (w > 0.0 || empty)), "{s}");
            // Backwards: the cumulative mass up to the sample is u, give or take a rounding of the sample.
            let up_to = |s: f64| -> f64 {
                edges.windows(2).zip(cdf.windows(2)).map(|(e, c)| {
                    let (a, b) = (f64::from(e[0]), f64::from(e[1]));
                    let share = if b > a { ((s - a) / (b - a)).clamp(0.0, 1.0) } else { f64::from(u8::from(s >= b)) };
                    share * (c[1] - c[0])
                }).sum()
            };
            let ulp = f64::from(s.next_up() - s);
            prop_assert!(up_to(f64::from(s) - ulp) <= f64::from(u) + 1e-9 && f64::from(u) <= up_to(f64::from(s) + ulp) + 1e-9, "{s} {u}");
        }
        let mut sorted = u.clone();
        sorted.sort_unstable_by(f32::total_cmp);
        invert_cdf(&edges, &weights, 0.0, &sorted, &mut cdf, &mut samples);
        prop_assert!(samples.is_sorted());
        nerf_sample_pdf(&edges, &weights, &sorted, &mut cdf, &mut samples);
        prop_assert!(samples.iter().all(|s| (edges[0]..=edges[edges.len() - 1]).contains(s)), "{samples:?}");
    }

    #[test]
    fn merging_sorts(mut a in prop::collection::vec(-5.0_f32..5.0, 0..40), mut b in prop::collection::vec(-5.0_f32..5.0, 0..40)) {
        a.sort_unstable_by(f32::total_cmp);
        b.sort_unstable_by(f32::total_cmp);
        let mut out = vec![0.0; a.len() + b.len()];
        merge_sorted(&a, &b, &mut out);
        let mut want = [a, b].concat();
        want.sort_unstable_by(f32::total_cmp);
        prop_assert_eq!(out, want);
    }

    #[test]
    fn dropping_what_is_behind_a_surface_stays_within_the_bound(
        tau in prop::collection::vec(prop_oneof![3 => 0.0_f32..0.3, 1 => 0.0_f32..8.0], 0..120), eps in 1e-6_f32..0.1,
        background in 0.0_f64..1.0,
    ) {
        let keep = terminate(&tau, eps);
        let tau: Vec<f64> = tau.iter().map(|&x| x.into()).collect();
        let colours: Vec<[f64; 1]> = (0..tau.len()).map(|i| [(i * 37 % 11) as f64 / 10.0]).collect();
        let whole = reference::weights(&tau, LastInterval::Finite);
        let cut = reference::weights(&tau[..keep], LastInterval::Finite);
        // What is dropped has little weight, and nothing was dropped that has more.
        prop_assert!(keep == tau.len() || cut.trans[keep] < f64::from(eps));
        prop_assert!(keep == 0 || cut.trans[keep - 1] >= f64::from(eps) * (1.0 - 1e-12));
        let a = reference::colour(&whole, &colours, [background])[0];
        let b = reference::colour(&cut, &colours[..keep], [background])[0];
        let spread = colours[keep..].iter().map(|c| (c[0] - background).abs()).fold(0.0, f64::max);
        let bound = f64::from(termination_bound(cut.trans[keep] as f32, spread as f32));
        prop_assert!((a - b).abs() <= bound * (1.0 + 1e-6) + 1e-15, "{a} {b} {bound}");
        prop_assert!(keep == tau.len() || (a - b).abs() <= f64::from(eps));
    }
}

#[test]
fn termination_at_the_edges() {
    assert_eq!(terminate(&[], 1e-4), 0);
    assert_eq!(terminate(&[1e9, 1.0], 0.0), 2);
    assert_eq!(terminate(&[f32::INFINITY, 1.0], 1e-4), 1);
    assert_eq!(terminate(&[0.0, 0.0, 0.1, 5.0], 1.0), 3);
    assert_eq!((depth_limit(1.0), depth_limit(0.0), depth_limit(7.0)), (0.0, f64::INFINITY, 0.0));
    assert!((depth_limit(1e-4) - 9.21034).abs() < 1e-4);
}

#[test]
fn samples_follow_the_histogram() {
    let (edges, weights) = ([0.0, 1.0, 3.0, 4.0], [1.0, 3.0, 0.0]);
    let n = 10_000;
    let u: Vec<f32> = (0..n).map(|i| (i as f32 + 0.5) / n as f32).collect();
    let (mut cdf, mut samples) = ([0.0; 4], vec![0.0; n]);
    invert_cdf(&edges, &weights, 0.0, &u, &mut cdf, &mut samples);
    let count = |range: core::ops::Range<f32>| samples.iter().filter(|s| range.contains(s)).count();
    assert_eq!([count(0.0..1.0), count(1.0..2.0), count(2.0..3.0), count(3.0..4.1)], [2500, 3750, 3750, 0]);
}

#[test]
fn nothing_in_gives_nothing_out() {
    stratified_bins(1.0, 2.0, Spacing::Linear, &[], &mut []);
    stratified_nerf(1.0, 2.0, Spacing::Linear, &[], &mut []);
    invert_cdf(&[], &[], 0.0, &[], &mut [], &mut []);
    nerf_sample_pdf(&[], &[], &[], &mut [], &mut []);
    merge_sorted(&[], &[], &mut []);
    dt_from_edges(&[], &mut []);
    dt_from_points(&[], 1.0, &mut []);
    mid_points(&[], &mut []);
    bin_edges(1.0, 2.0, Spacing::Linear, &mut []);
}

#[test]
fn disparity_reaches_infinity() {
    let mut edges = [0.0; 5];
    bin_edges(0.5, f32::INFINITY, Spacing::Disparity, &mut edges);
    assert_eq!(edges, [0.5, 0.5 / 0.75, 1.0, 2.0, f32::INFINITY]);
}

#[test]
fn interval_lengths() {
    let mut dt = [0.0; 3];
    dt_from_edges(&[1.0, 1.5, 1.5, 4.0], &mut dt);
    assert_eq!(dt, [0.5, 0.0, 2.5]);
    dt_from_points(&[1.0, 1.5, 3.0], 4.0, &mut dt);
    assert_eq!(dt, [0.5, 1.5, 1.0]);
    let mut mid = [0.0; 2];
    mid_points(&[1.0, 1.5, 3.0], &mut mid);
    assert_eq!(mid, [1.25, 2.25]);
}
