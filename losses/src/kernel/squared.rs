//! The squared error.

/// `x^2`: the mean over a batch is the MSE that PSNR speaks of.
///
/// Without the factor 1/2 of least squares. `+inf` above `|x| = 1.8e19`.
///
/// # Source
/// Mildenhall et al., "NeRF", 2020, eq. 6.
#[inline(always)]
#[must_use]
pub fn squared(x: f32) -> f32 {
    x * x
}

/// `2 x`.
#[inline(always)]
#[must_use]
pub fn squared_derivative(x: f32) -> f32 {
    2.0 * x
}

/// Weight of iteratively reweighted least squares: 2 everywhere.
#[inline(always)]
#[must_use]
pub fn squared_weight(x: f32) -> f32 {
    if x.is_nan() { x } else { 2.0 }
}
