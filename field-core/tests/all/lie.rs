//! Exponential maps: properties and derivatives, from rest to a thousand radians.

use field_core::lie::{
    Matrix3, Rigid, se3_exp, se3_exp_backward, se3_exp_derivative, se3_log, so3_exp, so3_exp_backward,
    so3_exp_derivative, so3_left_jacobian, so3_log, wrap,
};
use proptest::prelude::*;
use std::f64::consts::PI;

const IDENTITY: Matrix3 = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
const STILL: Rigid = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

/// Angles where naive code breaks, and ordinary ones.
fn angle(most: f64) -> impl Strategy<Value = f64> {
    prop_oneof![
        Just(0.0),
        Just(1e-300),
        Just(1e-12),
        Just(1e-9),
        Just(1e-4),
        Just(PI - 1e-3),
        Just(PI - 1e-9),
        Just(PI),
        0.0..PI,
        0.0..most
    ]
    .prop_map(move |a: f64| a.min(most))
}

fn axis() -> impl Strategy<Value = [f64; 3]> {
    let unit = |v: [f64; 3]| {
        let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
        if length > 1e-3 { v.map(|x| x / length) } else { [0.0, 0.0, 1.0] }
    };
    prop_oneof![
        prop::array::uniform3(-1.0..1.0).prop_map(unit),
        prop::sample::select(vec![[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.6, -0.8]]),
    ]
}

fn rotation_vector(most: f64) -> impl Strategy<Value = [f64; 3]> {
    (angle(most), axis()).prop_map(|(a, n)| n.map(|x| a * x))
}

fn product(a: &Rigid, b: &Rigid) -> Rigid {
    std::array::from_fn(|i| {
        std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum::<f64>() + if j == 3 { a[i][3] } else { 0.0 })
    })
}

