//! Kernels against their definitions in `f64`, and those against central differences.

use losses::{
    LossError,
    kernel::{Kernel, NGP_DELTA, NGP_DIVISOR, charbonnier_derivative, huber, huber_ngp, l1_derivative, squared},
};
use proptest::prelude::*;

/// The definitions, one line each.
mod naive {
    use losses::kernel::Kernel;

    pub(crate) fn value(kernel: Kernel, p: f64, t: f64) -> f64 {
        let x = p - t;
        let huber = |x: f64, d: f64| if x.abs() <= d { x * x / 2.0 } else { d * (x.abs() - d / 2.0) };
        match kernel {
            Kernel::Squared => x * x,
            Kernel::L1 => x.abs(),
            Kernel::Charbonnier { c } => (x * x + f64::from(c) * f64::from(c)).sqrt(),
            Kernel::Huber { delta } => huber(x, f64::from(delta)),
            Kernel::HuberNgp => huber(x, f64::from(0.1_f32)) / f64::from(0.1_f32) / 5.0,
            Kernel::LogSquared { eps } => {
                let tone = |x: f64| (x.max(0.0) + f64::from(eps)).ln();
                (tone(p) - tone(t)).powi(2)
            }
            other => panic!("no definition of {other:?}"),
        }
    }

    pub(crate) fn derivative(kernel: Kernel, p: f64, t: f64) -> f64 {
        let x = p - t;
        let sign = if x == 0.0 { 0.0 } else { x.signum() };
        let huber = |x: f64, d: f64| if x.abs() <= d { x } else { d * sign };
        match kernel {
            Kernel::Squared => 2.0 * x,
            Kernel::L1 => sign,
            Kernel::Charbonnier { .. } => x / value(kernel, p, t).max(1e-300),
            Kernel::Huber { delta } => huber(x, f64::from(delta)),
            Kernel::HuberNgp => huber(x, f64::from(0.1_f32)) / f64::from(0.1_f32) / 5.0,
            Kernel::LogSquared { .. } if p < 0.0 => 0.0,
            Kernel::LogSquared { eps } => {
                2.0 * ((p + f64::from(eps)).ln() - (t.max(0.0) + f64::from(eps)).ln()) / (p + f64::from(eps))
            }
            other => panic!("no definition of {other:?}"),
        }
    }
}

const KERNELS: [Kernel; 9] = [
    Kernel::Squared,
    Kernel::L1,
    Kernel::CHARBONNIER_360,
    Kernel::Charbonnier { c: 0.5 },
    Kernel::Charbonnier { c: 0.0 },
    Kernel::Huber { delta: 0.1 },
    Kernel::Huber { delta: 1.0 },
    Kernel::HuberNgp,
    Kernel::LogSquared { eps: 1e-3 },
];

/// Distance in `p` to where a kernel has no second derivative.
fn to_kink(kernel: Kernel, p: f64, t: f64) -> f64 {
    let x = (p - t).abs();
    match kernel {
        Kernel::L1 | Kernel::Charbonnier { c: 0.0 } => x,
        Kernel::Huber { delta } => (x - f64::from(delta)).abs(),
        Kernel::HuberNgp => (x - 0.1).abs(),
        Kernel::LogSquared { .. } => p.abs(),
        _ => f64::INFINITY,
    }
}

/// Colours: ordinary, nearly equal to one another, tiny, and outside `[0, 1]`.
fn any_pair() -> impl Strategy<Value = (f32, f32)> {
    let ordinary = -0.2_f32..1.5;
    prop_oneof![
        (ordinary.clone(), ordinary.clone()),
        (ordinary.clone(), -1e-4_f32..1e-4).prop_map(|(t, x)| (t + x, t)),
        (ordinary, -3_i32..4).prop_map(|(t, ulps)| (f32::from_bits(t.to_bits().wrapping_add_signed(ulps)), t)),
        (-1e-6_f32..1e-6, 0.0_f32..1e-6),
    ]
}

