//! Reweighted least squares: right answers among outliers, descent, what it can't decide.

use losses::LossError;
use losses::irls::{Irls, Outcome, Solved, solve_linear};
use losses::kernel::Kernel;
use proptest::prelude::*;

/// Kernels that forget outliers, for inliers within about 1.
const REDESCENDING: [Kernel; 6] = [
    Kernel::General { shape: -5.0, c: 0.7 },
    Kernel::GemanMcClure { c: 0.5 },
    Kernel::Welsch { c: 1.0 },
    Kernel::Cauchy { c: 0.3 },
    Kernel::Tukey { c: 3.0 },
    Kernel::Trimmed { c: 3.0 },
];

/// Numbers in `[0, 1)`, the same in every run.
fn numbers(n: usize, seed: u64) -> Vec<f64> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    (0..n).map(|_| next()).collect()
}

/// `n` values within 1 of `centre` (their mean exactly there), of which the first `outliers` lie 20 to 100 above.
fn contaminated(n: usize, outliers: usize, centre: f64, seed: u64) -> Vec<f64> {
    let u = numbers(n, seed);
    let mean = u[outliers..].iter().sum::<f64>() / (n - outliers) as f64;
    let at = |i: usize| if i < outliers { 20.0 + 80.0 * u[i] } else { 2.0 * (u[i] - mean) };
    (0..n).map(|i| centre + at(i)).collect()
}

#[test]
fn mean_is_found_among_gross_outliers() {
    for share in [30, 40] {
        for (kernel, seed) in REDESCENDING.into_iter().flat_map(|k| (1..6).map(move |s| (k, s))) {
            let (n, outliers) = (200, 2 * share);
            let y = contaminated(n, outliers, 5.0, seed);
            let fit = Irls::new(kernel).location(&y).unwrap();
            assert_eq!(fit.report.outcome, Outcome::Converged, "{kernel:?}");
            // Kernels with an end see the inliers only, and those of the parabola their mean; smooth ones weigh the inliers
            // unequally, which moves the estimate by at most a few standard errors (0.58 / sqrt(120) = 0.05).
            let bound = if matches!(kernel, Kernel::Trimmed { .. }) { 1e-9 } else { 0.2 };
            assert!((fit.value - 5.0).abs() < bound, "{kernel:?}, {share} %, seed {seed}: {}", fit.value);
            let plain = Irls::new(Kernel::Squared).location(&y).unwrap();
            assert!(plain.value > 5.0 + 0.2 * share as f64, "the plain mean is pulled along: {}", plain.value);
        }
    }
}

#[test]
fn line_is_found_among_gross_outliers() {
    for kernel in REDESCENDING {
        for seed in 1..4 {
            let (n, outliers) = (100, 40);
            let x: Vec<f64> = numbers(n, seed + 100).iter().map(|u| 20.0 * u - 10.0).collect();
            // Outliers in y, and all on one side.
            let y: Vec<f64> =
                contaminated(n, outliers, 0.0, seed).iter().zip(&x).map(|(e, x)| 3.0 - 0.5 * x + e).collect();
            let fit = Irls::new(kernel).line(&x, &y).unwrap();
            assert_eq!(fit.report.outcome, Outcome::Converged, "{kernel:?}");
            assert!((fit.slope + 0.5).abs() < 0.05, "{kernel:?}: slope {}", fit.slope);
            assert!((fit.intercept - 3.0).abs() < 0.3, "{kernel:?}: intercept {}", fit.intercept);
            if matches!(kernel, Kernel::Trimmed { .. }) {
                // Exactly least squares of the inliers.
                let design: Vec<f64> = x[outliers..].iter().flat_map(|&x| [1.0, x]).collect();
                let mut want = [0.0; 2];
                solve_linear(&design, &y[outliers..], &vec![1.0; n - outliers], &mut want).unwrap();
                assert!((fit.intercept - want[0]).abs() + (fit.slope - want[1]).abs() < 1e-9);
            }
        }
    }
}

proptest! {
    #![proptest_config(testkit::property::cases(48))]

    #[test]
    fn objective_never_grows(
        y in prop::collection::vec(prop_oneof![-1.0_f64..1.0, -100.0_f64..100.0], 2..40),
        start in -50.0_f64..50.0,
        c in 0.05_f32..5.0,
    ) {
        let general = [2.0, 1.0, 0.5, 0.0, -2.0, -20.0, f32::NEG_INFINITY].map(|shape| Kernel::General { shape, c });
        let others = [Kernel::Squared, Kernel::Charbonnier { c }, Kernel::Huber { delta: c }, Kernel::Tukey { c }, Kernel::Trimmed { c }];
        let x: Vec<f64> = (0..y.len()).map(|i| (i as f64 * 1.3).sin()).collect();
        let design: Vec<f64> = x.iter().flat_map(|&x| [1.0, x]).collect();
        for kernel in general.into_iter().chain(others) {
            let step = Irls::new(kernel).with_tolerance(0.0).with_max_iterations(1);
            let mut parameters = [start, 0.0];
            let e: Vec<f64> = y.iter().map(|y| start - y).collect();
            let mut before = step.objective(&e);
            for round in 0..12 {
                let report = step.linear(&design, &y, &mut parameters).unwrap();
                // Costs are f32; errors of a perfect fit are rounding.
                prop_assert!(report.objective <= before * (1.0 + 1e-6) + 1e-20, "{kernel:?}, round {round}: {before} to {}", report.objective);
                before = report.objective;
                if report.outcome == Outcome::Undetermined {
                    break;
                }
            }
        }
    }

    #[test]
    fn location_moves_and_scales_with_the_data(seed in 1_u64..500, shift in -10.0_f64..10.0) {
        let y = contaminated(50, 15, 0.0, seed);
        let moved: Vec<f64> = y.iter().map(|y| 4.0 * (y + shift)).collect();
        let base = Irls::new(Kernel::Welsch { c: 1.0 }).location(&y).unwrap().value;
        let got = Irls::new(Kernel::Welsch { c: 4.0 }).location(&moved).unwrap().value;
        prop_assert!((got - 4.0 * (base + shift)).abs() < 1e-4, "{got} {base}");
    }

    #[test]
    fn weighted_solve_leaves_no_gradient(seed in 1_u64..500, k in 1_usize..5, n in 5_usize..30) {
        let (a, y, w) = (numbers(n * k, seed), numbers(n, seed + 1), numbers(n, seed + 2));
        let mut p = vec![0.0; k];
        prop_assert_eq!(solve_linear(&a, &y, &w, &mut p).unwrap(), Solved::Yes);
        for c in 0..k {
            let slope: f64 = (0..n)
                .map(|i| w[i] * a[i * k + c] * (a[i * k..][..k].iter().zip(&p).map(|(a, p)| a * p).sum::<f64>() - y[i]))
                .sum();
            prop_assert!(slope.abs() < 1e-8, "column {c}: {slope}");
        }
    }
}

