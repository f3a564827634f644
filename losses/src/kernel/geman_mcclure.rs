//! The kernel of Geman and McClure: an outlier costs the same however far out it lies.

use super::general::ratio_squared;

/// `2 z / (z + 4)` with `z = (x / c)^2`: a parabola near 0, tends to 2. [`general`](super::general) with shape -2.
///
/// The classic form `x^2 / (x^2 + c'^2)` is half of it with `c' = 2 c`.
///
/// # Numerics
/// In `f64`, finite for every `x`.
///
/// # Source
/// Geman and McClure, "Bayesian image analysis: an application to single photon emission tomography", 1985; in this scale
/// Barron, "A general and adaptive robust loss function", 2019.
#[inline]
#[must_use]
pub fn geman_mcclure(x: f32, c: f32) -> f32 {
    // Divided through by z: no overflow meets another.
    (2.0 / (1.0 + 4.0 / ratio_squared(x, c))) as f32
}

/// `x` times [`geman_mcclure_weight`]; 0 at `±inf`.
#[inline]
#[must_use]
pub fn geman_mcclure_derivative(x: f32, c: f32) -> f32 {
    if x.is_infinite() { 0.0 } else { (f64::from(x) * weight(x, c)) as f32 }
}

/// Weight of iteratively reweighted least squares, `16 / (z + 4)^2 / c^2`; `1 / c^2` at 0.
#[inline]
#[must_use]
pub fn geman_mcclure_weight(x: f32, c: f32) -> f32 {
    weight(x, c) as f32
}

#[inline(always)]
fn weight(x: f32, c: f32) -> f64 {
    let q = 4.0 / (ratio_squared(x, c) + 4.0) / f64::from(c);
    q * q
}