proptest! {
    #![proptest_config(testkit::property::cases(128))]

    #[test]
    fn naive_derivative_matches_central_difference((p, t) in any_pair()) {
        let (p, t) = (f64::from(p), f64::from(t));
        for kernel in KERNELS {
            let h = 1e-7;
            // How large the third derivative gets: the Charbonnier tip is as sharp as its c, the logarithm as its eps.
            let third = match kernel {
                Kernel::Charbonnier { c } => f64::from(c).max(1e-9).powi(-2),
                Kernel::LogSquared { eps } => 20.0 * f64::from(eps).powi(-3),
                _ => 0.0,
            };
            if kernel == (Kernel::Charbonnier { c: 0.0 }) || to_kink(kernel, p, t) <= 2.0 * h {
                continue;
            }
            let difference = (naive::value(kernel, p + h, t) - naive::value(kernel, p - h, t)) / (2.0 * h);
            let got = naive::derivative(kernel, p, t);
            // Rounding of the values over h, and the next term of the series.
            let bound = 1e-15 * (1.0 + naive::value(kernel, p, t)) / h + h * h / 6.0 * third + 1e-7 * got.abs();
            prop_assert!((got - difference).abs() <= bound, "{kernel:?} at {p}, {t}: {got} and {difference}, {bound}");
        }
    }

    #[test]
    fn kernels_match_naive((p, t) in any_pair()) {
        for kernel in KERNELS {
            // One rounding of p - t, a few more after it; the logarithm is steep by 1 / eps where it is dark.
            let (want, got) = (naive::value(kernel, p.into(), t.into()), f64::from(kernel.value(p, t)));
            prop_assert!((got - want).abs() <= 1e-12 + 2e-5 * want.abs(), "{kernel:?} at {p}, {t}: {got}, {want}");
            let (want, got) = (naive::derivative(kernel, p.into(), t.into()), f64::from(kernel.derivative(p, t)));
            if to_kink(kernel, p.into(), t.into()) > 1e-7 {
                prop_assert!((got - want).abs() <= 1e-7 + 1e-4 * want.abs(), "{kernel:?}' at {p}, {t}: {got}, {want}");
            }
        }
    }

    #[test]
    fn kernels_grow_with_the_error_and_push_back(t in 0.0_f32..1.0, near in 0.0_f32..0.5, more in 0.0_f32..0.5) {
        for kernel in KERNELS {
            let (close, far) = (kernel.value(t + near, t), kernel.value(t + near + more, t));
            prop_assert!(0.0 <= close && close <= far * (1.0 + 1e-5), "{kernel:?}: {close} then {far}");
            prop_assert!(kernel.derivative(t + near, t) >= 0.0);
            prop_assert!(kernel.derivative(t - near, t) <= 0.0);
        }
    }

    #[test]
    fn huber_is_within_its_neighbours(x in -2.0_f32..2.0, delta in 1e-3_f32..1.0) {
        let h = huber(x, delta);
        prop_assert!(h <= 0.5 * squared(x) * (1.0 + 1e-6));
        prop_assert!(h <= delta * x.abs() * (1.0 + 1e-6));
        prop_assert!(h >= delta * (x.abs() - 0.5 * delta) - 1e-6);
    }
}

#[test]
fn derivative_is_zero_at_the_target() {
    for kernel in KERNELS {
        for t in [0.0, 1e-30, 0.3, 1.0] {
            assert_eq!(kernel.derivative(t, t), 0.0, "{kernel:?} at {t}");
        }
    }
}

#[test]
fn kernels_are_finite_for_extreme_errors_and_keep_nan() {
    for kernel in KERNELS {
        for x in [0.0, -0.0, 1e-45, 1e-30, -1e-10, 1e10, -1e15, 1e18] {
            for t in [0.0, 1.0, 1e15] {
                let (value, derivative) = (kernel.value(x, t), kernel.derivative(x, t));
                assert!(value.is_finite() && value >= 0.0, "{kernel:?} at {x}, {t}: {value}");
                assert!(derivative.is_finite(), "{kernel:?}' at {x}, {t}: {derivative}");
            }
        }
        assert!(kernel.value(f32::NAN, 0.5).is_nan(), "{kernel:?} hides a NaN prediction");
        assert!(kernel.value(0.5, f32::NAN).is_nan(), "{kernel:?} hides a NaN target");
        assert!(kernel.derivative(f32::NAN, 0.5).is_nan(), "{kernel:?}' hides a NaN prediction");
        assert!(kernel.derivative(0.5, f32::NAN).is_nan(), "{kernel:?}' hides a NaN target");
    }
    for kernel in [Kernel::L1, Kernel::CHARBONNIER_360, Kernel::Huber { delta: 0.1 }, Kernel::HuberNgp] {
        assert!(kernel.value(f32::MAX, 0.0).is_finite(), "{kernel:?}");
        assert!(kernel.derivative(-f32::MAX, 0.0) < 0.0, "{kernel:?}");
    }
    assert_eq!(charbonnier_derivative(f32::NEG_INFINITY, 1e-3), -1.0);
    assert_eq!(l1_derivative(f32::INFINITY), 1.0);
}

#[test]
fn ngp_huber_is_the_squared_error_near_zero() {
    for x in [0.0_f32, 1e-6, 0.01, -0.05, 0.0999] {
        assert!((huber_ngp(x) - squared(x)).abs() <= 1e-6 * squared(x), "{x}");
    }
    let slope = (huber_ngp(0.7) - huber_ngp(0.5)) / 0.2;
    assert!((slope - 1.0 / NGP_DIVISOR).abs() < 1e-6);
    assert!((huber_ngp(0.5) - (0.5 - NGP_DELTA / 2.0) / NGP_DIVISOR).abs() < 1e-7);
}

#[test]
fn log_squared_sees_ratios() {
    let kernel = Kernel::LogSquared { eps: 1e-6 };
    let (bright, dark) = (kernel.value(200.0, 100.0), kernel.value(0.2, 0.1));
    assert!((bright - dark).abs() < 1e-4 && (bright - 2.0_f32.ln().powi(2)).abs() < 1e-6);
    assert_eq!(kernel.value(-1.0, 0.0), 0.0);
    assert_eq!(kernel.derivative(-1.0, 1.0), 0.0);
}

#[test]
fn unusable_parameters_are_named() {
    for bad in [
        Kernel::Charbonnier { c: -1.0 },
        Kernel::Charbonnier { c: f32::NAN },
        Kernel::Huber { delta: 0.0 },
        Kernel::Huber { delta: f32::INFINITY },
        Kernel::LogSquared { eps: 0.0 },
    ] {
        let error = bad.check().unwrap_err();
        assert!(matches!(error, LossError::Parameter { .. }), "{error}");
    }
    let error = Kernel::Huber { delta: -0.5 }.check().unwrap_err();
    assert_eq!(error.to_string(), "`delta` of the Huber kernel is -0.5, expected a finite number above 0");
    for good in KERNELS {
        good.check().unwrap();
    }
}
