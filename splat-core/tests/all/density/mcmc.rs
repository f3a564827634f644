use super::{STREAM, numbers, opacity, some, ten};
use float_core::rng::Rng;
use proptest::prelude::*;
use splat_core::density::{Change, Mcmc, relocation};
use splat_core::{Gaussians, SplatError};

const MCMC: Mcmc = Mcmc::DEFAULT;

/// The paper's double sum.
fn share_by_sum(o: f64, n: u32) -> (f64, f64) {
    let each = 1.0 - (1.0 - o).powf(1.0 / f64::from(n));
    let choose = |m: u32, k: u32| (0..k).fold(1.0, |c, j| c * f64::from(m - j) / f64::from(j + 1));
    let mut sum = 0.0;
    for i in 1..=n {
        for k in 0..i {
            sum += choose(i - 1, k) * (-1.0_f64).powi(k as i32) * each.powi(k as i32 + 1) / f64::from(k + 1).sqrt();
        }
    }
    (each, o / sum)
}

#[test]
fn share_gives_the_known_numbers() {
    for (o, n, each, factor) in [(0.5, 2, 0.29289, 0.95215), (0.9, 5, 0.36904, 0.79712)] {
        let got = relocation(o, n);
        assert!((got.0 - each).abs() < 5e-6 && (got.1 - factor).abs() < 5e-6, "{got:?}");
    }
    assert_eq!(relocation(0.3, 1), (0.3, 1.0));
    assert_eq!(relocation(0.3, 0), (0.3, 1.0));
    assert_eq!(relocation(0.0, 7), (0.0, 1.0));
}

#[test]
fn share_is_the_sum_of_the_paper_where_the_sum_has_digits() {
    for o in [1e-9, 0.005, 0.1, 0.5, 0.9, 0.99, 1.0 - 1e-6] {
        for n in [2, 3, 5, 10, 20, 50] {
            let (got, want) = (relocation(o, n), share_by_sum(o, n));
            // The larger binomials of the sum, and what 1 - (1 - o) loses.
            let rounding = 1e-13 * (1.0 + want.0).powi(n as i32) + 1e-15 / o;
            assert!((got.0 - want.0).abs() < 1e-14, "o {o}, n {n}: {got:?}, sum {want:?}");
            assert!((got.1 / want.1 - 1.0).abs() < rounding, "o {o}, n {n}: {got:?}, sum {want:?}");
        }
    }
    // Opaque: (1 - exp(-x^2))^50 by itself, far from rounding; and never larger than before.
    let (each, factor) = relocation(1.0, 50);
    assert!(each == 1.0 && (0.3..0.6).contains(&factor), "{each}, {factor}");
}

#[test]
fn the_fate_of_ten_is_known() {
    let o = [0.004, 0.0, 0.001, 0.8, 0.003, 0.0, 0.004, 0.002, 0.001, 0.005];
    let mut g = ten(o, [0.1; 10]);
    for i in [1, 5] {
        g.logit[i] = -200.0;
    }
    // 0.005 itself is dead.
    g.logit[9] = -5.293_306;
    let Change { cloud, rows } = MCMC.relocate(&g, STREAM).unwrap();
    assert_eq!(rows.from(), [3; 10]);
    assert_eq!(rows.fresh(), [true; 10]);
    let (each, factor) = relocation(f64::from(0.8_f32), 10);
    for i in 0..10 {
        let (got, source) = (numbers(&cloud, i), numbers(&g, 3));
        assert!((opacity(&cloud, i) - each).abs() < 1e-7, "{i}");
        for log_scale in &got[3..6] {
            assert!((f64::from(*log_scale).exp() - 0.1 * factor).abs() < 1e-7, "{i}");
        }
        assert_eq!((&got[..3], &got[6..10], &got[11..]), (&source[..3], &source[6..10], &source[11..]));
    }
    // All ten let through what one did.
    let through: f64 = (0..10).map(|i| 1.0 - opacity(&cloud, i)).product();
    assert!((through - 0.2).abs() < 1e-6, "{through}");
}

#[test]
fn those_that_live_and_are_not_drawn_stay_as_they_are() {
    let g = ten([0.9, 0.001, 0.5, 0.3, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5], [0.2; 10]);
    let Change { cloud, rows } = MCMC.relocate(&g, STREAM).unwrap();
    let source = rows.from()[1] as usize;
    assert_ne!(source, 1);
    for i in (0..10).filter(|&i| i != 1 && i != source) {
        assert_eq!(numbers(&cloud, i), numbers(&g, i));
        assert!(rows.from()[i] as usize == i && !rows.fresh()[i]);
    }
    assert_eq!(numbers(&cloud, 1), numbers(&cloud, source));
    assert!(rows.fresh()[1] && rows.fresh()[source]);
    let through = (1.0 - opacity(&cloud, 1)).powi(2);
    assert!((through - (1.0 - opacity(&g, source))).abs() < 1e-6);
}

