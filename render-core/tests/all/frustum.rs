//! Frustum Gaussians: against the textbook form in `f64`, Monte-Carlo moments, golden properties.

use proptest::prelude::*;
use render_core::frustum::{Frustum, Moments, symmetric, symmetric_backward};
use render_core::real::Real;
use testkit::gradient::{PairTolerances, check_f32_pair, cotangent};

/// Mean and variances from the moments of `t^2` between two distances. The differences of powers are written as products
/// with `t1 - t0`, which cancels between them: in `f64` they would lose `(t / (t1 - t0))^2` of their digits.
fn textbook(t0: f64, t1: f64, r: f64) -> Moments<f64> {
    let difference = |n: i32| (0..n).map(|k| t0.powi(k) * t1.powi(n - 1 - k)).sum::<f64>();
    let (d3, d4, d5) = (difference(3), difference(4), difference(5));
    let mean_t = 0.75 * d4 / d3;
    Moments { mean_t, var_t: 0.6 * d5 / d3 - mean_t * mean_t, var_r: r * r * 0.15 * d5 / d3 }
}

fn close(what: &str, got: f64, want: f64, relative: f64) {
    assert!((got - want).abs() <= relative * want.abs(), "{what}: {got} is not {want}");
}

#[test]
fn the_stable_form_is_the_textbook_form() {
    for mu in [1e-3, 0.5, 1.0, 4.0, 1e3] {
        for ratio in [1e-4, 1e-3, 1e-2, 0.1, 0.3, 0.7, 0.999, 1.0] {
            let (t0, t1, r) = (mu * (1.0 - ratio), mu * (1.0 + ratio), 0.03);
            let want = Moments::conical(t0, t1, r);
            // The variance is still the difference of two squares of the distance.
            let book = textbook(t0, t1, r);
            close("mean_t", want.mean_t, book.mean_t, 1e-12);
            close("var_t", want.var_t, book.var_t, 1e-9 + 4e-15 / (ratio * ratio)); // 4e-7 at the thinnest
            close("var_r", want.var_r, book.var_r, 1e-9);
            let (t0, t1) = (t0 as f32, t1 as f32);
            let want = Moments::conical(f64::from(t0), f64::from(t1), f64::from(r as f32));
            let got = Moments::conical(t0, t1, r as f32);
            close("f32 mean_t", got.mean_t.into(), want.mean_t, 1e-6);
            close("f32 var_t", got.var_t.into(), want.var_t, 2e-6);
            close("f32 var_r", got.var_r.into(), want.var_r, 2e-6);
        }
    }
}

