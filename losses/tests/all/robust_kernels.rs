//! Kernels that forget outliers, and the weights of all kernels: definitions, limits, order, extremes.

use losses::LossError;
use losses::kernel::{
    Kernel, L1_WEIGHT_FLOOR, cauchy, cauchy_weight, charbonnier, geman_mcclure, geman_mcclure_weight, general,
    general_derivative, general_weight, trimmed, tukey, welsch, welsch_weight,
};
use proptest::prelude::*;
use testkit::gradient::{PairTolerances, check_f32_pair, cotangent};

/// The definitions in `f64`, one line each.
mod naive {
    use losses::kernel::Kernel;

    pub(crate) fn value(kernel: Kernel, x: f64) -> f64 {
        let z = |c: f32| (x / f64::from(c)).powi(2);
        match kernel {
            Kernel::General { shape: 2.0, c } => z(c) / 2.0,
            Kernel::General { shape: 0.0, c } | Kernel::Cauchy { c } => (z(c) / 2.0).ln_1p(),
            Kernel::General { shape: f32::NEG_INFINITY, c } | Kernel::Welsch { c } => 1.0 - (-z(c) / 2.0).exp(),
            Kernel::General { shape, c } => {
                let (a, b) = (f64::from(shape), (f64::from(shape) - 2.0).abs());
                b / a * ((z(c) / b + 1.0).powf(a / 2.0) - 1.0)
            }
            Kernel::GemanMcClure { c } => 2.0 * z(c) / (z(c) + 4.0),
            Kernel::Tukey { c } => (1.0 - (1.0 - z(c).min(1.0)).powi(3)) / 6.0,
            Kernel::Trimmed { c } => z(c).min(1.0) / 2.0,
            other => panic!("no definition of {other:?}"),
        }
    }

    pub(crate) fn weight(kernel: Kernel, x: f64) -> f64 {
        let z = |c: f32| (x / f64::from(c)).powi(2);
        let per = |c: f32| f64::from(c).powi(-2);
        match kernel {
            Kernel::General { shape: 2.0, c } => per(c),
            Kernel::General { shape: f32::NEG_INFINITY, c } | Kernel::Welsch { c } => per(c) * (-z(c) / 2.0).exp(),
            Kernel::General { shape, c } => {
                let a = f64::from(shape);
                per(c) * (z(c) / (a - 2.0).abs() + 1.0).powf(a / 2.0 - 1.0)
            }
            Kernel::Cauchy { c } => 2.0 / (x * x + 2.0 / per(c)),
            Kernel::GemanMcClure { c } => per(c) * 16.0 / (z(c) + 4.0).powi(2),
            Kernel::Tukey { c } => per(c) * (1.0 - z(c).min(1.0)).powi(2),
            Kernel::Trimmed { c } => {
                if z(c) <= 1.0 {
                    per(c)
                } else {
                    0.0
                }
            }
            other => panic!("no definition of {other:?}"),
        }
    }
}

/// All that weigh `1 / c^2` at 0, with this `c`.
fn robust(c: f32) -> [Kernel; 15] {
    let general = |shape| Kernel::General { shape, c };
    [
        general(2.0),
        general(1.5),
        general(1.0),
        general(0.5),
        general(0.0),
        general(-0.3),
        general(-2.0),
        general(-30.0),
        general(-1e5),
        general(f32::NEG_INFINITY),
        Kernel::Cauchy { c },
        Kernel::GemanMcClure { c },
        Kernel::Welsch { c },
        Kernel::Tukey { c },
        Kernel::Trimmed { c },
    ]
}

/// The kernels with another scale.
const PLAIN: [Kernel; 7] = [
    Kernel::Squared,
    Kernel::L1,
    Kernel::CHARBONNIER_360,
    Kernel::Charbonnier { c: 0.0 },
    Kernel::Huber { delta: 0.1 },
    Kernel::HuberNgp,
    Kernel::LogSquared { eps: 1e-3 },
];

