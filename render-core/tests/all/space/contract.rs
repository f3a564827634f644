//! Contraction: bounded, invertible, with the right derivatives, at every vector level.

use float_core::Simd;
use proptest::prelude::*;
use render_core::contract::{
    Norm, contract, contract_backward, contract_batch, contract_batch_backward, contract_jacobian, inv_contract,
};
use render_core::error::RenderError;
use testkit::gradient::{PairTolerances, Tolerance, check_f32_pair, check_pair, cotangent};

pub(super) const NORMS: [Norm; 2] = [Norm::L2, Norm::Max];

/// The definition.
fn naive(norm: Norm, x: [f64; 3]) -> [f64; 3] {
    let m = norm_of(norm, x);
    if m <= 1.0 { x } else { x.map(|v| (2.0 - 1.0 / m) * v / m) }
}

pub(super) fn norm_of(norm: Norm, x: [f64; 3]) -> f64 {
    match norm {
        Norm::L2 => x.iter().map(|v| v * v).sum::<f64>().sqrt(),
        Norm::Max => x.iter().fold(0.0, |m, v| m.max(v.abs())),
    }
}

fn any_coordinate() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -3.0..3.0_f64,
        2 => (-3.0..6.0_f64, any::<bool>()).prop_map(|(e, s)| if s { 10f64.powf(e) } else { -(10f64.powf(e)) }),
        1 => prop_oneof![Just(0.0), Just(-0.0), Just(1.0), Just(-1.0), Just(1e-300), Just(0.5), Just(1.0 + 1e-15)],
    ]
}

fn any_x() -> impl Strategy<Value = [f64; 3]> {
    [any_coordinate(), any_coordinate(), any_coordinate()]
}

pub(super) fn any_norm() -> impl Strategy<Value = Norm> {
    prop_oneof![Just(Norm::L2), Just(Norm::Max)]
}

/// The two largest coordinates differ and the norm is not 1: there is a gradient to difference.
pub(super) fn smooth(norm: Norm, x: [f64; 3]) -> bool {
    let mut sorted = x.map(f64::abs);
    sorted.sort_by(f64::total_cmp);
    (norm_of(norm, x) - 1.0).abs() > 1e-4 && (norm == Norm::L2 || sorted[2] - sorted[1] > 1e-4 * sorted[2])
}

proptest! {
    #![proptest_config(testkit::property::cases(256))]

    #[test]
    fn contract_matches_naive_and_is_bounded(norm in any_norm(), x in any_x()) {
        let (got, want) = (contract(norm, x), naive(norm, x));
        for (g, w) in got.iter().zip(&want) {
            prop_assert!((g - w).abs() <= 4e-15, "{got:?} {want:?}");
        }
        prop_assert!(norm_of(norm, got) <= 2.0 + 4e-16);
        let single = contract(norm, x.map(|v| v as f32));
        for (g, w) in single.iter().zip(&want) {
            prop_assert!((f64::from(*g) - w).abs() <= 1e-6);
        }
    }

    #[test]
    fn inv_contract_inverts_contract(norm in any_norm(), x in any_x()) {
        let back = inv_contract(norm, contract(norm, x));
        // 2 - m keeps an error of 1e-16 where 1/m is left: relative m * 1e-16.
        let m = norm_of(norm, x);
        for (b, x) in back.iter().zip(&x) {
            prop_assert!((b - x).abs() <= 1e-15 * (1.0 + m) * m.max(1.0), "{back:?} {x:?}");
        }
    }

    #[test]
    fn contract_inverts_inv_contract(norm in any_norm(), x in [-2.0..2.0_f64, -2.0..2.0, -2.0..2.0]) {
        if norm_of(norm, x) >= 1.999 {
            return Ok(());
        }
        let back = contract(norm, inv_contract(norm, x));
        for (b, x) in back.iter().zip(&x) {
            prop_assert!((b - x).abs() <= 1e-12);
        }
    }

    #[test]
    fn contract_keeps_directions(norm in any_norm(), x in any_x()) {
        let y = contract(norm, x);
        let scale = norm_of(norm, y) / norm_of(norm, x).max(1e-300);
        for (y, x) in y.iter().zip(&x) {
            prop_assert!((y - scale * x).abs() <= 1e-14);
        }
    }

    #[test]
    fn contract_backward_matches_central_differences(norm in any_norm(), x in [-40.0..40.0_f64, -4.0..4.0, -1.0..1.0], seed in 0..1000_u64) {
        if !smooth(norm, x) {
            return Ok(());
        }
        let single = (
            |x: &[f32], y: &mut [f32]| y.copy_from_slice(&contract(norm, x.try_into().unwrap())),
            |x: &[f32], y_bar: &[f32], x_bar: &mut [f32]| {
                contract_backward(norm, x.try_into().unwrap(), y_bar.try_into().unwrap(), x_bar.try_into().unwrap());
            },
        );
        let twin = (
            |x: &[f64], y: &mut [f64]| y.copy_from_slice(&contract(norm, x.try_into().unwrap())),
            |x: &[f64], y_bar: &[f64], x_bar: &mut [f64]| {
                contract_backward(norm, x.try_into().unwrap(), y_bar.try_into().unwrap(), x_bar.try_into().unwrap());
            },
        );
        let x = x.map(|v| v as f32);
        let y_bar: Vec<f32> = cotangent(3, seed).into_iter().map(|v| v as f32).collect();
        let out = check_f32_pair(&x, &y_bar, single, twin, PairTolerances::default());
        prop_assert!(out.is_ok(), "{norm:?} {x:?}: {}", out.unwrap_err());
    }

    #[test]
    fn batches_are_loops_of_singles_at_every_level(norm in any_norm(), x in proptest::collection::vec(any_coordinate(), 0..210)) {
        let n = x.len() / 3;
        let x: Vec<f32> = x[..3 * n].iter().map(|&v| v as f32).collect();
        let y_bar: Vec<f32> = cotangent(3 * n, 7).into_iter().map(|v| v as f32).collect();
        for simd in Simd::available() {
            let (mut y, mut x_bar) = (vec![f32::NAN; 3 * n], vec![0.25; 3 * n]);
            contract_batch(simd, norm, &x, &mut y).unwrap();
            contract_batch_backward(simd, norm, &x, &y_bar, &mut x_bar).unwrap();
            for i in 0..n {
                let at = |v: &[f32]| [v[i], v[n + i], v[2 * n + i]];
                let want = contract(norm, at(&x));
                let mut want_bar = [0.25; 3];
                contract_backward(norm, at(&x), at(&y_bar), &mut want_bar);
                for a in 0..3 {
                    prop_assert!((at(&y)[a] - want[a]).abs() <= 5e-7, "{simd:?} {:?}", at(&x));
                    // On the unit sphere rounding decides which side a level takes: 1 on one, 1 - 1e-7 on the other.
                    prop_assert!((at(&x_bar)[a] - want_bar[a]).abs() <= 4e-6, "{simd:?} {:?}", at(&x));
                }
            }
        }
    }
}

