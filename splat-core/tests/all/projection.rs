//! Ellipses on the picture against the specification and against what they are for.

use crate::common::{self, cloud, shoot, view};
use crate::twin;
use float_core::Simd;
use proptest::prelude::*;
use splat_core::{Gaussians, Projection, RasterSettings, SplatError, View, Widening};

fn project(simd: Simd, g: &Gaussians, view: &View, settings: &RasterSettings) -> Projection {
    let mut p = Projection::default();
    p.project(simd, g, view, settings, 3).unwrap();
    p
}

#[test]
fn ellipses_are_those_of_the_specification() {
    for widening in [Widening::Keeps, Widening::Dims] {
        let (settings, g, view) = (RasterSettings::DEFAULT.with_widening(widening), cloud(4, 500, 3), view([64, 48]));
        let want = twin::project(&twin::flat(&g), g.len(), 3, &view, &settings);
        for simd in Simd::available() {
            let p = project(simd, &g, &view, &settings);
            assert!(p.gaussians.len() > 300);
            for (f, rgb) in p.gaussians.iter().zip(&p.rgb) {
                let e = want.iter().find(|e| e.index == f.index as usize).expect("visible to the specification, too");
                let near = |what: &str, got: f32, want: f64, scale: f64| {
                    assert!((f64::from(got) - want).abs() < 1e-5 * scale, "{}: {what} {got}, expected {want}", f.index);
                };
                near("u", f.uv[0], e.uv[0], e.uv[0].abs() + 1.0);
                near("v", f.uv[1], e.uv[1], e.uv[1].abs() + 1.0);
                near("z", f.z, e.z, e.z);
                near("opacity", f.opacity, e.opacity, 1.0);
                near("q_max", f.q_max, e.q_max, e.q_max + 1.0 / e.opacity);
                let largest = e.conic[0].max(e.conic[2]);
                f.conic.iter().zip(e.conic).for_each(|(&got, want)| near("conic", got, want, largest));
                rgb.iter().zip(e.rgb).for_each(|(&got, want)| near("colour", got, want, 1.0));
            }
            // Whoever is left out does not reach the picture.
            for e in want.iter().filter(|e| !p.gaussians.iter().any(|f| f.index as usize == e.index)) {
                let reach = [(e.q_max * e.cov[0]).sqrt(), (e.q_max * e.cov[2]).sqrt()];
                let outside = |i: usize| e.uv[i] + reach[i] < 1e-3 || e.uv[i] - reach[i] > view.size[i] as f64 - 1e-3;
                assert!(outside(0) || outside(1), "{e:?}");
            }
        }
    }
}

#[test]
fn all_levels_see_the_same_gaussians_and_touch_the_same_tiles() {
    for seed in 0..5 {
        let (g, view) = (cloud(50 + seed, 400, 1), view([90, 70]));
        let shots = Simd::available().map(|simd| shoot(simd, &g, &view, &RasterSettings::DEFAULT));
        let seen: Vec<_> =
            shots.map(|s| (s.p.gaussians.iter().map(|f| f.index).collect::<Vec<_>>(), s.drawn)).collect();
        assert!(seen.windows(2).all(|w| w[0] == w[1]), "{seed}");
    }
}

#[test]
fn extents_are_those_of_the_ellipse_looked_at_from_many_angles() {
    let (g, view) = (cloud(8, 60, 0), view([400, 300]));
    let p = project(Simd::best(), &g, &view, &RasterSettings::DEFAULT);
    assert!(p.gaussians.len() > 40);
    for f in &p.gaussians {
        let [a, b, c] = f.conic.map(f64::from);
        let mut reach = [0.0_f64; 2];
        for k in 0..100_000 {
            let (s, co) = (std::f64::consts::TAU * f64::from(k) / 1e5).sin_cos();
            let r = (f64::from(f.q_max) / (a * co * co + 2.0 * b * s * co + c * s * s)).sqrt();
            reach = [reach[0].max(r * co), reach[1].max(r * s)];
        }
        for (half, reach) in f.half.into_iter().zip(reach) {
            assert!((f64::from(half) / reach - 1.0).abs() < 1e-5, "{half} {reach}");
        }
    }
}