#[test]
fn nothing_moves_where_all_are_dead_or_none_is() {
    for o in [0.001, 0.5] {
        let g = ten([o; 10], [0.1; 10]);
        let change = MCMC.relocate(&g, STREAM).unwrap();
        assert!(change.rows.is_unchanged() && change.cloud == g, "{o}");
    }
}

#[test]
fn draws_are_in_proportion_to_opacity() {
    // 30 000 dead, four that live.
    let n = 30_004;
    let mut g = Gaussians::new(n, 0).unwrap();
    g.logit.fill(-9.0);
    let weights = [0.1_f32, 0.2, 0.3, 0.4];
    for (k, w) in weights.into_iter().enumerate() {
        g.logit[7000 * k + 5] = (w / (1.0 - w)).ln();
    }
    let rows = MCMC.relocate(&g, STREAM).unwrap().rows;
    for (k, w) in weights.into_iter().enumerate() {
        let (p, at) = (f64::from(w), 7000 * k as u32 + 5);
        let drawn = rows.from().iter().filter(|&&from| from == at).count() as f64 - 1.0;
        // Five standard errors.
        assert!((drawn - 3e4 * p).abs() < 5.0 * (3e4 * p * (1.0 - p)).sqrt(), "{p}: {drawn}");
    }
}

#[test]
fn adding_grows_by_a_twentieth_up_to_the_cap() {
    let grown = |n: usize, max: usize| MCMC.add(&some(n, 0), max, STREAM).unwrap();
    for (n, max, want) in [(10, 100, 11), (100, 1000, 105), (100, 103, 103), (100, 100, 100), (100, 20, 100), (0, 9, 0)]
    {
        assert_eq!(grown(n, max).cloud.len(), want, "{n} of {max}");
    }
    assert!(grown(10, 0).rows.is_unchanged() && grown(10, 1).rows.is_unchanged());
    assert_eq!(grown(1, 2).rows.from(), [0, 0]);
    // What all let through together does not change.
    let (before, after) = (some(100, 0), grown(100, 1000).cloud);
    let through = |g: &Gaussians| (0..g.len()).map(|i| (1.0 - opacity(g, i)).ln()).sum::<f64>();
    assert!((through(&after) - through(&before)).abs() < 1e-5 * through(&before).abs());
    // All faint as they can be: nothing to draw from.
    let mut dark = some(50, 0);
    dark.logit.fill(f32::NEG_INFINITY);
    assert!(MCMC.add(&dark, 100, STREAM).unwrap().rows.is_unchanged());
}

#[test]
fn noise_has_the_covariance_squared_and_stops_above_the_dead() {
    let n = 40_000;
    let mut g = Gaussians::new(n, 0).unwrap();
    for (k, s) in [0.3_f32, 0.2, 0.1].into_iter().enumerate() {
        g.log_scale[k * n..][..n].fill(s.ln());
    }
    // x to y to z.
    g.wxyz.fill(0.5);
    let o: f32 = 0.005;
    g.logit.fill((o / (1.0 - o)).ln());
    MCMC.add_noise(&mut g, 1e-4, STREAM).unwrap();
    // Half open: 5e5 * 1e-4 / 2.
    for (k, s) in [0.1_f64, 0.3, 0.2].into_iter().enumerate() {
        let row = g.mean[k * n..][..n].iter().map(|&x| f64::from(x) / 25.0);
        let deviation = (row.map(|x| x * x).sum::<f64>() / n as f64).sqrt();
        assert!((deviation / (s * s) - 1.0).abs() < 5.0 / (2.0 * n as f64).sqrt(), "axis {k}: {deviation}");
    }
    // 0.3 above the dead: exp(-29.5).
    g.mean.fill(0.0);
    g.logit.fill((0.3_f32 / 0.7).ln());
    MCMC.add_noise(&mut g, 1e-4, STREAM).unwrap();
    let most = g.mean.iter().fold(0.0_f32, |m, x| m.max(x.abs()));
    assert!(most > 0.0 && most < 1e-10, "{most}");
    g.mean.fill(1.0);
    MCMC.add_noise(&mut g, 1e-4, STREAM).unwrap();
    assert!(g.mean.iter().all(|&x| x == 1.0));
}

