//! Contracted covariances: gradients with respect to mean and covariance, in the unit ball, on its border and far away.

use super::contract::{NORMS, any_norm, norm_of, smooth};
use proptest::prelude::*;
use render_core::contract::{
    Norm, contract_covariance, contract_covariance_backward, contract_jacobian, contract_jacobian_backward,
};
use render_core::real::Real;
use testkit::gradient::{Mismatch, PairTolerances, Tolerance, check_f32_pair, check_pair, cotangent};

/// A matrix of nine numbers, rows first.
fn matrix<T: Real>(m: &[T]) -> [[T; 3]; 3] {
    [0, 3, 6].map(|at| [m[at], m[at + 1], m[at + 2]])
}

/// What is differenced: the mean, the covariance alone, or the mean of the Jacobian.
#[derive(Clone, Copy, Debug)]
enum By {
    Mean([f64; 9]),
    Covariance([f64; 3]),
    Jacobian,
}

fn forward<T: Real>(norm: Norm, by: By, x: &[T], out: &mut [T]) {
    let y = match by {
        By::Mean(cov) => contract_covariance(norm, x.try_into().unwrap(), &matrix(&cov.map(T::of))),
        By::Covariance(mean) => contract_covariance(norm, mean.map(T::of), &matrix(x)),
        By::Jacobian => contract_jacobian(norm, x.try_into().unwrap()),
    };
    out.copy_from_slice(y.as_flattened());
}

fn backward<T: Real>(norm: Norm, by: By, x: &[T], out_bar: &[T], x_bar: &mut [T]) {
    let (out_bar, mut unused, mut unused_cov) = (matrix(out_bar), [T::ZERO; 3], [[T::ZERO; 3]; 3]);
    match by {
        By::Mean(cov) => {
            let (x_bar, cov) = (x_bar.try_into().unwrap(), matrix(&cov.map(T::of)));
            contract_covariance_backward(norm, x.try_into().unwrap(), &cov, &out_bar, x_bar, &mut unused_cov);
        }
        By::Covariance(mean) => {
            let mut cov_bar = matrix(x_bar);
            contract_covariance_backward(norm, mean.map(T::of), &matrix(x), &out_bar, &mut unused, &mut cov_bar);
            x_bar.copy_from_slice(cov_bar.as_flattened());
        }
        By::Jacobian => {
            contract_jacobian_backward(norm, x.try_into().unwrap(), &out_bar, x_bar.try_into().unwrap());
        }
    }
}

fn check_both(norm: Norm, by: By, x: &[f64], seed: u64) -> Result<(), Mismatch> {
    let x: Vec<f32> = x.iter().map(|&v| v as f32).collect();
    let out_bar: Vec<f32> = cotangent(9, seed).into_iter().map(|v| v as f32).collect();
    let single = (
        |x: &[f32], out: &mut [f32]| forward(norm, by, x, out),
        |x: &[f32], out_bar: &[f32], x_bar: &mut [f32]| backward(norm, by, x, out_bar, x_bar),
    );
    let twin = (
        |x: &[f64], out: &mut [f64]| forward(norm, by, x, out),
        |x: &[f64], out_bar: &[f64], x_bar: &mut [f64]| backward(norm, by, x, out_bar, x_bar),
    );
    check_f32_pair(&x, &out_bar, single, twin, PairTolerances::default())
}

