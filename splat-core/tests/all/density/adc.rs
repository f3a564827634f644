use super::{STREAM, numbers, opacity, some, ten};
use float_core::rng::Rng;
use proptest::prelude::*;
use splat_core::density::{Adc, Fresh, Rows};
use splat_core::{Gaussians, SplatError};

const ADC: Adc = Adc::DEFAULT;
const O: [f32; 10] = [0.5, 0.1, 0.9, 0.004, 0.5, 0.006, 0.5, 0.001, 0.5, 0.5];
/// With an extent of 1: from 0.01 on large, from 0.1 on too large.
const S: [f32; 10] = [0.001, 0.009, 0.02, 0.003, 0.05, 0.002, 0.3, 0.5, 0.0101, 0.0099];
const GRADIENT: [f32; 10] = [3e-4, 1e-4, 2e-4, 0.0, 9e-4, 2.1e-4, 1.9e-4, 5e-4, 3e-4, 1e-3];

#[test]
fn the_fate_of_ten_is_known() {
    let g = ten(O, S);
    let grown = ADC.grow(&g, &GRADIENT, 1.0, 100, STREAM).unwrap();
    // They grow: 0, 2, 4, 5, 7, 8, 9. Of them 2, 4, 7, 8 are large.
    assert_eq!(grown.rows.from(), [0, 1, 3, 5, 6, 9, 0, 5, 9, 2, 2, 4, 4, 7, 7, 8, 8]);
    assert_eq!(grown.rows.fresh(), [vec![false; 6], vec![true; 11]].concat());
    for at in 0..9 {
        assert_eq!(numbers(&grown.cloud, at), numbers(&g, grown.rows.from()[at] as usize), "a clone is an exact copy");
    }
    for at in 9..17 {
        let (child, parent) = (numbers(&grown.cloud, at), numbers(&g, grown.rows.from()[at] as usize));
        assert!((0..3).all(|k| child[k] != parent[k]));
        for k in 3..6 {
            assert!((child[k].exp() * 1.6 / parent[k].exp() - 1.0).abs() < 1e-6);
        }
        assert_eq!(child[6..], parent[6..]);
    }
    // Then 3 and the children of 7 are too faint; late, 6 is too large, and so would be the children of 7.
    let early = ADC.prune(&grown.cloud, 1.0, 3000, |_| false).unwrap();
    let rows = grown.rows.then(&early).unwrap();
    assert_eq!(rows.from(), [0, 1, 5, 6, 9, 0, 5, 9, 2, 2, 4, 4, 8, 8]);
    let late = ADC.prune(&grown.cloud, 1.0, 3001, |_| false).unwrap();
    assert_eq!(grown.rows.then(&late).unwrap().from(), [0, 1, 5, 9, 0, 5, 9, 2, 2, 4, 4, 8, 8]);
    let spared = ADC.prune(&grown.cloud, 1.0, 3001, |i| i == 4 || i == 13).unwrap();
    assert_eq!(grown.rows.then(&spared).unwrap().from(), [0, 1, 5, 6, 9, 0, 5, 9, 2, 2, 4, 4, 7, 8, 8]);
    // Moments follow: those of survivors, 0 for all others.
    let moments: Vec<f32> = (1..=20).map(|i| i as f32).collect();
    let followed = rows.apply("moments", &moments, 2, Fresh::Is(0.0)).unwrap();
    let zeros = [0.0; 9];
    assert_eq!(followed, [&[1.0, 2.0, 6.0, 7.0, 10.0][..], &zeros, &[11.0, 12.0, 16.0, 17.0, 20.0], &zeros].concat());
}

#[test]
fn a_cap_lets_the_hottest_grow_first_and_among_equals_the_first() {
    let g = ten(O, S);
    let grown = |max: usize| ADC.grow(&g, &GRADIENT, 1.0, max, STREAM).unwrap();
    let fresh = |max: usize| {
        let rows = grown(max).rows;
        assert_eq!(rows.len(), max.max(10));
        (0..rows.len()).filter(|&i| rows.fresh()[i]).map(|i| rows.from()[i]).collect::<Vec<_>>()
    };
    // By gradient: 9, 4, 7, then 0 and 8 (equal), 5, 2.
    assert_eq!(fresh(11), [9]);
    assert_eq!(fresh(12), [9, 4, 4]);
    assert_eq!(fresh(13), [9, 4, 4, 7, 7]);
    assert_eq!(fresh(14), [0, 9, 4, 4, 7, 7]);
    assert_eq!(fresh(15), [0, 9, 4, 4, 7, 7, 8, 8]);
    for max in [0, 1, 9, 10] {
        assert!(grown(max).rows.is_unchanged() && grown(max).cloud == g, "{max}");
    }
    // A child is the same whoever else is split.
    let all = grown(usize::MAX).cloud;
    assert_eq!(numbers(&grown(12).cloud, 10), numbers(&all, 11));
}