proptest! {
    #![proptest_config(testkit::property::cases(96))]

    #[test]
    fn robust_kernels_match_definition_and_differences(
        x in prop_oneof![-2.0_f32..2.0, -1e-3_f32..1e-3, Just(0.0)],
        c in 0.02_f32..2.0,
        seed in 0_u64..1000,
    ) {
        for kernel in robust(c) {
            // The definition itself loses digits there; `shape_has_no_seams` looks at it.
            if kernel == (Kernel::General { shape: -1e5, c }) {
                continue;
            }
            // The corner of the trimmed parabola has no derivative.
            if kernel == (Kernel::Trimmed { c }) && (x.abs() - c).abs() < 1e-4 {
                continue;
            }
            let out_bar = [cotangent(1, seed)[0] as f32];
            let tolerances = PairTolerances {
                // Central differences with h = 1e-6: values of 1e4 (x far beyond c) leave 1e-16 * 1e4 / 1e-6.
                twin: testkit::gradient::Tolerance::new(1e-6, 2e-6),
                ..PairTolerances::default()
            };
            let checked = check_f32_pair(
                &[x],
                &out_bar,
                (
                    |x, out| out[0] = kernel.value(x[0], 0.0),
                    |x, bar, x_bar| x_bar[0] += bar[0] * kernel.derivative(x[0], 0.0),
                ),
                (
                    |x, out| out[0] = naive::value(kernel, x[0]),
                    |x, bar, x_bar| x_bar[0] += bar[0] * x[0] * naive::weight(kernel, x[0]),
                ),
                tolerances,
            );
            prop_assert!(checked.is_ok(), "{kernel:?} at {x}: {}", checked.unwrap_err());
            let (got, want) = (f64::from(kernel.weight(x, 0.0)), naive::weight(kernel, f64::from(x)));
            prop_assert!((got - want).abs() <= 1e-6 * want + 1e-37, "{kernel:?} weighs {got} at {x}, {want}");
        }
    }

    #[test]
    fn weight_is_slope_over_error(p in 0.0_f32..1.0, t in 0.0_f32..1.0, c in 0.01_f32..1.0) {
        prop_assume!((p - t).abs() > 1e-5);
        for kernel in PLAIN.into_iter().chain(robust(c)) {
            let (weight, slope) = (f64::from(kernel.weight(p, t)), f64::from(kernel.derivative(p, t)));
            let error = f64::from(p - t);
            prop_assert!((weight * error - slope).abs() <= 2e-5 * slope.abs() + 1e-30, "{kernel:?}: {weight}, {slope}");
            prop_assert!(weight >= 0.0);
        }
    }

    #[test]
    fn cost_grows_and_weight_falls_with_the_error(near in 0.0_f32..2.0, more in 0.0_f32..2.0, c in 0.01_f32..2.0) {
        // The log-squared kernel is not one of the error alone.
        for kernel in PLAIN.into_iter().take(6).chain(robust(c)) {
            let (close, far) = (kernel.value(near, 0.0), kernel.value(near + more, 0.0));
            prop_assert!(0.0 <= close && close <= far * (1.0 + 1e-6), "{kernel:?} costs {close}, then {far}");
            let (close, far) = (kernel.weight(near, 0.0), kernel.weight(near + more, 0.0));
            prop_assert!(far <= close * (1.0 + 1e-6), "{kernel:?} weighs {close}, then {far}");
            prop_assert_eq!(kernel.value(-near, 0.0), kernel.value(near, 0.0));
            prop_assert_eq!(kernel.derivative(-near, 0.0), -kernel.derivative(near, 0.0));
        }
    }

    /// What makes reweighting descend: half the weighted square touches the kernel at `e` and lies above it everywhere else.
    #[test]
    fn weighted_square_lies_above_the_kernel(e in -3.0_f32..3.0, x in -3.0_f32..3.0, c in 0.05_f32..2.0) {
        for kernel in PLAIN.into_iter().take(6).chain(robust(c)) {
            let (at, cost) = (f64::from(kernel.value(e, 0.0)), f64::from(kernel.value(x, 0.0)));
            let (e, x) = (f64::from(e), f64::from(x));
            let bound = at + 0.5 * f64::from(kernel.weight(e as f32, 0.0)) * (x * x - e * e);
            // L1 counts errors below its floor as at least that.
            let floor = if kernel == Kernel::L1 { f64::from(L1_WEIGHT_FLOOR) } else { 0.0 };
            prop_assert!(cost <= bound + 1e-6 * (at + cost + bound.abs()) + floor, "{kernel:?}: {cost} above {bound}");
        }
    }

    #[test]
    fn shape_has_no_seams(x in -3.0_f32..3.0, c in 0.1_f32..2.0) {
        // On either side of each case of its own, the value is next to that of the case.
        for (shape, beside) in [
            (2.0_f32, [2.0 - 2.4e-7_f32, 2.0 + 2.4e-7]),
            (0.0, [-1e-6, 1e-6]),
            (0.0, [-1e-40, 1e-40]),
            (f32::NEG_INFINITY, [-1e7, -1e38]),
        ] {
            for beside in beside {
                for (what, f) in [("value", general as fn(f32, f32, f32) -> f32), ("weight", general_weight)] {
                    let (at, near) = (f(x, shape, c), f(x, beside, c));
                    // The rate of change with the shape is at most z (1 + ln z) near 2, z^2 / a near the end.
                    let z = (x / c) * (x / c);
                    let bound = 2e-6 * (1.0 + z * z) * at.max(1e-3);
                    prop_assert!((at - near).abs() <= bound, "{what} at {x}: {at} for {shape}, {near} for {beside}");
                }
            }
        }
    }
}

