//! Fenceposts and blurred weights: order, range, mass, known answers, empty input.

use proptest::prelude::*;
use render_core::histogram::{Quantiles, blur_weights, fenceposts_between, quantiles, resample_fenceposts};
use testkit::strategies::any_histogram;

fn resampled(s: &[f32], w: &[f32], u: &[f32]) -> Vec<f32> {
    let (mut cdf, mut out) = (vec![0.0; s.len()], vec![f32::NAN; u.len()]);
    resample_fenceposts(s, w, u, &mut cdf, &mut out);
    out
}

#[test]
fn shares_are_where_their_rule_says() {
    let of = |rule, n| {
        let mut u = vec![f32::NAN; n];
        quantiles(rule, &mut u);
        u
    };
    assert_eq!(of(Quantiles::Ends, 5), [0.0, 0.25, 0.5, 0.75, 1.0]);
    assert_eq!(of(Quantiles::Centres, 4), [0.125, 0.375, 0.625, 0.875]);
    assert_eq!(of(Quantiles::Shared(0.5), 4), of(Quantiles::Centres, 4));
    assert_eq!(of(Quantiles::Each(&[0.0, 0.5, 0.75, 0.25]), 4), [0.0, 0.375, 0.6875, 0.8125]);
    assert_eq!(of(Quantiles::Ends, 1), [0.0]);
    for rule in [Quantiles::Ends, Quantiles::Centres, Quantiles::Shared(0.3), Quantiles::Each(&[])] {
        assert!(of(rule, 0).is_empty());
    }
}

#[test]
fn equal_weights_on_equal_intervals_are_cut_evenly() {
    let s: Vec<f32> = (0..=8).map(|i| 2.0 + 0.5 * i as f32).collect();
    let mut u = vec![0.0; 17];
    quantiles(Quantiles::Ends, &mut u);
    for w in [[1.0; 8], [0.0; 8]] {
        let out = resampled(&s, &w, &u);
        for (i, x) in out.iter().enumerate() {
            assert!((x - (2.0 + 0.25 * i as f32)).abs() < 1e-6, "{out:?}");
        }
    }
}

#[test]
fn cutting_where_the_cumulative_weight_is_gives_the_same_fenceposts() {
    let (s, w) = ([0.0, 0.1, 0.5, 0.7, 2.0], [0.125, 0.5, 0.125, 0.25]);
    let out = resampled(&s, &w, &[0.0, 0.125, 0.625, 0.75, 1.0]);
    for (a, b) in out.iter().zip(s) {
        assert!((a - b).abs() < 1e-6, "{out:?}");
    }
}

#[test]
fn one_heavy_interval_takes_nearly_all_fenceposts() {
    let s: Vec<f32> = (0..=64).map(|i| i as f32).collect();
    let mut w = vec![0.0; 64];
    w[20] = 1.0;
    let mut u = vec![0.0; 129];
    quantiles(Quantiles::Shared(0.7), &mut u);
    assert!(resampled(&s, &w, &u).iter().all(|x| (20.0..=21.0).contains(x)));
    // Blurred and padded as mip-NeRF does: neighbours get half, all others the pad.
    let mut blurred = vec![0.0; 64];
    blur_weights(&w, 0.01, &mut blurred);
    assert_eq!((blurred[18], blurred[19], blurred[20], blurred[21], blurred[22]), (0.01, 0.51, 1.01, 0.51, 0.01));
    let near = resampled(&s, &blurred, &u).iter().filter(|x| (19.0..=22.0).contains(*x)).count();
    assert!((95..=100).contains(&near), "{near} of 129");
}

#[test]
fn blurred_weights_cover_the_weights_and_keep_a_constant() {
    let w = [0.2, 0.0, 0.0, 0.7, 0.1];
    let mut out = [0.0; 5];
    blur_weights(&w, 0.0, &mut out);
    let want = [0.2, 0.1, 0.35, 0.7, 0.4];
    for (out, want) in out.iter().zip(want) {
        assert!((out - want).abs() < 1e-7, "{out} {want}");
    }
    blur_weights(&[0.3; 5], 0.01, &mut out);
    assert_eq!(out, [0.31; 5]);
    blur_weights(&[], 0.01, &mut []);
    let mut one = [0.0];
    blur_weights(&[0.5], 0.01, &mut one);
    assert_eq!(one, [0.51]);
}

