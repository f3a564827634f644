//! Normalised distance, dilation, annealing, the next intervals.

use proptest::prelude::*;
use render_core::histogram::Quantiles;
use render_core::proposal::{
    DilateScratch, Refine, Resampler, anneal, annealing_exponent, dilate, dilated_len, dilation,
};
use render_core::ray_distance::{RayDistance, RaySpacing};
use testkit::strategies::any_histogram;

const WARPS: [RaySpacing; 4] = [RaySpacing::Linear, RaySpacing::Reciprocal, RaySpacing::Log, RaySpacing::Piecewise];

/// Edges scaled to `[0, 1]`.
fn normalised((mut s, w): (Vec<f32>, Vec<f32>)) -> (Vec<f32>, Vec<f32>) {
    let (first, span) = (s[0], (s[s.len() - 1] - s[0]).max(f32::MIN_POSITIVE));
    s.iter_mut().for_each(|s| *s = ((*s - first) / span).clamp(0.0, 1.0));
    (s, w)
}

/// The definition: every interval is asked at the middle of the new one.
fn naive_dilate(s: &[f32], w: &[f32], d: f32) -> (Vec<f32>, Vec<f32>) {
    let n = w.len();
    let mut posts: Vec<f32> = s.to_vec();
    posts.extend(s[..n].iter().map(|s| (s - d).clamp(0.0, 1.0)));
    posts.extend(s[1..].iter().map(|s| (s + d).clamp(0.0, 1.0)));
    posts.sort_by(f32::total_cmp);
    let posts = posts[1..3 * n].to_vec();
    let mut out: Vec<f64> = Vec::new();
    for pair in posts.windows(2) {
        let mut largest = 0.0_f32;
        for i in 0..n {
            let inside = (s[i] - d).clamp(0.0, 1.0) <= pair[0] && pair[0] < (s[i + 1] + d).clamp(0.0, 1.0);
            if inside && s[i + 1] > s[i] {
                largest = largest.max(w[i] / (s[i + 1] - s[i]));
            }
        }
        out.push(f64::from(largest * (pair[1] - pair[0])));
    }
    let sum: f64 = out.iter().sum();
    (posts, out.iter().map(|w| if sum > 0.0 { (w / sum) as f32 } else { 0.0 }).collect())
}

fn dilated(s: &[f32], w: &[f32], d: f32) -> (Vec<f32>, Vec<f32>) {
    let n = dilated_len(w.len());
    let (mut out_s, mut out_w) = (vec![f32::NAN; n + 1], vec![f32::NAN; n]);
    dilate(s, w, d, &mut out_s, &mut out_w, &mut DilateScratch::default());
    (out_s, out_w)
}

