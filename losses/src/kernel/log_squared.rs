//! The squared error of logarithms, for radiance without an upper end (log-MSE).

use float_core::{m32, m64};

/// Usual `eps` of [`log_squared`], colour units.
pub const LOG_EPS: f32 = 1e-3;

/// `(ln(max(prediction, 0) + eps) - ln(max(target, 0) + eps))^2`: twice too bright costs the same in the sun and in the
/// shade.
///
/// * `prediction`, `target`: linear radiance, expected `>= 0`; below 0 counts as 0
/// * `eps`: `> 0`, the radiance under which errors stop to matter (usually [`LOG_EPS`])
///
/// # Numerics
/// The difference of two nearly equal logarithms is taken as one `ln_1p` of the relative error, so it keeps its digits
/// where training spends its time.
///
/// # Source
/// The tone curve `ln(x + eps)` under a squared error, as in Mildenhall et al., "NeRF in the Dark" (RawNeRF), 2022, section 4
/// (there linearised around the prediction; here exact).
#[inline]
#[must_use]
pub fn log_squared(prediction: f32, target: f32, eps: f32) -> f32 {
    let d = log_ratio(non_negative(prediction), non_negative(target), eps);
    d * d
}

/// Derivative of [`log_squared`] with respect to `prediction`: `2 ln((p + eps) / (t + eps)) / (p + eps)`, the derivative to the
/// right at `p = 0`, and 0 below, where the cost is flat.
#[inline]
#[must_use]
pub fn log_squared_derivative(prediction: f32, target: f32, eps: f32) -> f32 {
    if prediction < 0.0 {
        return 0.0;
    }
    2.0 * log_ratio(prediction, non_negative(target), eps) / (prediction + eps)
}

/// Weight of iteratively reweighted least squares: [`log_squared_derivative`] over `prediction - target`;
/// `2 / (target + eps)^2` where they are equal.
#[inline]
#[must_use]
pub fn log_squared_weight(prediction: f32, target: f32, eps: f32) -> f32 {
    if prediction < 0.0 {
        return 0.0;
    }
    let (p, t, eps) = (f64::from(prediction), f64::from(target), f64::from(eps));
    let (difference, base) = (p - t.max(0.0), t.max(0.0) + eps);
    // A NaN target is not to pass for a black one.
    if target.is_nan() {
        return target;
    }
    if difference == 0.0 && target >= 0.0 {
        return (2.0 / (base * base)) as f32;
    }
    let derivative = 2.0 * m64::ln_1p(difference / base) / (p + eps);
    (derivative / (p - t)) as f32
}

/// `ln((p + eps) / (t + eps))` for `p, t >= 0`.
#[inline]
fn log_ratio(p: f32, t: f32, eps: f32) -> f32 {
    let (difference, base) = (p - t, t + eps);
    if difference.abs() < 0.5 * base {
        m32::ln_1p(difference / base)
    } else {
        // Two logarithms: the quotient itself could overflow.
        m32::ln(p + eps) - m32::ln(base)
    }
}

/// `max(x, 0)` that keeps NaN.
#[inline(always)]
fn non_negative(x: f32) -> f32 {
    if x < 0.0 { 0.0 } else { x }
}
