//! The Cauchy kernel: the cost of an outlier grows like a logarithm.

use super::general::ratio_squared;
use float_core::m64;

/// `ln(1 + (x / c)^2 / 2)`. [`general`](super::general) with shape 0.
///
/// # Source
/// Black and Anandan, "The robust estimation of multiple motions", 1996; in this scale Barron, "A general and adaptive
/// robust loss function", 2019.
#[inline]
#[must_use]
pub fn cauchy(x: f32, c: f32) -> f32 {
    m64::ln_1p(0.5 * ratio_squared(x, c)) as f32
}

/// `x` times [`cauchy_weight`]: `2 x / (x^2 + 2 c^2)`, at most `1 / (sqrt(2) c)`; 0 at `±inf`.
#[inline]
#[must_use]
pub fn cauchy_derivative(x: f32, c: f32) -> f32 {
    if x.is_infinite() { 0.0 } else { (f64::from(x) * weight(x, c)) as f32 }
}

/// Weight of iteratively reweighted least squares, `2 / (x^2 + 2 c^2)`; `1 / c^2` at 0.
#[inline]
#[must_use]
pub fn cauchy_weight(x: f32, c: f32) -> f32 {
    weight(x, c) as f32
}

#[inline(always)]
fn weight(x: f32, c: f32) -> f64 {
    let (x, c) = (f64::from(x), f64::from(c));
    2.0 / (x * x + 2.0 * c * c)
}