#[test]
fn regularisers_are_means_and_their_slopes() {
    let (g, mcmc) = (some(37, 0), MCMC.with_opacity_weight(0.02).with_scale_weight(0.03));
    let loss = |g: &Gaussians| {
        let o = (0..37).map(|i| opacity(g, i)).sum::<f64>() / 37.0;
        0.02 * o + 0.03 * g.log_scale.iter().map(|&x| f64::from(x).exp()).sum::<f64>() / 111.0
    };
    let mut grad = some(37, 0);
    let added_to = grad.clone();
    let value = mcmc.regularise(&g, &mut grad).unwrap();
    assert!((value - loss(&g)).abs() < 1e-8, "{value}");
    for (k, rows) in [(1, 111), (3, 37)] {
        for i in 0..rows {
            let mut moved = [g.clone(), g.clone()];
            let h = 1.0 / 256.0;
            moved[0].fields_mut()[k].1[i] += h;
            moved[1].fields_mut()[k].1[i] -= h;
            let (x, y) = (moved[0].fields()[k].1[i], moved[1].fields()[k].1[i]);
            let slope = (loss(&moved[0]) - loss(&moved[1])) / f64::from(x - y);
            let got = f64::from(grad.fields()[k].1[i] - added_to.fields()[k].1[i]);
            assert!((got - slope).abs() < 1e-4 * slope.abs() + 2e-7, "{k} {i}: {got}, difference {slope}");
        }
    }
    assert_eq!((&grad.mean, &grad.wxyz, &grad.dc), (&added_to.mean, &added_to.wxyz, &added_to.dc));
}

#[test]
fn empty_clouds_and_wrong_constants() {
    let mut none = some(0, 3);
    assert!(MCMC.relocate(&none, STREAM).unwrap().rows.is_unchanged());
    assert_eq!(MCMC.regularise(&none, &mut some(0, 3)).unwrap(), 0.0);
    MCMC.add_noise(&mut none, 1.0, STREAM).unwrap();
    let wrong = MCMC.with_opacity_dead(0.0);
    assert!(matches!(wrong.relocate(&none, STREAM), Err(SplatError::Value { what: "opacity_dead", .. })));
    assert!(matches!(MCMC.add_noise(&mut none, f64::NAN, STREAM), Err(SplatError::Value { what: "lr", .. })));
    assert!(matches!(MCMC.regularise(&some(3, 0), &mut none), Err(SplatError::Shape { what: "grad", .. })));
    let nearly_one = MCMC.with_opacity_dead(0.999_999_99);
    assert!(nearly_one.add(&some(1, 0), 2, STREAM).unwrap().cloud.logit.iter().all(|x| x.is_finite()));
    let moves: Vec<u64> = (0..30_000).filter(|&s| MCMC.relocates_at(s)).collect();
    assert_eq!((moves[0], moves[moves.len() - 1]), (600, 24_900));
}

proptest! {
    #![proptest_config(testkit::property::cases(256))]
    #[test]
    fn what_gets_through_a_place_stays_the_same(o in 0.3_f64..0.999, n in 2_u32..50) {
        let (each, factor) = relocation(o, n);
        prop_assert!(((1.0 - each).powi(n as i32) / (1.0 - o) - 1.0).abs() < 1e-9);
        prop_assert!(each < o && factor < 1.0 && factor > 0.2);
    }

    #[test]
    fn relocation_keeps_the_count_and_leaves_none_dead(
        logits in proptest::collection::vec(prop_oneof![-20.0..20.0_f32, Just(f32::NAN), Just(f32::INFINITY)], 1..60),
        seed in any::<u64>(),
    ) {
        let mut g = some(logits.len(), 0);
        g.logit.copy_from_slice(&logits);
        let dead = |x: f32| f64::from(x) <= (0.005_f64 / 0.995).ln();
        let change = MCMC.relocate(&g, Rng::new(seed, 0)).unwrap();
        prop_assert_eq!(change.cloud.len(), g.len());
        if logits.iter().any(|&x| !dead(x) && !x.is_nan()) {
            for i in 0..g.len() {
                prop_assert!(!dead(g.logit[change.rows.from()[i] as usize]));
            }
            // Only rows drawn or moved differ, and only there is history lost.
            for i in (0..g.len()).filter(|&i| !change.rows.fresh()[i]) {
                prop_assert_eq!(numbers(&change.cloud, i).map_bits(), numbers(&g, i).map_bits());
            }
        }
    }
}

/// NaN is not equal to itself, its bits are.
trait MapBits {
    fn map_bits(self) -> Vec<u32>;
}

impl MapBits for Vec<f32> {
    fn map_bits(self) -> Vec<u32> {
        self.into_iter().map(f32::to_bits).collect()
    }
}