/// A stream of numbers in `[0, 1)`.
fn uniform(seed: &mut u64) -> f64 {
    // SplitMix64.
    *seed = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (*seed ^ (*seed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

/// Mean of samples, and its standard error.
fn mean(samples: &[f64]) -> (f64, f64) {
    let n = samples.len() as f64;
    let mean = samples.iter().sum::<f64>() / n;
    let var = samples.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, (var / n).sqrt())
}

#[test]
fn moments_are_those_of_points_in_a_frustum() {
    let (t0, t1, r) = (1.0_f64, 1.5_f64, 0.1);
    let m = Moments::conical(t0, t1, r);
    close("mean_t", m.mean_t, 1.28289, 1e-5);
    close("var_t", m.var_t, 0.019971, 3e-5);
    close("var_r", m.var_r, 0.0041645, 1e-5);
    let (mut t, mut x, seed) = (Vec::new(), Vec::new(), &mut 3);
    for _ in 0..400_000 {
        // Uniform in volume: t^3 is uniform, and so is the square of the distance to the axis.
        let at = (t0.powi(3) + uniform(seed) * (t1.powi(3) - t0.powi(3))).cbrt();
        let (rho, phi) = (r * at * uniform(seed).sqrt(), std::f64::consts::TAU * uniform(seed));
        t.push(at);
        x.push(rho * phi.cos());
    }
    let (mean_t, error) = mean(&t);
    assert!((mean_t - m.mean_t).abs() < 3.0 * error, "{mean_t} +- {error}");
    let squares: Vec<f64> = t.iter().map(|t| (t - m.mean_t).powi(2)).collect();
    let (var_t, error) = mean(&squares);
    assert!((var_t - m.var_t).abs() < 3.0 * error, "{var_t} +- {error}");
    let squares: Vec<f64> = x.iter().map(|x| x * x).collect();
    let (var_r, error) = mean(&squares);
    assert!((var_r - m.var_r).abs() < 3.0 * error, "{var_r} +- {error}");
}

#[test]
fn a_cylinder_has_the_moments_of_a_cylinder() {
    let m = Moments::new(Frustum::Cylinder, 2.0, 3.0, 0.2);
    assert_eq!((m.mean_t, m.var_r), (2.5, 0.010000000000000002));
    close("var_t", m.var_t, 1.0 / 12.0, 1e-15);
    // A thin slice of a cone is nearly one of a cylinder of its radius there.
    let (cone, cylinder) =
        (Moments::conical(2.0, 2.001, 0.1), Moments::new(Frustum::Cylinder, 2.0, 2.001, 0.1 * 2.0005_f64));
    close("mean_t", cone.mean_t, cylinder.mean_t, 1e-6);
    close("var_t", cone.var_t, cylinder.var_t, 1e-6);
    close("var_r", cone.var_r, cylinder.var_r, 1e-6);
}

#[test]
fn extreme_frusta_are_finite() {
    let zero = Moments::conical(0.0_f32, 0.0, 0.01);
    assert_eq!((zero.mean_t, zero.var_t, zero.var_r), (0.0, 0.0, 0.0));
    for (t0, t1, r) in [
        (0.0_f32, 1e-40, 0.01),
        (1e-40, 1e-40, 0.0),
        (0.0, 1e18, 1e-3),
        (1e18, 1.0001e18, 1.0),
        (5.0, 5.0, 0.0),
        (1e-20, 1e18, 0.5),
    ] {
        let m = Moments::conical(t0, t1, r);
        let (mean, var) = m.diagonal([0.0; 3], [0.6, 0.0, 0.8]);
        for x in [m.mean_t, m.var_t, m.var_r].into_iter().chain(mean).chain(var) {
            assert!(x.is_finite() && x >= 0.0, "{t0} {t1} {r}: {m:?}");
        }
        assert!(t0 <= m.mean_t && m.mean_t <= t1 * 1.000_001, "{t0} {t1}: {m:?}");
    }
    // Lengths beyond the range of their squares overflow to infinity, never to NaN.
    let m = Moments::conical(0.0_f32, 1e30, 1.0);
    assert!(m.mean_t.is_finite() && m.var_t == f32::INFINITY && m.var_r == f32::INFINITY);
    // No direction: a ball around the origin.
    let (mean, var) = Moments::conical(1.0, 2.0, 0.1).diagonal([1.0, 2.0, 3.0], [0.0; 3]);
    assert!(mean == [1.0, 2.0, 3.0] && var[0] == var[2] && var[0] > 0.0);
}

/// Mean and covariance, nine numbers, of a ray, six.
fn gaussian<T: Real>(m: &Moments<T>, ray: &[T], out: &mut [T]) {
    let (mean, cov) = m.covariance(ray[..3].try_into().unwrap(), ray[3..].try_into().unwrap());
    out[..3].copy_from_slice(&mean);
    out[3..].copy_from_slice(&cov);
}

fn gaussian_backward<T: Real>(m: &Moments<T>, ray: &[T], out_bar: &[T], ray_bar: &mut [T]) {
    let (o_bar, d_bar) = ray_bar.split_at_mut(3);
    let (mean_bar, cov_bar) = (out_bar[..3].try_into().unwrap(), out_bar[3..].try_into().unwrap());
    let d = ray[3..].try_into().unwrap();
    m.covariance_backward(d, mean_bar, cov_bar, o_bar.try_into().unwrap(), d_bar.try_into().unwrap());
}

#[test]
fn without_a_direction_only_the_mean_has_a_gradient() {
    let (m, mut ray_bar) = (Moments::conical(1.0_f64, 2.0, 0.1), [0.0; 6]);
    gaussian_backward(&m, &[0.0; 6], &[1.0; 9], &mut ray_bar);
    assert_eq!(ray_bar, [1.0, 1.0, 1.0, m.mean_t, m.mean_t, m.mean_t]);
}

#[test]
fn gradients_of_triangles_are_those_of_their_matrices() {
    let (m_bar, mut got) = ([[1.0, 2.0, 4.0], [8.0, 16.0, 32.0], [64.0, 128.0, 256.0]], [0.5; 6]);
    symmetric_backward(&m_bar, &mut got);
    assert_eq!(got, [1.5, 10.5, 68.5, 16.5, 160.5, 256.5]);
}

proptest! {
    #![proptest_config(testkit::property::cases(256))]

    #[test]
    fn covariance_backward_matches_central_differences(
        (t0, length, r) in (
            0.0_f64..10.0,
            prop_oneof![2 => 0.0_f64..5.0, 1 => Just(0.0)],
            prop_oneof![2 => 0.0_f64..0.5, 1 => Just(0.0)],
        ),
        o in prop::array::uniform3(-2.0_f64..2.0),
        d in prop_oneof![3 => prop::array::uniform3(-2.0_f64..2.0), 1 => Just([0.0, 0.0, -1.0])], seed in 0..1000_u64,
    ) {
        if d.iter().map(|d| d * d).sum::<f64>() < 0.05 {
            return Ok(());
        }
        for shape in [Frustum::Cone, Frustum::Cylinder] {
            let m = Moments::new(shape, t0 as f32, (t0 + length) as f32, r as f32);
            let wide = Moments { mean_t: m.mean_t.into(), var_t: m.var_t.into(), var_r: m.var_r.into() };
            let ray: Vec<f32> = o.iter().chain(&d).map(|&v| v as f32).collect();
            let out_bar: Vec<f32> = cotangent(9, seed).into_iter().map(|v| v as f32).collect();
            let single = (
                |ray: &[f32], out: &mut [f32]| gaussian(&m, ray, out),
                |ray: &[f32], out_bar: &[f32], bar: &mut [f32]| gaussian_backward(&m, ray, out_bar, bar),
            );
            let twin = (
                |ray: &[f64], out: &mut [f64]| gaussian(&wide, ray, out),
                |ray: &[f64], out_bar: &[f64], bar: &mut [f64]| gaussian_backward(&wide, ray, out_bar, bar),
            );
            let out = check_f32_pair(&ray, &out_bar, single, twin, PairTolerances::default());
            prop_assert!(out.is_ok(), "{shape:?} {ray:?}: {}", out.unwrap_err());
        }
    }

    #[test]
    fn covariances_are_symmetric_and_positive(
        (t0, length, r) in (0.0_f64..10.0, 0.0_f64..5.0, 0.0_f64..0.5),
        d in prop::array::uniform3(-2.0_f64..2.0), x in prop::array::uniform3(-1.0_f64..1.0),
    ) {
        for shape in [Frustum::Cone, Frustum::Cylinder] {
            let m = Moments::new(shape, t0, t0 + length, r);
            let (mean, upper) = m.covariance([0.1, 0.2, 0.3], d);
            let c = symmetric(upper);
            let mut form = 0.0;
            for a in 0..3 {
                for b in 0..3 {
                    prop_assert_eq!(c[a][b], c[b][a]);
                    form += x[a] * c[a][b] * x[b];
                }
            }
            let trace = c[0][0] + c[1][1] + c[2][2];
            prop_assert!(form >= -1e-12 * trace, "{form}");
            let (same, diagonal) = m.diagonal([0.1, 0.2, 0.3], d);
            prop_assert_eq!(mean, same);
            prop_assert_eq!(diagonal, [c[0][0], c[1][1], c[2][2]]);
            // The trace grows with the radius and with the length.
            let trace_of = |m: Moments<f64>| { let c = m.diagonal([0.0; 3], d).1; c[0] + c[1] + c[2] };
            let slack = 1.0 - 1e-12;
            prop_assert!(trace_of(Moments::new(shape, t0, t0 + length, r + 0.1)) >= trace * slack);
            prop_assert!(trace_of(Moments::new(shape, t0, t0 + length + 0.1, r)) >= trace * slack);
        }
    }

    #[test]
    fn scaling_the_scene_scales_the_moments(t0 in 0.0_f32..4.0, length in 0.0_f32..2.0, r in 0.0_f32..0.1, k in -12_i32..13) {
        // By powers of two, exactly; the radius is an angle and stays.
        let s = 2.0_f32.powi(k);
        let (a, b) = (Moments::conical(t0, t0 + length, r), Moments::conical(s * t0, s * (t0 + length), r));
        prop_assert_eq!(b.mean_t, s * a.mean_t);
        prop_assert!((b.var_t - s * s * a.var_t).abs() <= 1e-30 && (b.var_r - s * s * a.var_r).abs() <= 1e-30);
    }
}