#[test]
fn known_points() {
    assert_eq!(contract(Norm::L2, [0.0, 0.0, 4.0]), [0.0, 0.0, 1.75]);
    assert_eq!(contract(Norm::Max, [4.0, -4.0, 2.0]), [1.75, -1.75, 0.875]);
    assert_eq!(inv_contract(Norm::Max, [1.75, -1.75, 0.875_f32]), [4.0, -4.0, 2.0]);
    for norm in NORMS {
        assert_eq!(contract(norm, [0.0_f32; 3]), [0.0; 3]);
        assert_eq!(contract(norm, [1.0_f32, 0.0, 0.0]), [1.0, 0.0, 0.0]);
        assert_eq!(contract_jacobian(norm, [0.0_f64; 3]), [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    }
}

#[test]
fn extremes_stay_finite_and_inside() {
    let values = [0.0, -0.0, 1e-45, 1e-30, 1.0, 1.000_000_1, 1e18, 1e20, 1e38, f32::MAX, -f32::MAX];
    let n = values.len();
    let all: Vec<[f32; 3]> = (0..n * n * n).map(|i| [values[i % n], values[i / n % n], values[i / n / n]]).collect();
    for norm in NORMS {
        let flat: Vec<f32> = (0..3).flat_map(|a| all.iter().map(move |x| x[a])).collect();
        let (mut y, mut x_bar) = (vec![0.0; flat.len()], vec![0.0; flat.len()]);
        contract_batch(Simd::best(), norm, &flat, &mut y).unwrap();
        contract_batch_backward(Simd::best(), norm, &flat, &vec![1.0; flat.len()], &mut x_bar).unwrap();
        assert!(y.iter().all(|v| v.abs() <= 2.0) && x_bar.iter().all(|v| v.is_finite()));
        for &x in &all {
            let y = contract(norm, x);
            let m = norm_of(norm, y.map(f64::from));
            assert!(m <= 2.0 + 3e-7, "{x:?} -> {y:?}");
            let largest = x.iter().fold(0.0_f32, |m, v| m.max(v.abs()));
            assert!(largest < 1e18 || m > 1.999, "{x:?} -> {y:?}: far away is at the rim");
            assert!(inv_contract(norm, y).iter().all(|v| v.is_finite()));
            assert!(contract_jacobian(norm, x).as_flattened().iter().all(|v| v.is_finite()));
        }
    }
}

#[test]
fn nan_is_not_hidden() {
    for norm in NORMS {
        assert!(contract(norm, [f32::NAN, 5.0, 0.0]).iter().any(|v| v.is_nan()));
        for simd in Simd::available() {
            let (x, mut y) = ([f32::NAN, 5.0, 0.0], [0.0; 3]);
            contract_batch(simd, norm, &x, &mut y).unwrap();
            assert!(y.iter().any(|v| v.is_nan()), "{simd:?} {norm:?} {y:?}");
        }
    }
}

#[test]
fn lengths_are_checked_and_nothing_is_legal() {
    let simd = Simd::best();
    assert_eq!(contract_batch(simd, Norm::L2, &[], &mut []), Ok(()));
    let error = contract_batch(simd, Norm::L2, &[0.0; 6], &mut [0.0; 3]).unwrap_err();
    assert_eq!(error, RenderError::Shape { what: "y", want: 6, got: 3 });
    assert_eq!(error.to_string(), "`y` holds 3 values, expected 6");
    assert!(contract_batch(simd, Norm::L2, &[0.0; 4], &mut [0.0; 4]).is_err());
    assert!(contract_batch_backward(simd, Norm::L2, &[0.0; 3], &[0.0; 3], &mut [0.0; 6]).is_err());
}

#[test]
fn l2_is_smooth_across_the_unit_sphere() {
    let out = check_pair(
        &[0.6, 0.8, 0.0],
        &cotangent(3, 1),
        |x, y| y.copy_from_slice(&contract(Norm::L2, x.try_into().unwrap())),
        |x, y_bar, x_bar| {
            contract_backward(Norm::L2, x.try_into().unwrap(), y_bar.try_into().unwrap(), x_bar.try_into().unwrap());
        },
        Tolerance::new(0.0, 1e-5), // the second derivative jumps: differences are off by the step
    );
    out.unwrap();
}