fn worst<const N: usize>(a: &[[f64; N]; 3], b: &[[f64; N]; 3]) -> f64 {
    a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn the_exponential_of_nothing_is_the_identity_to_the_bit() {
    assert_eq!(so3_exp([0.0; 3]), IDENTITY);
    assert_eq!(so3_exp([-0.0; 3]), IDENTITY);
    assert_eq!(se3_exp([0.0; 6]), STILL);
    assert_eq!(so3_log(&IDENTITY), [0.0; 3]);
    assert_eq!(se3_log(&STILL), [0.0; 6]);
}

#[test]
fn the_derivative_at_rest_is_the_cross_product() {
    let d = so3_exp_derivative([0.0; 3]);
    for [k, i, j] in [[0, 1, 2], [1, 2, 0], [2, 0, 1]] {
        assert_eq!((d[j][i][k], d[i][j][k], d[k][k][k]), (1.0, -1.0, 0.0));
    }
}

#[test]
fn the_logarithm_at_pi_finds_the_axis() {
    for n in [[1.0, 0.0, 0.0], [0.0, 0.6, -0.8], [1e-7, 1.0, 0.0], [0.577, -0.577, 0.578]] {
        let length = n.iter().map(|x: &f64| x * x).sum::<f64>().sqrt();
        let w = n.map(|x| x / length * PI);
        let got = so3_log(&so3_exp(w));
        let off = |s: f64| got.iter().zip(w).map(|(g, w)| (g - s * w).abs()).fold(0.0, f64::max);
        assert!(off(1.0).min(off(-1.0)) < 1e-14, "{w:?} came back as {got:?}");
    }
}

#[test]
fn derivatives_match_central_differences() {
    let u = [0.7, -1.9, 0.4];
    for angle in [0.0, 1e-12, 1e-6, 1e-3, 0.3, 1.0, 2.5, 3.1, PI, 3.2, 6.0, 40.0] {
        let xi = [0.48 * angle, -0.6 * angle, 0.64 * angle, u[0], u[1], u[2]];
        let d = se3_exp_derivative(xi);
        let (mut bar, mut want_bar) = ([0.5; 6], [0.5; 6]);
        let t_bar: Rigid = std::array::from_fn(|i| std::array::from_fn(|j| (i * 4 + j) as f64 * 0.3 - 1.0));
        se3_exp_backward(xi, &t_bar, &mut bar);
        for k in 0..6 {
            let h = 1e-5;
            let (mut above, mut below) = (xi, xi);
            above[k] += h;
            below[k] -= h;
            let (above, below) = (se3_exp(above), se3_exp(below));
            for i in 0..3 {
                for j in 0..4 {
                    let want = (above[i][j] - below[i][j]) / (2.0 * h);
                    assert!((d[i][j][k] - want).abs() < 1e-9, "angle {angle}: d[{i}][{j}][{k}] {} {want}", d[i][j][k]);
                    want_bar[k] += want * t_bar[i][j];
                }
            }
            assert!((bar[k] - want_bar[k]).abs() < 1e-8, "angle {angle}, {k}");
        }
        let w = [xi[0], xi[1], xi[2]];
        let dr = so3_exp_derivative(w);
        let mut w_bar = [0.25; 3];
        so3_exp_backward(w, &std::array::from_fn(|i| [t_bar[i][0], t_bar[i][1], t_bar[i][2]]), &mut w_bar);
        for k in 0..3 {
            let mut sum = 0.25;
            for i in 0..3 {
                for j in 0..3 {
                    assert_eq!(dr[i][j][k], d[i][j][k]);
                    sum += dr[i][j][k] * t_bar[i][j];
                }
            }
            assert!((w_bar[k] - sum).abs() < 1e-14);
        }
    }
}

#[test]
fn nothing_finite_out_of_nan() {
    assert!(so3_exp([f64::NAN, 0.0, 0.0]).iter().flatten().any(|x| x.is_nan()));
    assert!(se3_exp([0.0, 0.0, 0.0, f64::NAN, 0.0, 0.0]).iter().flatten().any(|x| x.is_nan()));
    assert!(so3_log(&[[f64::NAN; 3]; 3]).iter().any(|x| x.is_nan()));
    assert!(wrap([f64::INFINITY, 0.0, 0.0])[0].is_infinite());
}

proptest! {
    #![proptest_config(testkit::property::cases(400))]

    #[test]
    fn rotations_are_orthonormal_up_to_a_thousand_radians(w in rotation_vector(1e3)) {
        let r = so3_exp(w);
        for i in 0..3 {
            for j in 0..3 {
                let dot: f64 = (0..3).map(|k| r[k][i] * r[k][j]).sum();
                prop_assert!((dot - IDENTITY[i][j]).abs() < 1e-12, "{w:?}: {dot}");
            }
        }
        let [a, b, c] = r;
        let det = a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0]);
        prop_assert!((det - 1.0).abs() < 1e-12);
    }

    #[test]
    fn the_logarithm_inverts_the_exponential_below_pi(w in rotation_vector(PI - 1e-3), u in prop::array::uniform3(-5.0..5.0)) {
        let back = so3_log(&so3_exp(w));
        for (got, want) in back.iter().zip(w) {
            // Angles of 1e-300 lose nothing either: the error is relative to the largest angle of 1e-14.
            prop_assert!((got - want).abs() < 1e-14 * w.iter().fold(1.0, |m: f64, x| m.max(x.abs())), "{w:?}: {back:?}");
        }
        let xi = [w[0], w[1], w[2], u[0], u[1], u[2]];
        let back = se3_log(&se3_exp(xi));
        for (got, want) in back.iter().zip(xi) {
            prop_assert!((got - want).abs() < 1e-13, "{xi:?}: {back:?}");
        }
    }

    #[test]
    fn a_motion_and_its_reverse_cancel(w in rotation_vector(1e3), u in prop::array::uniform3(-5.0..5.0)) {
        let xi = [w[0], w[1], w[2], u[0], u[1], u[2]];
        let both = product(&se3_exp(xi), &se3_exp(xi.map(|x| -x)));
        prop_assert!(worst(&both, &STILL) < 1e-12, "{xi:?}: {both:?}");
    }

    #[test]
    fn wrapping_changes_the_vector_and_not_the_rotation(w in rotation_vector(60.0)) {
        let short = wrap(w);
        prop_assert!(short.iter().map(|x| x * x).sum::<f64>().sqrt() <= PI * (1.0 + 1e-14));
        prop_assert!(worst(&so3_exp(short), &so3_exp(w)) < 1e-13);
    }

    #[test]
    fn the_left_jacobian_turns_steps_into_rotations(w in rotation_vector(6.0), step in prop::array::uniform3(-1.0..1.0)) {
        let v = so3_left_jacobian(w);
        let h = 1e-6;
        let moved = so3_exp(std::array::from_fn(|i| w[i] + h * step[i]));
        let turn = so3_exp(v.map(|row| h * (0..3).map(|i| row[i] * step[i]).sum::<f64>()));
        let r = so3_exp(w);
        let want: Matrix3 = std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| turn[i][k] * r[k][j]).sum()));
        // Second order in h.
        prop_assert!(worst(&moved, &want) < 5e-12, "{w:?}");
    }
}