proptest! {
    #![proptest_config(testkit::property::cases(96))]

    #[test]
    fn distance_inverts_normalised_distance(s in 0.0_f64..1.0, near in 1e-3_f64..10.0, ratio in 1.5_f64..1e7) {
        for spacing in WARPS {
            let map = RayDistance::new(spacing, near, near * ratio).unwrap();
            let t = map.t_of(s);
            prop_assert!((near..=near * ratio).contains(&t));
            // Roundings of g, over a difference of g of at least one thirtieth of it.
            prop_assert!((map.s_of(t) - s).abs() < 1e-13, "{spacing:?}: {s} {t} {}", map.s_of(t));
        }
    }

    #[test]
    fn normalised_distance_inverts_distance(u in 0.0_f64..1.0, near in 1e-3_f64..10.0, ratio in 1.5_f64..1e6) {
        for spacing in WARPS {
            let map = RayDistance::new(spacing, near, near * ratio).unwrap();
            let t = near * (ratio.ln() * u).exp();
            let back = map.t_of(map.s_of(t));
            // `s` resolves 1e-16 of all distances, or of 1 / near.
            let worst = if spacing == RaySpacing::Linear { near * ratio } else { t * (1.0 + t.max(1.0 / t) / near.min(1.0)) };
            prop_assert!((back - t).abs() <= 1e-14 * worst, "{spacing:?} {t} {back}");
        }
    }

    #[test]
    fn both_maps_do_not_decrease(a in 0.0_f64..1.0, b in 0.0_f64..1.0) {
        for spacing in WARPS {
            let map = RayDistance::new(spacing, 0.2, 1e6).unwrap();
            let (low, high) = (a.min(b), a.max(b));
            prop_assert!(map.t_of(low) <= map.t_of(high));
            prop_assert!(map.s_of(0.2 + 100.0 * low) <= map.s_of(0.2 + 100.0 * high));
        }
    }

    #[test]
    fn dilate_matches_definition(h in any_histogram(1..33), d in prop_oneof![Just(0.0_f32), 1e-6..0.3_f32, Just(2.0)]) {
        let (s, w) = normalised(h);
        let (got_s, got_w) = dilated(&s, &w, d);
        let (want_s, want_w) = naive_dilate(&s, &w, d);
        prop_assert_eq!(got_s, want_s);
        for (got, want) in got_w.iter().zip(&want_w) {
            prop_assert!((got - want).abs() <= 1e-6, "{:?} {:?}", got_w, want_w);
        }
    }

    #[test]
    fn next_intervals_are_sorted_and_within_zero_and_one(
        h in any_histogram(1..65), d in 0.0_f32..0.1, exponent in 0.0_f32..1.0, u in 0.0_f32..1.0, m in 1_usize..70) {
        let (s, w) = normalised(h);
        let mut out = vec![f32::NAN; m + 1];
        let mut resampler = Resampler::default();
        for rule in [Quantiles::Shared(u), Quantiles::Centres] {
            resampler.next(&s, &w, Refine { dilation: d, exponent }, rule, &mut out);
            prop_assert!(out.is_sorted() && out[0] >= 0.0 && out[m] <= 1.0, "{:?}", out);
        }
    }

    #[test]
    fn annealed_weights_sum_to_one(h in any_histogram(1..65), exponent in 0.0_f32..=1.0) {
        let (s, mut w) = normalised(h);
        anneal(&s, exponent, &mut w);
        let sum: f32 = w.iter().sum();
        prop_assert!(w.iter().all(|w| (0.0..=1.0).contains(w)));
        let empty = s.windows(2).all(|s| s[1] <= s[0]);
        prop_assert!(if empty { sum == 0.0 } else { (sum - 1.0).abs() < 1e-5 }, "{sum}");
    }
}

#[test]
fn ends_are_met_exactly_and_clamped() {
    for spacing in WARPS {
        let map = RayDistance::new(spacing, 0.2, 1e6).unwrap();
        assert_eq!((map.t_of(0.0), map.t_of(1.0), map.t_of(-1.0), map.t_of(2.0)), (0.2, 1e6, 0.2, 1e6), "{spacing:?}");
        assert_eq!((map.s_of(0.2), map.s_of(1e6), map.s_of(0.0), map.s_of(1e9)), (0.0, 1.0, 0.0, 1.0), "{spacing:?}");
    }
}

#[test]
fn infinity_is_a_far_plane_for_inverses() {
    for spacing in [RaySpacing::Reciprocal, RaySpacing::Piecewise] {
        let map = RayDistance::new(spacing, 0.5, f64::INFINITY).unwrap();
        assert_eq!(map.t_of(1.0), f64::INFINITY);
        assert!((map.s_of(map.t_of(0.75)) - 0.75).abs() < 1e-15);
        let mut t = [0.0];
        map.distances(&[1.0], &mut t);
        assert_eq!(t, [f32::MAX]);
    }
    let map = RayDistance::new(RaySpacing::Reciprocal, 0.5, f64::INFINITY).unwrap();
    assert_eq!(map.t_of(0.5), 1.0);
}

#[test]
fn single_precision_keeps_its_digits() {
    let map = RayDistance::new(RaySpacing::Reciprocal, 0.2, 1e6).unwrap();
    let (mut t, mut back) = ([0.0], [0.0]);
    for i in 0..1000 {
        let s = [i as f32 / 1000.0];
        map.distances(&s, &mut t);
        map.normalise(&t, &mut back);
        assert!((back[0] - s[0]).abs() <= f32::EPSILON, "{s:?} {back:?}");
    }
}

