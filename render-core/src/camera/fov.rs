//! The FOV lens: `r_d = atan(2 r tan(omega / 2)) / omega`, on the tangent plane.
//!
//! Devernay and Faugeras, "Straight lines have to be straight", 2001, eq. 13.

use float_core::m64;

use super::polynomial::evaluate;

/// Below this (radians) the model is the identity to 1e-12 everywhere on the tangent plane.
const IDENTITY: f64 = 1e-12;

/// `r_d / r` and its derivative with respect to `r^2`.
pub(super) fn factor(omega: f64, r2: f64) -> (f64, f64) {
    if omega.abs() < IDENTITY {
        return (1.0, 0.0);
    }
    let a = 2.0 * m64::tan(0.5 * omega);
    let z2 = a * a * r2;
    if z2 < 1e-4 {
        // atan(z) / z = 1 - z^2/3 + z^4/5 - z^6/7 + ...
        let value = evaluate(&[1.0, -1.0 / 3.0, 0.2, -1.0 / 7.0], z2);
        let derivative = evaluate(&[-1.0 / 3.0, 0.4, -3.0 / 7.0, 4.0 / 9.0], z2);
        return (a / omega * value, a * a * a / omega * derivative);
    }
    let r = m64::sqrt(r2);
    let value = m64::atan(a * r) / (omega * r);
    (value, (a / (omega * (1.0 + z2)) - value) / (2.0 * r2))
}

/// Derivative of `r_d / r` with respect to `omega`.
pub(super) fn factor_omega(omega: f64, r2: f64) -> f64 {
    if omega.abs() * (1.0 + m64::sqrt(r2)) < 1e-4 {
        // From 1 + omega^2 (1/12 - r^2/3) + ...: the closed form cancels here.
        return omega * (1.0 / 6.0 - 2.0 * r2 / 3.0);
    }
    let a = 2.0 * m64::tan(0.5 * omega);
    ((1.0 + 0.25 * a * a) / (1.0 + a * a * r2) - factor(omega, r2).0) / omega
}

/// `r / r_d`, `None` where the model has no such ray.
pub(super) fn inverse_factor(omega: f64, r_d: f64) -> Option<f64> {
    if omega.abs() < IDENTITY {
        return Some(1.0);
    }
    let angle = (r_d * omega).abs();
    let a = 2.0 * m64::tan(0.5 * omega.abs());
    if angle < 1e-8 {
        Some(omega.abs() / a)
    } else if angle < core::f64::consts::FRAC_PI_2 {
        Some(m64::tan(angle) / (a * r_d))
    } else {
        None
    }
}
