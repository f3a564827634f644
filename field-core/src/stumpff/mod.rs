//! Stumpff functions: the coefficients of exponential maps, as functions of the **squared** angle.
//!
//! `c_k(u) = sum((-u)^j / (k + 2 j)!, j)`, so that with `u = theta^2`
//! `c_0 = cos theta`, `c_1 = sin theta / theta`, `c_2 = (1 - cos theta) / theta^2`,
//! `c_3 = (theta - sin theta) / theta^3`. They are entire: smooth also at 0, where the quotients are 0/0, and at pi.
//! Derivatives stay in the family: `c_k' = -1/2 (c_{k+1} - k c_{k+2})`.
//!
//! # Source
//! K. Stumpff, "Himmelsmechanik", 1959; as coefficients of rotations e.g. Gallego and Yezzi, "A compact formula for the
//! derivative of a 3-D rotation in exponential coordinates", 2015.

mod lanes;

pub(crate) use lanes::Lanes;

use float_core::m64;

/// Below this value of `u` the argument counts as this: `cosh(80)^2` is still far below the largest `f32`.
const LOWEST: f64 = -6400.0;

/// `|u|` up to which the series is summed. There the terms, all of one sign at `-|u|`, exceed the sum by a factor of
/// at most 12, so that cancellation costs a digit; past it the closed form has lost its own cancellation.
fn series_bound(k: u32) -> f32 {
    match k {
        0 => 4.0,
        1..=3 => 10.0,
        _ => 10.0 * (k - 2) as f32,
    }
}

/// `c_k(u)`. Error at most 1e-15 of `max(|c_k(u)|, c_k(0))` for `k <= 9`.
///
/// Any finite `u` gives a finite number; `u < -6400` counts as -6400. NaN stays NaN.
///
/// ```
/// use field_core::stumpff::stumpff;
/// assert_eq!(stumpff(1, 0.0), 1.0);
/// assert!((stumpff(1, 4.0) - 2.0_f64.sin() / 2.0).abs() < 1e-15);
/// ```
#[must_use]
pub fn stumpff(k: u32, u: f64) -> f64 {
    stumpff_derivative(k, 0, u)
}

/// The derivative of `c_k` of order `order`, at `u`. Orders above about 3 are slow: past the range of the series each
/// order doubles the work.
#[must_use]
pub fn stumpff_derivative(k: u32, order: u32, u: f64) -> f64 {
    let u = if u < LOWEST { LOWEST } else { u };
    if u.abs() > f64::from(series_bound(k)) { closed_derivative(k, order, u) } else { series(k, order, u) }
}

/// First coefficient of the series of a derivative: `(-1)^m m! / (k + 2 m)!`.
fn first_coefficient(k: u32, order: u32) -> f64 {
    let factorial = |n: u32| (1..=n).fold(1.0, |product, i| product * f64::from(i));
    let sign = if order.is_multiple_of(2) { 1.0 } else { -1.0 };
    sign * factorial(order) / factorial(k + 2 * order)
}

/// Coefficient `j + 1` over coefficient `j`.
fn coefficient_ratio(k: u32, order: u32, j: u32) -> f64 {
    let (base, next) = (f64::from(k + 2 * order + 2 * j), f64::from(j + 1));
    -(next + f64::from(order)) / (next * (base + 1.0) * (base + 2.0))
}

fn series(k: u32, order: u32, u: f64) -> f64 {
    let mut term = first_coefficient(k, order);
    let (mut sum, mut j) = (term, 0);
    // NaN ends the loop and stays in the sum.
    while term.abs() > 1e-19 * sum.abs() && j < 80 {
        term *= coefficient_ratio(k, order, j) * u;
        sum += term;
        j += 1;
    }
    sum
}

fn closed_derivative(k: u32, order: u32, u: f64) -> f64 {
    if order == 0 {
        return closed(k, u);
    }
    let upper = stumpff_derivative(k + 1, order - 1, u);
    if k == 0 { -0.5 * upper } else { -0.5 * (upper - f64::from(k) * stumpff_derivative(k + 2, order - 1, u)) }
}

