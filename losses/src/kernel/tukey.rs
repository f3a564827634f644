//! Kernels with an end: Tukey's biweight and trimmed least squares. Beyond `c` an error costs a constant and weighs nothing.
//!
//! What weighs nothing cannot come back by itself: start from a robust estimate (a median, another kernel).

use super::general::ratio_squared;

/// `(1 - (1 - min((x / c)^2, 1))^3) / 6`: `(x / c)^2 / 2` near 0, flat at 1/6 from `|x| = c` on, twice differentiable.
///
/// # Source
/// Beaton and Tukey, "The fitting of power series, meaning polynomials, illustrated on band-spectroscopic data", 1974.
#[inline]
#[must_use]
pub fn tukey(x: f32, c: f32) -> f32 {
    let z = ratio_squared(x, c);
    // 1 - (1 - z)^3 without cancellation. Asked this way round, NaN stays NaN.
    if z >= 1.0 { 1.0 / 6.0 } else { (z * (3.0 - 3.0 * z + z * z) / 6.0) as f32 }
}

/// `x` times [`tukey_weight`].
#[inline]
#[must_use]
pub fn tukey_derivative(x: f32, c: f32) -> f32 {
    if x.is_infinite() { 0.0 } else { (f64::from(x) * weight(x, c)) as f32 }
}

/// Weight of iteratively reweighted least squares, `(1 - (x / c)^2)^2 / c^2`, 0 from `|x| = c` on; `1 / c^2` at 0.
#[inline]
#[must_use]
pub fn tukey_weight(x: f32, c: f32) -> f32 {
    weight(x, c) as f32
}

#[inline(always)]
fn weight(x: f32, c: f32) -> f64 {
    let z = ratio_squared(x, c);
    if z >= 1.0 {
        0.0
    } else {
        let rest = (1.0 - z) / f64::from(c);
        rest * rest
    }
}

/// Trimmed least squares, `min((x / c)^2, 1) / 2`: a parabola that is cut off.
///
/// The limit of kernels with an end: inliers weigh the same, outliers nothing. With `c` from an order statistic of the errors
/// ([`crate::trimmed::TrimmedMask::threshold`]) it trims a share of them.
///
/// # Source
/// Rousseeuw, "Least median of squares regression", 1984 (the estimator); Blake and Zisserman, "Visual reconstruction", 1987
/// (the kernel).
#[inline]
#[must_use]
pub fn trimmed(x: f32, c: f32) -> f32 {
    let z = ratio_squared(x, c);
    if z >= 1.0 { 0.5 } else { (0.5 * z) as f32 }
}

/// `x` times [`trimmed_weight`].
#[inline]
#[must_use]
pub fn trimmed_derivative(x: f32, c: f32) -> f32 {
    let z = ratio_squared(x, c);
    if z > 1.0 { 0.0 } else { (f64::from(x) / (f64::from(c) * f64::from(c))) as f32 }
}

/// Weight of iteratively reweighted least squares: `1 / c^2` where `|x| <= c`, else 0.
#[inline]
#[must_use]
pub fn trimmed_weight(x: f32, c: f32) -> f32 {
    let z = ratio_squared(x, c);
    if z > 1.0 {
        0.0
    } else {
        // Keeps NaN.
        ((1.0 + 0.0 * z) / (f64::from(c) * f64::from(c))) as f32
    }
}
