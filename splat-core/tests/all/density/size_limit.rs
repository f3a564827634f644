use super::some;
use splat_core::density::SizeLimit;
use splat_core::{Gaussians, SplatError};

const LIMIT: SizeLimit = SizeLimit::DEFAULT.with_part(0.25).with_least(0.01);

/// Standard deviations of Gaussian `i`.
fn sizes(g: &Gaussians, i: usize) -> [f32; 3] {
    [0, 1, 2].map(|k| g.log_scale[k * g.len() + i].exp())
}

#[test]
fn what_is_large_beside_a_camera_is_made_smaller_along_its_long_axes_alone() {
    let mut g = Gaussians::new(3, 0).unwrap();
    // Distances to the nearest camera: 2, 4, 0.
    g.mean.copy_from_slice(&[0.0, 6.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    for (k, scale) in [3.0_f32, 0.9, 3.0, 0.3, 0.02, 0.001, 0.5, 0.1, 0.02].into_iter().enumerate() {
        g.log_scale[k] = scale.ln();
    }
    let before = g.clone();
    assert_eq!(LIMIT.keep(&mut g, &[[2.0, 0.0, 0.0], [100.0, 0.0, 0.0]]).unwrap(), 2);
    for (i, want) in [[0.5, 0.3, 0.5], [0.9, 0.02, 0.1], [0.01, 0.001, 0.01]].into_iter().enumerate() {
        for (got, want) in sizes(&g, i).into_iter().zip(want) {
            assert!((got - want).abs() < 1e-5 * want, "{i}: {:?}", sizes(&g, i));
        }
    }
    assert_eq!((&g.mean, &g.wxyz, &g.logit), (&before.mean, &before.wxyz, &before.logit));
    // What is within the limit is not touched again.
    let once = g.clone();
    assert_eq!((LIMIT.keep(&mut g, &[[2.0, 0.0, 0.0]]).unwrap(), &g), (0, &once));
}

#[test]
fn as_a_twin_in_64_bits_finds_them() {
    // More than one task.
    let (n, limit) = (3000, SizeLimit::DEFAULT);
    let (before, cameras) = (some(n, 0), [[0.1, -0.2, 0.3], [1.0, 2.0, -1.0], [-2.0, 0.0, 0.5]]);
    let mut g = before.clone();
    let count = limit.keep(&mut g, &cameras).unwrap();
    let mut want = 0;
    for i in 0..n {
        let at = |k: usize| f64::from(before.mean[k * n + i]);
        let far = |c: &[f32; 3]| (0..3).map(|k| (at(k) - f64::from(c[k])).powi(2)).sum::<f64>().sqrt();
        let most = (f64::from(limit.part) * cameras.iter().map(far).fold(f64::MAX, f64::min)).max(0.01);
        want += usize::from(sizes(&before, i).into_iter().any(|s| f64::from(s) > most));
        for (was, is) in sizes(&before, i).into_iter().zip(sizes(&g, i)) {
            assert!((f64::from(is) - f64::from(was).min(most)).abs() < 1e-5 * most, "{i}: {was} {is} {most}");
        }
    }
    assert!(count == want && (n / 10..n).contains(&count), "{count} {want}");
}

#[test]
fn nothing_is_too_large_without_cameras_and_what_is_not_finite_stays() {
    let mut g = some(3, 0);
    g.log_scale[0] = f32::NAN;
    g.log_scale[3] = f32::INFINITY;
    g.mean[1] = f32::NAN;
    g.log_scale[1] = 5.0;
    let bits = |g: &Gaussians| g.log_scale.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    let before = bits(&g);
    assert_eq!(LIMIT.keep(&mut g, &[]).unwrap(), 0);
    assert_eq!(bits(&g), before);
    LIMIT.keep(&mut g, &[[0.0; 3]]).unwrap();
    assert!(g.log_scale[0].is_nan() && g.log_scale[3].is_finite() && g.log_scale[1].to_bits() == 5.0_f32.to_bits());
    assert_eq!(LIMIT.keep(&mut some(0, 0), &[[0.0; 3]]).unwrap(), 0);
}

#[test]
fn settings_out_of_range_are_refused_by_name() {
    for (limit, name) in [
        (LIMIT.with_part(0.0), "part"),
        (LIMIT.with_part(f32::NAN), "part"),
        (LIMIT.with_least(-1.0), "least"),
        (LIMIT.with_least(f32::INFINITY), "least"),
    ] {
        let error = limit.keep(&mut some(2, 0), &[]).unwrap_err();
        assert!(matches!(error, SplatError::Value { what, .. } if what == name), "{error}");
    }
}