#[test]
fn fenceposts_lie_between_centres_and_mirror_at_the_ends() {
    let mut out = [0.0; 4];
    fenceposts_between(&[0.25, 0.5, 1.0], [0.0, 2.0], &mut out);
    assert_eq!(out, [0.125, 0.375, 0.75, 1.25]);
    fenceposts_between(&[0.25, 0.75, 1.0], [0.1, 1.0], &mut out);
    assert_eq!(out, [0.1, 0.5, 0.875, 1.0]);
    let mut two = [0.0; 2];
    fenceposts_between(&[0.3], [0.0, 1.0], &mut two);
    assert_eq!(two, [0.0, 1.0]);
    fenceposts_between(&[], [0.0, 1.0], &mut []);
}

#[test]
fn nothing_to_cut_gives_nothing() {
    resample_fenceposts(&[], &[], &[], &mut [], &mut []);
    resample_fenceposts(&[1.0], &[], &[], &mut [], &mut []);
}

#[test]
fn a_ray_cut_at_random_keeps_the_share_of_every_interval() {
    // Stratified shares: the number of posts in an interval is its share of the mass, give or take one.
    let s = [0.0, 1.0, 1.5, 4.0, 4.25];
    let w = [0.4, 0.1, 0.3, 0.2];
    let mut seed = 7_u64;
    let (mut random, mut u) = (vec![0.0; 1000], vec![0.0; 1000]);
    for _ in 0..20 {
        for x in &mut random {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            *x = (seed >> 40) as f32 / (1_u64 << 24) as f32;
        }
        quantiles(Quantiles::Each(&random), &mut u);
        let out = resampled(&s, &w, &u);
        for (k, w) in w.iter().enumerate() {
            let inside = out.iter().filter(|x| s[k] <= **x && **x < s[k + 1]).count() as f32;
            assert!((inside - 1000.0 * w).abs() <= 1.5, "{k}: {inside}");
        }
    }
}

proptest! {
    #![proptest_config(testkit::property::cases(128))]

    #[test]
    fn fenceposts_are_ordered_and_inside((s, w) in (1..65_usize).prop_flat_map(any_histogram), jitter in 0.0_f32..1.0, m in 0..130_usize) {
        let mut u = vec![0.0; m];
        for rule in [Quantiles::Shared(jitter), Quantiles::Ends, Quantiles::Centres] {
            quantiles(rule, &mut u);
            let out = resampled(&s, &w, &u);
            prop_assert!(out.is_sorted(), "{out:?}");
            prop_assert!(out.iter().all(|x| (s[0]..=s[s.len() - 1]).contains(x)), "{out:?}");
            let mut posts = vec![0.0; if m == 0 { 0 } else { m + 1 }];
            fenceposts_between(&out, [s[0], s[s.len() - 1]], &mut posts);
            prop_assert!(posts.is_sorted(), "{posts:?}");
            prop_assert!(posts.iter().all(|x| (s[0]..=s[s.len() - 1]).contains(x)), "{posts:?}");
            for (c, p) in out.iter().zip(posts.windows(2)) {
                prop_assert!(p[0] <= *c && *c <= p[1], "{c} {p:?}");
            }
        }
    }

    #[test]
    fn blurred_weights_are_at_least_half_their_neighbours((_, w) in (1..65_usize).prop_flat_map(any_histogram)) {
        let mut out = vec![0.0; w.len()];
        blur_weights(&w, 0.0, &mut out);
        for k in 0..w.len() {
            prop_assert!(out[k] >= w[k]);
            prop_assert!(k == 0 || out[k] >= 0.5 * w[k - 1]);
        }
    }
}