#[test]
fn general_kernel_contains_the_named_ones() {
    for c in [0.03_f32, 0.5, 1.0] {
        for x in [-2.0_f32, -0.1, 0.0, 1e-4, 0.03, 0.4, 1.0, 50.0] {
            let same = |what: &str, a: f32, b: f32| {
                assert!((a - b).abs() <= 2e-6 * b.abs() + 1e-37, "{what} at {x}, c {c}: {a} and {b}");
            };
            let z = (x / c) * (x / c);
            same("least squares", general(x, 2.0, c), 0.5 * z);
            // Charbonnier in units of c, less its value at 0 (which costs digits near 0).
            let less = charbonnier(x, c) / c - 1.0;
            assert!((general(x, 1.0, c) - less).abs() <= 2e-6 * less + 1e-6);
            same("Cauchy", general(x, 0.0, c), cauchy(x, c));
            same("Geman-McClure", general(x, -2.0, c), geman_mcclure(x, c));
            same("Welsch", general(x, f32::NEG_INFINITY, c), welsch(x, c));
            same("weight of Cauchy", general_weight(x, 0.0, c), cauchy_weight(x, c));
            same("weight of Geman-McClure", general_weight(x, -2.0, c), geman_mcclure_weight(x, c));
            same("weight of Welsch", general_weight(x, f32::NEG_INFINITY, c), welsch_weight(x, c));
            // Far out in the tail of exp(-z / 2) a rounding of the scale is multiplied by z.
            let grown = (0.5 * f64::from(z)).exp_m1();
            if grown < 1e30 {
                let got = f64::from(general(x, f32::INFINITY, c));
                assert!((got - grown).abs() <= 1e-6 * f64::from(1.0 + z) * grown, "{got} {grown}");
            }
        }
    }
}

#[test]
fn weights_at_zero_are_the_limits() {
    for c in [1e-3_f32, 0.1, 7.0] {
        for kernel in robust(c) {
            let want = 1.0 / (f64::from(c) * f64::from(c));
            for x in [0.0_f32, -0.0, 1e-30, -1e-20, 1e-45] {
                let got = f64::from(kernel.weight(x, 0.0));
                assert!((got - want).abs() <= 1e-6 * want, "{kernel:?} weighs {got} at {x}, limit {want}");
            }
        }
    }
    let at_zero = PLAIN.map(|kernel| kernel.weight(0.5, 0.5));
    let want = [2.0, 1.0, 1000.0, 1.0, 1.0, 2.0, 2.0 / (0.501 * 0.501)];
    for ((kernel, got), want) in PLAIN.iter().zip(at_zero).zip(want) {
        let want =
            if matches!(kernel, Kernel::L1 | Kernel::Charbonnier { c: 0.0 }) { 1.0 / L1_WEIGHT_FLOOR } else { want };
        assert!((got - want).abs() <= 1e-6 * want, "{kernel:?}: {got}, {want}");
    }
}