#[test]
fn tiles_are_a_superset_with_little_to_spare() {
    let view = view([203, 151]);
    let (mut listed, mut needed) = (0, 0);
    for seed in 0..6 {
        let g = cloud(60 + seed, 300, 0);
        let shot = shoot(Simd::best(), &g, &view, &RasterSettings::DEFAULT);
        listed += shot.drawn.pairs;
        let ellipses = twin::of_projected(&shot.p);
        let [columns, rows] = view.size.map(|n| n.div_ceil(16));
        for e in &ellipses {
            for tile in 0..columns * rows {
                let (x, y) = (tile % columns * 16, tile / columns * 16);
                let inside = |i: usize| {
                    let d = [e.uv[0] - ((x + i % 16) as f64 + 0.5), e.uv[1] - ((y + i / 16) as f64 + 0.5)];
                    e.conic[0] * d[0] * d[0] + 2.0 * e.conic[1] * d[0] * d[1] + e.conic[2] * d[1] * d[1] < e.q_max
                };
                needed += u64::from((0..256).any(inside));
            }
        }
    }
    // Each that is needed is there: pictures show that. How many more there are, here.
    assert!(listed >= needed, "{listed} pairs of tile and ellipse, {needed} needed");
    let excess = listed as f64 / needed as f64 - 1.0;
    println!("{listed} pairs, {needed} needed: {:.1} % more", 100.0 * excess);
    assert!(excess < 0.05, "{excess}");
}

#[test]
fn a_bad_camera_and_bad_rules_are_refused_by_name() {
    let (g, good) = (cloud(1, 3, 0), view([20, 20]));
    let refuse = |view: &View, settings: &RasterSettings| {
        Projection::default().project(Simd::best(), &g, view, settings, 0).unwrap_err().to_string()
    };
    assert!(refuse(&View { f: [0.0, 1.0], ..good }, &RasterSettings::DEFAULT).contains("`view.f`"));
    assert!(refuse(&View { size: [0, 5], ..good }, &RasterSettings::DEFAULT).contains("`view.size`"));
    assert!(refuse(&View { t: [f32::NAN; 3], ..good }, &RasterSettings::DEFAULT).contains("`view`"));
    assert!(refuse(&good, &RasterSettings::DEFAULT.with_near(f32::NAN)).contains("`near`"));
    assert!(refuse(&good, &RasterSettings::DEFAULT.with_transmittance_min(1.0)).contains("`transmittance_min`"));
    let mut short = g.clone();
    short.logit.pop();
    let refused = Projection::default().project(Simd::best(), &short, &good, &RasterSettings::DEFAULT, 0);
    assert_eq!(refused, Err(SplatError::Shape { what: "logit", want: 3, got: 2 }));
}

#[test]
fn one_that_is_not_finite_is_not_seen_and_changes_no_other() {
    let view = view([40, 30]);
    for (seed, bad) in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY].into_iter().enumerate() {
        let clean = cloud(70 + seed as u64, 40, 2);
        for field in 0..6 {
            for row in 0..clean.fields()[field].1.len() / 40 {
                // A size of exp(-inf) = 0 is one, and so is an opacity of 1.
                let seen = [(1, f32::NEG_INFINITY), (3, f32::INFINITY)].contains(&(field, bad));
                let mut g = clean.clone();
                g.fields_mut()[field].1[row * 40 + 17] = bad;
                for simd in Simd::available() {
                    let mut shot = shoot(simd, &g, &view, &RasterSettings::DEFAULT);
                    assert!(seen || shot.p.gaussians.iter().all(|f| f.index != 17), "{bad} in {field}, {row}");
                    assert!(shot.planes.iter().all(|x| x.is_finite()));
                    let bar = common::bars(1, view.size);
                    let grad = shot.gradients(simd, &g, &view, &RasterSettings::DEFAULT, &bar);
                    assert!(
                        grad.fields().iter().all(|(_, x)| x.iter().all(|x| x.is_finite())),
                        "{bad} in {field}, {row}"
                    );
                    if !seen {
                        let without: Vec<usize> = (0..40).filter(|&i| i != 17).collect();
                        let rest = shoot(simd, &common::reordered(&clean, &without), &view, &RasterSettings::DEFAULT);
                        assert_eq!(shot.planes, rest.planes);
                    }
                }
            }
        }
    }
}

/// A number that is ordinary, or one of those that break things.
fn any_number(scale: f32) -> impl Strategy<Value = f32> {
    prop_oneof![
        8 => (-1.0_f32..1.0).prop_map(move |x| scale * x),
        1 => proptest::sample::select(vec![0.0, -0.0, 1e-45, 1e-20, 1e6, -1e6, 1e18, f32::MAX, f32::MIN]),
        1 => proptest::sample::select(vec![f32::NAN, f32::INFINITY, f32::NEG_INFINITY]),
    ]
}

fn within_1e18(x: f32) -> f32 {
    if x.is_finite() { x.clamp(-1e18, 1e18) } else { x }
}

