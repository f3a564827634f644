//! The 3D filter: its size, what it does, and its gradient.

use crate::common::{cloud, view};
use crate::twin::flat;
use float_core::Simd;
use float_core::rng::Rng;
use splat_core::{Gaussians, Smoothed, SmoothingFilter, SplatError, View};
use testkit::reference::splats::smooth;

const FILTER: SmoothingFilter = SmoothingFilter::DEFAULT;

/// Numbers of filters: some none, the others from far below to far above the Gaussians.
fn sizes(n: usize) -> Vec<f32> {
    let rng = Rng::new(7, 7);
    (0..n).map(|i| if i % 5 == 0 { 0.0 } else { (-2.0 + 2.0 * rng.normal_at(i as u64)).exp() }).collect()
}

fn smoothed(simd: Simd, before: &Gaussians, sizes: &[f32]) -> Gaussians {
    let (mut out, mut buffers) = (before.clone(), Smoothed::default());
    buffers.smooth(simd, &out, sizes).unwrap();
    buffers.exchange(&mut out);
    let mut back = out.clone();
    buffers.exchange(&mut back);
    assert_eq!(&back, before);
    out
}

#[test]
fn the_finest_pixel_that_sees_a_gaussian_is_its_size() {
    let mut g = Gaussians::new(5, 0).unwrap();
    // Before both, before one, beside all by more than the margin, behind them, too near.
    g.mean.copy_from_slice(&[0.0, 0.0, 50.0, 0.0, 0.0, 0.0, 3.7, 0.0, 0.0, 0.0, 4.0, 8.0, 4.0, -4.0, 0.1]);
    let near = View { f: [20.0, 10.0], c: [16.0; 2], ..View::at_origin([32, 32]) };
    let far = View { f: [80.0; 2], c: [16.0; 2], t: [0.0, 0.0, 2.0], ..near };
    let factor = 0.2_f64.sqrt();
    let got = FILTER.sizes(&g, &[near, far]).unwrap();
    let of_both = (4.0_f64 / 20.0).min(6.0 / 80.0) * factor;
    let of_one = 8.0 / 20.0 * factor;
    for (got, want) in got.iter().zip([of_both, of_one, of_one, of_one, 2.1 / 80.0 * factor]) {
        assert!((f64::from(*got) - want).abs() < 1e-6 * want, "{got} {want}");
    }
    // Within the margin: 3.7 is at pixel 20.6 + 16 of 32, one and a seventh.
    assert!(got[1] > 0.0 && FILTER.with_margin(0.0).sizes(&g, &[near]).unwrap()[0] > 0.0);
    assert_eq!(FILTER.sizes(&g, &[]).unwrap(), [0.0; 5]);
    assert_eq!(FILTER.sizes(&Gaussians::new(0, 0).unwrap(), &[near]).unwrap(), [0.0; 0]);
    assert_eq!(FILTER.with_variance(0.0).sizes(&g, &[near]).unwrap(), [0.0; 5]);
    g.mean[0] = f32::NAN;
    assert!(FILTER.sizes(&g, &[near]).unwrap().iter().all(|size| size.is_finite()));
}

#[test]
fn as_the_twin_in_64_bits_filters_them() {
    // More than one task, and a last vector that is not full.
    let n = 2500;
    let before = cloud(3, n, 0);
    let filters = sizes(n);
    let mut want = flat(&before);
    smooth(&mut want, n, &filters.iter().map(|&x| x.into()).collect::<Vec<_>>());
    for simd in Simd::available() {
        let after = smoothed(simd, &before, &filters);
        assert_eq!((&after.mean, &after.wxyz, &after.dc), (&before.mean, &before.wxyz, &before.dc));
        for (k, (got, want)) in flat(&after).into_iter().zip(&want).enumerate() {
            assert!((got - want).abs() < 3e-6 * (1.0 + want.abs()), "{simd:?} {k}: {got} {want}");
        }
    }
}