#[test]
fn outliers_cost_what_they_should() {
    assert_eq!(geman_mcclure(f32::INFINITY, 0.1), 2.0);
    assert_eq!(geman_mcclure(1e38, 1e-38), 2.0);
    assert_eq!(welsch(f32::NEG_INFINITY, 0.1), 1.0);
    assert_eq!(tukey(0.1, 0.1), 1.0 / 6.0);
    assert_eq!(tukey(f32::INFINITY, 0.1), 1.0 / 6.0);
    assert_eq!(trimmed(3.0, 0.1), 0.5);
    assert_eq!(general(f32::INFINITY, -1.0, 0.1), 3.0);
    assert_eq!(general(f32::INFINITY, 0.0, 0.1), f32::INFINITY);
    assert_eq!(general(f32::INFINITY, 0.5, 0.1), f32::INFINITY);
    let slopes =
        [2.0, 1.5, 1.0, 0.9, 0.0, -2.0, f32::NEG_INFINITY].map(|a| general_derivative(f32::NEG_INFINITY, a, 0.5));
    assert_eq!(slopes, [f32::NEG_INFINITY, f32::NEG_INFINITY, -2.0, 0.0, 0.0, 0.0, 0.0]);
    for kernel in robust(0.25).into_iter().skip(3) {
        assert_eq!(kernel.derivative(f32::INFINITY, 0.0), 0.0, "{kernel:?}");
        assert_eq!(kernel.weight(f32::INFINITY, 0.0), 0.0, "{kernel:?}");
    }
}

#[test]
fn robust_kernels_hold_at_extremes_and_keep_nan() {
    for c in [1e-30_f32, 1e-3, 1.0, 1e30] {
        for kernel in robust(c) {
            kernel.check().unwrap();
            for x in [0.0_f32, -0.0, 1e-45, -1e-40, 1e-30, 1e-8, -1.0, 1e15, -1e30, f32::MAX] {
                let [value, slope, weight] = [kernel.value(x, 0.0), kernel.derivative(x, 0.0), kernel.weight(x, 0.0)];
                let (x, c) = (f64::from(x), f64::from(c));
                // What an f32 can't hold is infinite.
                let fits = |most: f64| if most * (1.0 + 1e-6) > f64::from(f32::MAX) { f64::INFINITY } else { most };
                assert!(value >= 0.0 && weight >= 0.0, "{kernel:?} at {x}: {value}, {weight}");
                // Every robust cost is at most that of least squares: finite wherever that is.
                let most = fits(0.5 * (x / c).powi(2));
                assert!(f64::from(value) <= most * (1.0 + 1e-6) + 1e-44, "{kernel:?} at {x}: {value} above {most}");
                let most = fits(x.abs() / c / c);
                assert!(f64::from(slope).abs() <= most * (1.0 + 1e-6) + 1e-44, "{kernel:?}' at {x}: {slope}, {most}");
            }
            for [p, t] in [[f32::NAN, 0.5], [0.5, f32::NAN]] {
                assert!(kernel.value(p, t).is_nan(), "{kernel:?} hides a NaN");
                assert!(kernel.derivative(p, t).is_nan(), "{kernel:?}' hides a NaN");
                assert!(kernel.weight(p, t).is_nan(), "the weight of {kernel:?} hides a NaN");
            }
        }
    }
    for kernel in PLAIN {
        for [p, t] in [[f32::NAN, 0.5], [0.5, f32::NAN]] {
            assert!(kernel.weight(p, t).is_nan(), "the weight of {kernel:?} hides a NaN");
        }
    }
}

#[test]
fn unusable_parameters_are_named() {
    let bad = |c| {
        [
            Kernel::General { shape: 1.0, c },
            Kernel::Cauchy { c },
            Kernel::GemanMcClure { c },
            Kernel::Welsch { c },
            Kernel::Tukey { c },
            Kernel::Trimmed { c },
        ]
    };
    for kernel in [0.0, -1.0, f32::NAN, f32::INFINITY].into_iter().flat_map(bad) {
        assert!(matches!(kernel.check(), Err(LossError::Parameter { .. })), "{kernel:?}");
    }
    let error = Kernel::General { shape: f32::NAN, c: 1.0 }.check().unwrap_err();
    assert_eq!(error.to_string(), "`shape` of the general kernel is NaN, expected a number");
    let error = Kernel::GemanMcClure { c: 0.0 }.check().unwrap_err();
    assert_eq!(error.to_string(), "`c` of the Geman-McClure kernel is 0, expected a finite number above 0");
}