#[test]
fn children_are_drawn_from_their_parent() {
    let n = 20_000;
    let mut g = Gaussians::new(n, 0).unwrap();
    // Axes of 3, 2 and 1, turned by a third of a circle about (1, 1, 1): x to y to z.
    let (centre, sizes) = ([5.0, -7.0, 2.0], [3.0_f32, 2.0, 1.0]);
    for k in 0..3 {
        g.mean[k * n..][..n].fill(centre[k]);
        g.log_scale[k * n..][..n].fill(sizes[k].ln());
    }
    g.wxyz.fill(-3.0);
    let grown = ADC.grow(&g, &vec![1.0; n], 1.0, 2 * n, STREAM).unwrap().cloud;
    assert_eq!(grown.len(), 2 * n);
    let row = |k: usize| grown.mean[k * 2 * n..][..2 * n].iter().map(move |&x| f64::from(x - centre[k]));
    let count = 2.0 * n as f64;
    for (k, want) in [1.0_f64, 3.0, 2.0].into_iter().enumerate() {
        let (mean, var) = (row(k).sum::<f64>() / count, row(k).map(|x| x * x).sum::<f64>() / count);
        // Five standard errors.
        assert!(mean.abs() < 5.0 * want / count.sqrt(), "axis {k}: mean {mean}");
        assert!((var / (want * want) - 1.0).abs() < 5.0 * (2.0 / count).sqrt(), "axis {k}: variance {var}");
        let next = row(k).zip(row((k + 1) % 3)).map(|(a, b)| a * b).sum::<f64>() / count;
        assert!(next.abs() < 5.0 * 6.0 / count.sqrt(), "axes {k}: covariance {next}");
    }
    // Brothers do not know of each other, nor do neighbours.
    for step in [1, 2] {
        let x: Vec<f64> = row(0).collect();
        let product = x.chunks_exact(2 * step).map(|c| c[0] * c[step]).sum::<f64>() / (count / (2 * step) as f64);
        assert!(product.abs() < 5.0 / (count / (2 * step) as f64).sqrt(), "{product}");
    }
}

#[test]
fn fading_takes_opacity_and_gives_none() {
    let mut g = ten(O, S);
    g.logit[9] = f32::NAN;
    let before = g.clone();
    ADC.reset_opacity(&mut g, |i| i != 4).unwrap();
    for i in 0..9 {
        let want = if i == 4 { opacity(&before, i) } else { opacity(&before, i).min(0.01) };
        assert!((opacity(&g, i) - want).abs() < 1e-8, "{i}");
    }
    assert!(g.logit[9].is_nan(), "the guard must still see it");
    assert_eq!((&g.mean, &g.log_scale, &g.dc), (&before.mean, &before.log_scale, &before.dc));
}

#[test]
fn steps_are_those_of_the_paper() {
    let grows: Vec<u64> = (0..20_000).filter(|&s| ADC.grows_at(s)).collect();
    assert_eq!((grows[0], grows[1], grows.len(), grows[grows.len() - 1]), (600, 700, 144, 14_900));
    let resets: Vec<u64> = (0..20_000).filter(|&s| ADC.resets_at(s)).collect();
    assert_eq!(resets, [3000, 6000, 9000, 12_000]);
}

#[test]
fn constants_out_of_range_and_wrong_lengths_are_refused_by_name() {
    let g = ten(O, S);
    let adc = ADC.with_shrink(f64::NAN);
    let refused = adc.grow(&g, &GRADIENT, 1.0, 100, STREAM).unwrap_err().to_string();
    assert!(refused.contains("`shrink` is NaN"), "{refused}");
    assert!(ADC.with_every(0).check().is_err() && ADC.with_opacity_min(1.0).check().is_err());
    let short = ADC.grow(&g, &GRADIENT[1..], 1.0, 100, STREAM);
    assert_eq!(short.unwrap_err(), SplatError::Shape { what: "view_space_gradient", want: 10, got: 9 });
}

#[test]
fn an_empty_cloud_stays_empty() {
    let mut none = some(0, 3);
    assert!(ADC.grow(&none, &[], 1.0, 100, STREAM).unwrap().rows.is_unchanged());
    assert_eq!(ADC.prune(&none, 1.0, 9000, |_| false).unwrap(), Rows::unchanged(0).unwrap());
    ADC.reset_opacity(&mut none, |_| true).unwrap();
}

#[test]
fn all_may_be_pruned() {
    let rows = ADC.prune(&ten([0.001; 10], S), 1.0, 1, |_| false).unwrap();
    assert!(rows.is_empty() && rows.follow(&ten(O, S)).unwrap().is_empty());
}

proptest! {
    #![proptest_config(testkit::property::cases(256))]
    #[test]
    fn each_that_grows_is_one_more_and_the_rest_keep_their_order(
        pull in proptest::collection::vec(prop_oneof![Just(0.0_f32), Just(2e-4), 0.0..1e-3_f32, Just(f32::NAN)], 0..80),
        max in 0_usize..120,
        seed in any::<u64>(),
    ) {
        let n = pull.len();
        let mut g = some(n, 1);
        g.log_scale.iter_mut().for_each(|x| *x -= 4.6);
        let grown = ADC.grow(&g, &pull, 1.0, max, Rng::new(seed, 0)).unwrap();
        let hot = pull.iter().filter(|&&p| p >= 2e-4).count();
        prop_assert_eq!(grown.cloud.len(), n + hot.min(max.saturating_sub(n)));
        prop_assert_eq!(grown.cloud.len(), grown.rows.len());
        let old: Vec<u32> = (0..grown.rows.len()).filter(|&i| !grown.rows.fresh()[i]).map(|i| grown.rows.from()[i]).collect();
        prop_assert!(old.is_sorted());
        for (i, &from) in old.iter().enumerate() {
            prop_assert_eq!(numbers(&grown.cloud, i), numbers(&g, from as usize));
        }
        let again = ADC.grow(&g, &pull, 1.0, max, Rng::new(seed, 0)).unwrap();
        prop_assert_eq!(grown, again);
    }
}