proptest! {
    #![proptest_config(testkit::property::cases(256))]

    #[test]
    fn gradients_match_central_differences(
        norm in any_norm(), scale in prop_oneof![Just(1.0), Just(0.2), Just(10.0)],
        x in [-4.0..4.0_f64, -2.0..2.0, -1.0..1.0], cov in prop::array::uniform9(-2.0..2.0_f64), seed in 0..1000_u64,
    ) {
        // Exact in both precisions, so that both are on the same side of the border.
        let (x, cov) = (x.map(|v| f64::from((scale * v) as f32)), cov.map(|v| f64::from(v as f32)));
        if !smooth(norm, x) {
            return Ok(());
        }
        for (by, at) in [(By::Mean(cov), &x[..]), (By::Jacobian, &x[..]), (By::Covariance(x), &cov[..])] {
            let out = check_both(norm, by, at, seed);
            prop_assert!(out.is_ok(), "{norm:?} {by:?} {at:?}: {}", out.unwrap_err());
        }
    }

    #[test]
    fn gradients_of_means_far_away_match_central_differences(
        norm in any_norm(), exponent in 1.0..8.0_f64, x in prop::array::uniform3(0.2..1.0_f64), signs in 0..8_u32,
        cov in prop::array::uniform9(-1.0..1.0_f64), seed in 0..1000_u64,
    ) {
        let far = 10f64.powf(exponent);
        let x = [0, 1, 2].map(|a| if signs >> a & 1 == 1 { -far * x[a] } else { far * x[a] });
        if !smooth(norm, x) {
            return Ok(());
        }
        // As wide as it is far away.
        let by = By::Mean(cov.map(|c| c * far * far));
        let out = check_pair(
            &x,
            &cotangent(9, seed),
            |x, out| forward(norm, by, x, out),
            |x, out_bar, x_bar| backward(norm, by, x, out_bar, x_bar),
            Tolerance::new(1e-6, 0.0),
        );
        prop_assert!(out.is_ok(), "{norm:?} {x:?}: {}", out.unwrap_err());
    }

    #[test]
    fn in_the_unit_ball_nothing_is_contracted(
        norm in any_norm(), x in prop::array::uniform3(-1.0..1.0_f64), cov in prop::array::uniform9(-2.0..2.0_f64), border: bool,
    ) {
        let m = norm_of(norm, x);
        // The border where it can be met exactly: along an axis.
        let x = if border { [0.0, x[1].signum(), 0.0] } else { x };
        if !border && m >= 1.0 {
            return Ok(());
        }
        let (out_bar, mut x_bar, mut cov_bar) = (matrix(&cotangent(9, 3)), [0.5; 3], [[0.0; 3]; 3]);
        contract_covariance_backward(norm, x, &matrix(&cov), &out_bar, &mut x_bar, &mut cov_bar);
        prop_assert_eq!((x_bar, cov_bar), ([0.5; 3], out_bar));
        contract_jacobian_backward(norm, x, &out_bar, &mut x_bar);
        prop_assert_eq!(x_bar, [0.5; 3]);
    }

    #[test]
    fn a_point_has_a_gradient_of_its_covariance_only(norm in any_norm(), x in prop::array::uniform3(-40.0..40.0_f64)) {
        let (out_bar, mut x_bar, mut cov_bar) = (matrix(&cotangent(9, 4)), [0.0; 3], [[0.0; 3]; 3]);
        contract_covariance_backward(norm, x, &[[0.0; 3]; 3], &out_bar, &mut x_bar, &mut cov_bar);
        prop_assert_eq!(x_bar, [0.0; 3]);
        let j = contract_jacobian(norm, x);
        for k in 0..3 {
            for l in 0..3 {
                let want: f64 = (0..9).map(|e| j[e / 3][k] * out_bar[e / 3][e % 3] * j[e % 3][l]).sum();
                prop_assert!((cov_bar[k][l] - want).abs() < 1e-13);
            }
        }
    }
}

#[test]
fn second_derivatives_jump_on_the_border() {
    let unit = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    // The trace of the Jacobian: 3 inside; just outside 3 - 2 (m - 1), for either norm.
    for norm in NORMS {
        for (x, want) in [(1.0, 0.0), (1.0 + 1e-12, -2.0)] {
            let mut x_bar = [0.0; 3];
            contract_jacobian_backward(norm, [0.0, 0.0, x], &unit, &mut x_bar);
            assert!((x_bar[2] - want).abs() < 1e-10, "{norm:?} {x_bar:?}");
            assert_eq!(x_bar[..2], [0.0; 2]);
        }
    }
}

#[test]
fn extremes_are_finite() {
    let values = [0.0, -0.0, 1e-45, 1e-30, 1.0, 1.000_000_1, 1e18, 1e20, 1e38, f32::MAX, -f32::MAX];
    let n = values.len();
    for norm in NORMS {
        for i in 0..n * n * n {
            let x = [values[i % n], values[i / n % n], values[i / n / n]];
            for cov in [0.0_f32, 1e-30, 1.0] {
                let (mut x_bar, mut cov_bar) = ([0.0; 3], [[0.0; 3]; 3]);
                contract_covariance_backward(norm, x, &[[cov; 3]; 3], &[[1.0; 3]; 3], &mut x_bar, &mut cov_bar);
                assert!(x_bar.iter().chain(cov_bar.as_flattened()).all(|v| v.is_finite()), "{norm:?} {x:?} {cov}");
            }
        }
    }
}