#[test]
fn least_squares_is_done_in_one_round() {
    let y = [1.0, 2.0, 6.0];
    let fit = Irls::new(Kernel::Squared).location(&y).unwrap();
    // The first fit is exact, the second sees that nothing moves.
    assert_eq!((fit.report.iterations, fit.report.outcome), (2, Outcome::Converged));
    assert!((fit.value - 3.0).abs() < 1e-12 && (fit.report.objective - 14.0).abs() < 1e-6);
}

#[test]
fn l1_finds_the_median() {
    let y = [1.0, 2.0, 4.0, 90.0, 1000.0];
    let mut value = [20.0];
    let irls = Irls::new(Kernel::L1).with_max_iterations(400);
    irls.linear(&[1.0; 5], &y, &mut value).unwrap();
    assert!((value[0] - 4.0).abs() < 1e-3, "{value:?}");
}

#[test]
fn minimise_fits_what_is_not_linear() {
    // y = exp(rate t): Gauss-Newton steps, weighted; two values are gross outliers.
    let t: Vec<f64> = (0..20).map(|i| f64::from(i) / 10.0).collect();
    let mut y: Vec<f64> = t.iter().map(|t| (0.8 * t).exp()).collect();
    (y[3], y[15]) = (40.0, -30.0);
    let (mut e, mut w, mut rate) = (vec![0.0; 20], vec![0.0; 20], [0.3]);
    let irls = Irls::new(Kernel::Cauchy { c: 0.1 });
    let report = irls
        .minimise(
            &mut rate,
            &mut e,
            &mut w,
            |p, e| e.iter_mut().zip(&t).zip(&y).for_each(|((e, t), y)| *e = (p[0] * t).exp() - y),
            |w, p| {
                let (mut up, mut down) = (0.0, 0.0);
                for ((w, t), y) in w.iter().zip(&t).zip(&y) {
                    let model = (p[0] * t).exp();
                    up += w * t * model * (model - y);
                    down += w * (t * model).powi(2);
                }
                p[0] -= up / down;
                Solved::Yes
            },
        )
        .unwrap();
    assert_eq!(report.outcome, Outcome::Converged);
    assert!((rate[0] - 0.8).abs() < 1e-3, "{rate:?}");
    // What is left behind: the errors, and weights that tell the outliers.
    assert!(e[0].abs() < 1e-2 && e[3] < -30.0);
    assert!(w[3] < 1e-4 * w[0] && w[15] < 1e-4 * w[0]);
}

#[test]
fn what_has_no_answer_says_so() {
    // All beyond the end of the kernel.
    let mut value = [100.0];
    let report = Irls::new(Kernel::Tukey { c: 1.0 }).linear(&[1.0; 3], &[0.0, 1.0, 2.0], &mut value).unwrap();
    assert_eq!((report.outcome, report.iterations, value), (Outcome::Undetermined, 0, [100.0]));
    // One place, no slope.
    let fit = Irls::new(Kernel::Welsch { c: 1.0 }).line(&[2.0; 4], &[1.0, 1.0, 2.0, 3.0]).unwrap();
    assert_eq!((fit.report.outcome, fit.slope), (Outcome::Undetermined, 0.0));
    assert_eq!(solve_linear(&[1.0, 2.0, 2.0, 4.0], &[1.0, 1.0], &[1.0; 2], &mut [0.0; 2]), Ok(Solved::Undetermined));
    let irls = Irls::new(Kernel::Squared);
    assert_eq!(irls.location(&[]), Err(LossError::Shape { what: "y", want: 1, got: 0 }));
    assert_eq!(irls.line(&[1.0], &[1.0]), Err(LossError::Shape { what: "x", want: 2, got: 1 }));
    assert_eq!(irls.location(&[1.0, f64::NAN]), Err(LossError::NonFinite { what: "y", index: 1 }));
    let error = irls.linear(&[1.0, 1.0], &[f64::INFINITY, 0.0], &mut [0.0]).unwrap_err();
    assert_eq!(error.to_string(), "value 0 of `errors` is NaN or infinite");
    assert!(matches!(Irls::new(Kernel::Tukey { c: 0.0 }).location(&[1.0]), Err(LossError::Parameter { .. })));
    // No parameters and no errors are fine.
    assert_eq!(irls.linear(&[], &[], &mut [0.0]).unwrap().outcome, Outcome::Undetermined);
    assert_eq!(irls.linear(&[], &[2.0], &mut []).unwrap().objective, 4.0);
    assert!((irls.location(&[7.0]).unwrap().value - 7.0).abs() < 1e-12);
}