prop_compose! {
    /// Gaussians ordinary, huge, tiny, needles, behind the camera, opaque, far away, broken.
    fn any_cloud()(n in 0_usize..24)(
        // Depths are features here: at 1e38 their gradients overflow.
        mean in proptest::collection::vec(any_number(3.0).prop_map(within_1e18), 3 * n),
        log_scale in proptest::collection::vec(prop_oneof![8 => -5.0_f32..1.0, 1 => -30.0_f32..8.0, 1 => any_number(90.0)], 3 * n),
        wxyz in proptest::collection::vec(any_number(1.0), 4 * n),
        logit in proptest::collection::vec(any_number(14.0), n),
        dc in proptest::collection::vec(-3.0_f32..3.0, 3 * n),
        rest in proptest::collection::vec(-1.0_f32..1.0, 9 * n),
    ) -> Gaussians {
        let mut g = Gaussians::new(logit.len(), 1).unwrap();
        (g.mean, g.log_scale, g.wxyz, g.logit, g.dc, g.rest) = (mean, log_scale, wxyz, logit, dc, rest);
        g
    }
}

proptest! {
    #![proptest_config(testkit::property::cases(400))]
    #[test]
    fn any_cloud_makes_finite_ellipses_and_the_picture_they_stand_for(
        g in any_cloud(),
        w in 1_usize..40,
        h in 1_usize..40,
        dims in any::<bool>(),
    ) {
        let settings = RasterSettings::DEFAULT.with_widening(if dims { Widening::Dims } else { Widening::Keeps });
        let view = view([w, h]);
        for simd in Simd::available() {
            let mut shot = shoot(simd, &g, &view, &settings);
            for f in &shot.p.gaussians {
                let numbers = [&f.uv[..], &f.conic, &f.half, &[f.opacity, f.q_max, f.z]].concat();
                prop_assert!(numbers.iter().all(|x| x.is_finite()), "{:?}", f);
                prop_assert!(f.conic[0] > 0.0 && f.conic[2] > 0.0 && f.z > settings.near && f.opacity <= 1.0, "{:?}", f);
            }
            let want = twin::draw(&twin::of_projected(&shot.p), view.size, &settings);
            let (worst, _) = want.worst(&shot.planes);
            prop_assert!(worst < 2.0, "{:?}: {} of rounding", simd.level(), worst);
            let bar = common::bars(3, view.size);
            let grad = shot.gradients(simd, &g, &view, &settings, &bar);
            // Beyond scales of 1e8 products of gradients may overflow; `density::keep_in_range` ends at ten times the scene.
            let huge = |i: u32| (0..3).any(|k| g.log_scale[k * g.len() + i as usize] > 20.0);
            if shot.p.gaussians.iter().any(|f| huge(f.index)) {
                continue;
            }
            for (field, x) in grad.fields() {
                prop_assert!(!x.iter().any(|x| x.is_nan()), "{:?}", field);
            }
        }
    }
}

#[test]
fn large_ones_beside_the_picture_reach_all_of_it() {
    let view = view([21, 18]);
    let mut g = Gaussians::new(1, 0).unwrap();
    // 60 pixels to the left, with a deviation of 20.
    let camera = [-7.0, 0.0, 2.2];
    for a in 0..3 {
        g.mean[a] = (0..3).map(|b| view.r[b][a] * (camera[b] - view.t[b])).sum();
        g.log_scale[a] = 0.85;
    }
    let want = twin::project(&twin::flat(&g), 1, 0, &view, &RasterSettings::DEFAULT);
    let want = twin::draw(&want, view.size, &RasterSettings::DEFAULT);
    let got = shoot(Simd::best(), &g, &view, &RasterSettings::DEFAULT);
    let (worst, _) = want.worst(&got.planes);
    assert!(worst < 2.0, "{worst} of rounding: {:?}", got.p.gaussians);
}

#[test]
fn gradients_of_another_cloud_or_of_features_that_do_not_exist_are_refused() {
    let (g, view, settings) = (cloud(2, 40, 1), view([20, 20]), RasterSettings::DEFAULT);
    let mut p = Projection::default();
    p.project(Simd::best(), &g, &view, &settings, 1).unwrap();
    assert!(!p.gaussians.is_empty());
    let gradients = vec![splat_core::ProjectedGradient::<4>::default(); p.gaussians.len()];
    let back = |p: &Projection, g: &Gaussians, depth| {
        let mut grad = g.clone();
        p.backward(Simd::best(), g, &view, &settings, 1, &gradients, depth, &mut grad)
    };
    assert_eq!(back(&p, &g, Some(3)), Ok(()));
    assert_eq!(back(&p, &g, Some(4)), Err(SplatError::Shape { what: "features", want: 5, got: 4 }));
    assert!(matches!(back(&p, &g, Some(usize::MAX)), Err(SplatError::Shape { what: "features", .. })));
    let last = p.gaussians.last().unwrap().index as usize + 1;
    let fewer = cloud(2, last - 1, 1);
    assert_eq!(back(&p, &fewer, None), Err(SplatError::Shape { what: "cloud", want: last, got: last - 1 }));
    p.rgb.pop();
    assert!(matches!(back(&p, &g, None), Err(SplatError::Shape { what: "rgb", .. })));
}
