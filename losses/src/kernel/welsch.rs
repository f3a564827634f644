//! The Welsch kernel: outliers are forgotten exponentially.

use super::general::ratio_squared;
use float_core::m64;

/// `1 - exp(-(x / c)^2 / 2)`: a parabola near 0, tends to 1. [`general`](super::general) with shape `-inf`.
///
/// # Source
/// Dennis and Welsch, "Techniques for nonlinear least squares and robust regression", 1978.
#[inline]
#[must_use]
pub fn welsch(x: f32, c: f32) -> f32 {
    -m64::exp_m1(-0.5 * ratio_squared(x, c)) as f32
}

/// `x` times [`welsch_weight`]; 0 at `±inf`.
#[inline]
#[must_use]
pub fn welsch_derivative(x: f32, c: f32) -> f32 {
    if x.is_infinite() { 0.0 } else { (f64::from(x) * weight(x, c)) as f32 }
}

/// Weight of iteratively reweighted least squares, `exp(-(x / c)^2 / 2) / c^2`; `1 / c^2` at 0.
#[inline]
#[must_use]
pub fn welsch_weight(x: f32, c: f32) -> f32 {
    weight(x, c) as f32
}

#[inline(always)]
fn weight(x: f32, c: f32) -> f64 {
    m64::exp(-0.5 * ratio_squared(x, c)) / (f64::from(c) * f64::from(c))
}
