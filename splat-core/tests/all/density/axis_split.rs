use super::{STREAM, numbers, opacity, some, ten};
use float_core::Simd;
use proptest::prelude::*;
use splat_core::density::{Adc, AxisSplit};
use splat_core::{Cloud, Gaussians, RasterSettings, Renderer, SplatError, View};

const SPLIT: AxisSplit = AxisSplit::DEFAULT;
const O: [f32; 10] = [0.5, 0.1, 0.9, 0.004, 0.5, 0.006, 0.5, 0.001, 0.5, 0.5];
const S: [f32; 10] = [0.1; 10];
const GRADIENT: [f32; 10] = [3e-4, 1e-4, 2e-4, 0.0, 9e-4, f32::NAN, 1.9e-4, 5e-4, 3e-4, 1e-3];

/// Mass (opacity times the product of the standard deviations), centre and covariance of Gaussian `i`.
fn moments(g: &Gaussians, i: usize) -> (f64, [f64; 3], [[f64; 3]; 3]) {
    let n = g.len();
    let q = [0, 1, 2, 3].map(|k| f64::from(g.wxyz[k * n + i]));
    let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    let [w, x, y, z] = q.map(|x| x / norm);
    let r = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ];
    let s = [0, 1, 2].map(|k| f64::from(g.log_scale[k * n + i]).exp());
    let covariance = [0, 1, 2].map(|a| [0, 1, 2].map(|b| (0..3).map(|k| r[a][k] * s[k] * s[k] * r[b][k]).sum()));
    (opacity(g, i) * s.iter().product::<f64>(), [0, 1, 2].map(|k| f64::from(g.mean[k * n + i])), covariance)
}

#[test]
fn children_have_their_parent_s_mass_centre_and_covariance() {
    let parents = some(40, 1);
    for shorter in [0.5, 0.6, SPLIT.shorter, 0.9] {
        let grown = SPLIT.with_shorter(shorter).grow(&parents, &[1.0; 40], 80).unwrap().cloud;
        for i in 0..40 {
            let (mass, centre, covariance) = moments(&parents, i);
            let children = [2 * i, 2 * i + 1].map(|at| moments(&grown, at));
            let sum: f64 = children.iter().map(|child| child.0).sum();
            assert!((sum / mass - 1.0).abs() < 1e-5, "mass {sum} of {mass}");
            for a in 0..3 {
                let mean = 0.5 * (children[0].1[a] + children[1].1[a]);
                assert!((mean - centre[a]).abs() < 1e-5, "{mean}, {centre:?}");
                for b in 0..3 {
                    let got: f64 = children
                        .iter()
                        .map(|child| 0.5 * (child.2[a][b] + (child.1[a] - centre[a]) * (child.1[b] - centre[b])))
                        .sum();
                    let size = (covariance[a][a] * covariance[b][b]).sqrt();
                    assert!((got - covariance[a][b]).abs() < 1e-4 * size, "{got}, {covariance:?}");
                }
            }
        }
    }
}

#[test]
fn those_with_the_largest_gradients_are_split_in_the_order_of_their_sources() {
    let g = ten(O, S);
    let grown = SPLIT.grow(&g, &GRADIENT, 100).unwrap();
    assert_eq!(grown.rows.from(), [1, 3, 5, 6, 0, 0, 2, 2, 4, 4, 7, 7, 8, 8, 9, 9]);
    assert_eq!(grown.rows.fresh(), [vec![false; 4], vec![true; 12]].concat());
    for at in 0..4 {
        assert_eq!(numbers(&grown.cloud, at), numbers(&g, grown.rows.from()[at] as usize));
    }
    let split = |max| SPLIT.grow(&g, &GRADIENT, max).unwrap().rows.from()[8.min(max)..].to_vec();
    assert_eq!(split(12), [4, 4, 9, 9]);
    assert_eq!(SPLIT.grow(&g, &GRADIENT, 13).unwrap().rows.from()[7..], [4, 4, 7, 7, 9, 9]);
    for max in [0, 9, 10] {
        assert!(SPLIT.grow(&g, &GRADIENT, max).unwrap().rows.is_unchanged());
    }
}

#[test]
fn the_picture_changes_less_than_by_clones_and_random_splits() {
    let n = 300;
    let mut g = some(n, 0);
    for k in 0..n {
        g.mean[2 * n + k] += 6.0;
        for axis in 0..3 {
            g.log_scale[axis * n + k] = -2.0 + 0.5 * g.log_scale[axis * n + k];
        }
    }
    let view = View {
        r: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        t: [0.0; 3],
        f: [60.0; 2],
        c: [32.0; 2],
        size: [64, 64],
    };
    let picture = |cloud: &Gaussians| {
        let mut renderer = Renderer::<3>::new(RasterSettings::DEFAULT).with_simd(Simd::best());
        renderer.render(&[Cloud::new(cloud)], &view).unwrap().planes().to_vec()
    };
    let before = picture(&g);
    let change = |cloud: &Gaussians| {
        let after = picture(cloud);
        after.iter().zip(&before).map(|(a, b)| f64::from((a - b).powi(2))).sum::<f64>() / before.len() as f64
    };
    let split = change(&SPLIT.grow(&g, &vec![1.0; n], 2 * n).unwrap().cloud);
    let grown = |adc: Adc| change(&adc.grow(&g, &vec![1.0; n], 1.0, 2 * n, STREAM).unwrap().cloud);
    let (random, clone) = (grown(Adc::DEFAULT), grown(Adc::DEFAULT.with_split_above(1e9)));
    assert!(split < 0.3 * clone.min(random), "axis {split}, random {random}, clone {clone}");
}