#[test]
fn maps_refuse_what_they_cannot_take() {
    for (spacing, near, far) in [
        (RaySpacing::Reciprocal, 0.0, 1.0),
        (RaySpacing::Log, 0.0, 1.0),
        (RaySpacing::Linear, 0.0, f64::INFINITY),
        (RaySpacing::Log, 1.0, f64::INFINITY),
        (RaySpacing::Linear, 1.0, 1.0),
        (RaySpacing::Piecewise, -1.0, 1.0),
        (RaySpacing::Linear, f64::NAN, 1.0),
    ] {
        let error = RayDistance::new(spacing, near, far).unwrap_err();
        assert!(error.to_string().contains(&format!("{spacing:?}")), "{error}");
    }
    assert!(RayDistance::new(RaySpacing::Piecewise, 0.0, f64::INFINITY).is_ok());
}

#[test]
fn dilation_of_a_spike_is_a_plateau() {
    let (s, w) = dilated(&[0.0, 0.5, 0.6, 1.0], &[0.0, 1.0, 0.0], 0.1);
    for (pair, w) in s.windows(2).zip(&w) {
        let middle = 0.5 * (pair[0] + pair[1]);
        let want = if (0.4..0.7).contains(&middle) { (pair[1] - pair[0]) / 0.3 } else { 0.0 };
        assert!((w - want).abs() < 1e-5, "{s:?} {w}");
    }
}

#[test]
fn dilation_shrinks_with_the_intervals_seen() {
    assert_eq!(dilation(0.0025, 0.5, &[64]), 0.0025 + 0.5 / 64.0);
    assert_eq!(dilation(0.0025, 0.5, &[64, 64]), 0.0025 + 0.5 / 4096.0);
}

#[test]
fn annealing_goes_from_flat_to_exact() {
    assert_eq!((annealing_exponent(0.0, 10.0), annealing_exponent(1.0, 10.0)), (0.0, 1.0));
    assert!((annealing_exponent(0.1, 10.0) - 1.0 / 1.9).abs() < 1e-6);
    let s = [0.0, 0.1, 0.1, 0.4, 1.0];
    let mut w = [0.5, 0.3, 0.0, 0.2];
    anneal(&s, 0.0, &mut w);
    // The interval without length gets nothing.
    assert_eq!(w, [1.0 / 3.0, 0.0, 1.0 / 3.0, 1.0 / 3.0]);
    let mut w = [0.5, 0.0, 0.0, 0.25];
    anneal(&s, 1.0, &mut w);
    assert!((w[0] - 2.0 / 3.0).abs() < 1e-7 && w[2] == 0.0, "{w:?}");
    let mut w = [0.4, 0.0, 0.0, 0.1];
    anneal(&s, 0.5, &mut w);
    assert!((w[0] / w[3] - 2.0).abs() < 1e-5, "{w:?}");
    // No weight at all: everywhere the same. Tiny weights: as good as any.
    let mut w = [0.0; 4];
    anneal(&s, 0.5, &mut w);
    assert!(w.iter().sum::<f32>() > 0.99);
    let mut w = [1e-38, 0.0, 0.0, 3e-38];
    anneal(&s, 0.99, &mut w);
    assert!((w.iter().sum::<f32>() - 1.0).abs() < 1e-6 && w[3] > w[0]);
}

#[test]
fn next_intervals_gather_where_the_weight_is() {
    let s: Vec<f32> = (0..=64).map(|i| i as f32 / 64.0).collect();
    let mut w = vec![0.0; 64];
    w[40] = 1.0;
    let mut out = vec![0.0; 33];
    let mut resampler = Resampler::default();
    let refine = Refine { dilation: dilation(0.0025, 0.5, &[64]), exponent: 1.0 };
    resampler.next(&s, &w, refine, Quantiles::Centres, &mut out);
    let inside = out.iter().filter(|s| (0.6..0.66).contains(*s)).count();
    assert!(inside > 30, "{out:?}");
    // The first look has one interval and no preference.
    resampler.next(&[0.0, 1.0], &[1.0], Refine { dilation: 0.0, exponent: 1.0 }, Quantiles::Centres, &mut out);
    for (i, s) in out.iter().enumerate() {
        assert!((s - i as f32 / 32.0).abs() < 1e-6);
    }
}