/// Trigonometric (hyperbolic for `u < 0`) form, climbing by `c_{k+2} = (1 / k! - c_k) / u`.
fn closed(k: u32, u: f64) -> f64 {
    let theta = m64::sqrt(u.abs());
    let mut c = match (k % 2, u > 0.0) {
        (0, true) => m64::cos(theta),
        (0, false) => m64::cosh(theta),
        (_, true) => m64::sin(theta) / theta,
        (_, false) => m64::sinh(theta) / theta,
    };
    let (mut at, mut inverse_factorial) = (k % 2, 1.0);
    while at < k {
        c = (inverse_factorial - c) / u;
        inverse_factorial /= f64::from((at + 1) * (at + 2));
        at += 2;
    }
    c
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Squared angles on both sides of every bound.
    fn arguments() -> impl Iterator<Item = f64> {
        let grid = (-400..=1600).map(|i| f64::from(i) / 10.0 + 0.037);
        grid.chain([0.0, 1e-24, 1e-300, -1e-12, core::f64::consts::PI.powi(2), 1e3, 1e6, 1e12, -1e3, -6e3])
    }

    #[test]
    fn low_orders_are_the_functions_they_are_named_after() {
        for u in arguments().filter(|&u| u > 0.0) {
            let t = u.sqrt();
            // 1e-16 t: what the sine of a rounded angle is off by.
            let tolerance = 1e-15 + 2e-16 * t;
            assert!((stumpff(0, u) - t.cos()).abs() < 3.0 * tolerance, "c_0({u})");
            assert!((stumpff(1, u) - t.sin() / t).abs() < tolerance, "c_1({u})");
            let half = (t / 2.0).sin() / (t / 2.0);
            assert!((stumpff(2, u) - 0.5 * half * half).abs() < tolerance, "c_2({u})");
        }
    }

    #[test]
    fn neighbours_obey_the_recursion() {
        for k in 0..=7 {
            let inverse_factorial = first_coefficient(k, 0);
            for u in arguments() {
                let (a, b) = (stumpff(k, u), stumpff(k + 2, u));
                let scale = inverse_factorial.max(a.abs());
                assert!((u * b + a - inverse_factorial).abs() <= 4e-15 * scale, "k {k}, u {u}: {a} {b}");
            }
        }
    }

    #[test]
    fn derivatives_match_differences_and_the_family() {
        for k in 0..=5 {
            for order in 0..3 {
                for u in arguments().filter(|u| u.abs() < 200.0) {
                    let h = 1e-5 * u.abs().max(1.0);
                    let got = stumpff_derivative(k, order + 1, u);
                    let f = |u| stumpff_derivative(k, order, u);
                    let want = (f(u + h) - f(u - h)) / (2.0 * h);
                    // Rounding of the differences, relative to the values differenced, and their curvature.
                    let scale = f(u).abs().max(first_coefficient(k, order).abs());
                    assert!((got - want).abs() <= 1e-8 * scale, "k {k}, order {order}, u {u}: {got} {want}");
                    let next = |k| stumpff_derivative(k, order, u);
                    let family = -0.5 * (next(k + 1) - f64::from(k) * next(k + 2));
                    assert!((got - family).abs() <= 1e-14 * scale, "k {k}, order {order}, u {u}: {got} {family}");
                }
            }
        }
    }

    #[test]
    fn every_finite_argument_gives_a_finite_number_and_nan_stays() {
        for k in 0..=9 {
            for order in 0..=3 {
                for u in [0.0, -0.0, 1e-300, 1e300, f64::MAX, -1e300, f64::MIN, -6400.0, 4.0, 10.0, -10.0] {
                    assert!(stumpff_derivative(k, order, u).is_finite(), "k {k}, order {order}, u {u}");
                    assert!((stumpff_derivative(k, order, u) as f32).is_finite(), "k {k}, order {order}, u {u}");
                }
                assert!(stumpff_derivative(k, order, f64::NAN).is_nan());
            }
        }
    }
}