#[test]
fn opacities_fade_to_the_least_one_and_no_further() {
    let mut g = ten(O, S);
    g.logit[9] = f32::NAN;
    let before = g.clone();
    SPLIT.fade(&mut g).unwrap();
    assert_eq!(g.logit[..9], before.logit[..9], "by default they do not");
    let fading = SPLIT.with_decay(0.5).with_decay_to(0.02);
    fading.fade(&mut g).unwrap();
    for i in 0..9 {
        let o = opacity(&before, i);
        let want = if o > 0.02 { (0.5 * o).max(0.02) } else { o };
        assert!((opacity(&g, i) - want).abs() < 1e-6, "{i}");
    }
    assert!(g.logit[9].is_nan(), "the guard must still see it");
    let often = SPLIT.with_after(10).with_until(31).with_fade_every(5);
    assert_eq!((0..50).filter(|step| often.fades_at(*step)).collect::<Vec<_>>(), [15, 20, 25, 30]);
}

#[test]
fn faint_ones_are_pruned_unless_they_are_exempt() {
    let g = ten(O, S);
    assert_eq!(SPLIT.prune(&g, |_| false).unwrap().from(), [0, 1, 2, 4, 5, 6, 8, 9]);
    assert_eq!(SPLIT.prune(&g, |i| i == 7).unwrap().from(), [0, 1, 2, 4, 5, 6, 7, 8, 9]);
}

#[test]
fn the_room_grows_evenly_and_is_all_given_out_at_the_last_change() {
    for (until, every, start, max) in [(4800, 100, 5000, 100_000), (850, 100, 7, 7000), (1001, 50, 300, 301)] {
        let rules = SPLIT.with_until(until).with_every(every).with_after(every);
        let (mut n, mut steps) = (start, Vec::new());
        for step in (0..2 * until).filter(|&step| rules.grows_at(step)) {
            let room = rules.room(step, n, max);
            steps.push(room - n);
            n = room;
        }
        assert_eq!(n, max);
        let (least, most) = (steps.iter().min().unwrap(), steps.iter().max().unwrap());
        assert!(most - least <= 1, "{least} to {most}");
    }
    assert_eq!(SPLIT.room(9000, 50, 40), 50, "more than there may be: none is added");
}

#[test]
fn settings_out_of_range_and_wrong_lengths_are_refused_by_name() {
    let g = ten(O, S);
    for (rules, name) in [
        (SPLIT.with_shorter(0.4), "shorter"),
        (SPLIT.with_shorter(f64::NAN), "shorter"),
        (SPLIT.with_every(0), "every"),
        (SPLIT.with_fade_every(0), "fade_every"),
        (SPLIT.with_decay(0.0), "decay"),
        (SPLIT.with_decay_to(1.0), "decay_to"),
        (SPLIT.with_opacity_min(0.0), "opacity_min"),
        (SPLIT.with_gradient_threshold(f32::INFINITY), "gradient_threshold"),
    ] {
        let refused = rules.grow(&g, &GRADIENT, 100).unwrap_err().to_string();
        assert!(refused.contains(&format!("`{name}`")), "{refused}");
    }
    let short = SPLIT.grow(&g, &GRADIENT[1..], 100);
    assert_eq!(short.unwrap_err(), SplatError::Shape { what: "view_space_gradient", want: 10, got: 9 });
}

#[test]
fn an_empty_cloud_stays_empty() {
    let mut none = some(0, 3);
    assert!(SPLIT.grow(&none, &[], 100).unwrap().rows.is_unchanged());
    assert!(SPLIT.prune(&none, |_| false).unwrap().is_empty());
    SPLIT.with_decay(0.5).fade(&mut none).unwrap();
}

proptest! {
    #![proptest_config(testkit::property::cases(256))]
    #[test]
    fn each_that_grows_is_one_more_and_extreme_ones_stay_numbers(
        pull in proptest::collection::vec(prop_oneof![Just(0.0_f32), Just(2e-4), 0.0..1e-3_f32, Just(f32::NAN)], 0..80),
        max in 0_usize..120,
        stretch in -30.0_f32..10.0,
        logit in -20.0_f32..20.0,
    ) {
        let n = pull.len();
        let mut g = some(n, 1);
        g.log_scale.iter_mut().for_each(|x| *x += stretch);
        g.logit.iter_mut().for_each(|x| *x += logit);
        let grown = SPLIT.grow(&g, &pull, max).unwrap();
        let hot = pull.iter().filter(|&&p| p >= 2e-4).count();
        prop_assert_eq!(grown.cloud.len(), n + hot.min(max.saturating_sub(n)));
        prop_assert_eq!(grown.cloud.len(), grown.rows.len());
        prop_assert!(grown.cloud.fields().iter().all(|(_, x)| x.iter().all(|x| x.is_finite())));
        for (at, &from) in grown.rows.from().iter().enumerate().filter(|&(at, _)| grown.rows.fresh()[at]) {
            prop_assert!(opacity(&grown.cloud, at) <= opacity(&g, from as usize));
        }
        prop_assert_eq!(&grown, &SPLIT.grow(&g, &pull, max).unwrap());
    }
}