#[test]
fn the_gradient_is_that_of_differences() {
    let n = 37;
    let before = cloud(4, n, 0);
    let filters = sizes(n);
    let wide: Vec<f64> = filters.iter().map(|&x| x.into()).collect();
    let bar = cloud(5, n, 0);
    let weights = flat(&bar);
    let loss = |p: &[f64]| {
        let mut p = p.to_vec();
        smooth(&mut p, n, &wide);
        p.iter().zip(&weights).map(|(x, w)| x * w).sum::<f64>()
    };
    for simd in Simd::available() {
        let mut grad = bar.clone();
        Smoothed::backward(simd, &before, &filters, &mut grad).unwrap();
        let at = flat(&before);
        for (k, got) in flat(&grad).into_iter().enumerate() {
            let along = |h: f64| {
                let mut p = at.clone();
                p[k] += h;
                loss(&p)
            };
            let want = (along(1e-6) - along(-1e-6)) / 2e-6;
            assert!((got - want).abs() < 2e-5 * (1.0 + want.abs()), "{simd:?} {k}: {got} {want}");
        }
    }
}

#[test]
fn numbers_of_any_size_stay_numbers() {
    let n = 6;
    let mut g = Gaussians::new(n, 0).unwrap();
    for (i, x) in g.log_scale.iter_mut().enumerate() {
        *x = [-60.0, -20.0, 0.0, 20.0, 60.0, -80.0][i % n];
    }
    g.logit.copy_from_slice(&[60.0, -60.0, 20.0, 100.0, -88.0, 0.0]);
    for size in [0.0, 1e-30, 1.0, 1e30] {
        let after = smoothed(Simd::best(), &g, &[size; 6]);
        assert!(after.log_scale.iter().chain(&after.logit).all(|x| x.is_finite()), "{size}: {after:?}");
        assert!(after.log_scale.iter().zip(&g.log_scale).all(|(after, before)| after >= before));
        assert!(after.logit.iter().zip(&g.logit).all(|(after, before)| *after <= *before + 1e-4 * before.abs()));
        let mut grad = g.clone();
        Smoothed::backward(Simd::best(), &g, &[size; 6], &mut grad).unwrap();
        assert!(grad.log_scale.iter().chain(&grad.logit).all(|x| x.is_finite()), "{size}: {grad:?}");
    }
    // What is not a number stays none, in its own row.
    g.log_scale[0] = f32::NAN;
    let after = smoothed_of_nan(&g);
    assert!(after.log_scale[0].is_nan() && after.log_scale[1..n].iter().all(|x| x.is_finite()));
    assert!(smoothed(Simd::best(), &Gaussians::new(0, 1).unwrap(), &[]).is_empty());
}

/// [`smoothed`] without comparing what is not equal to itself.
fn smoothed_of_nan(before: &Gaussians) -> Gaussians {
    let (mut out, mut buffers) = (before.clone(), Smoothed::default());
    buffers.smooth(Simd::best(), &out, &vec![0.1; before.len()]).unwrap();
    buffers.exchange(&mut out);
    out
}

#[test]
fn what_does_not_fit_is_refused_by_name() {
    let mut g = cloud(1, 4, 0);
    for (filter, name) in [
        (FILTER.with_variance(-1.0), "variance"),
        (FILTER.with_variance(f32::NAN), "variance"),
        (FILTER.with_near(0.0), "near"),
        (FILTER.with_margin(f32::INFINITY), "margin"),
    ] {
        let error = filter.sizes(&g, &[]).unwrap_err();
        assert!(matches!(error, SplatError::Value { what, .. } if what == name), "{error}");
    }
    let shape = |error: SplatError, name: &str| matches!(error, SplatError::Shape { what, .. } if what == name);
    assert!(shape(Smoothed::default().smooth(Simd::best(), &g, &[0.1; 3]).unwrap_err(), "sizes"));
    let mut grad = cloud(1, 3, 0);
    assert!(shape(Smoothed::backward(Simd::best(), &g, &[0.1; 4], &mut grad).unwrap_err(), "grad"));
    assert!(FILTER.sizes(&g, &[View { size: [0, 3], ..view([8, 8]) }]).is_err());
    g.logit.pop();
    assert!(shape(FILTER.sizes(&g, &[]).unwrap_err(), "logit"));
}
