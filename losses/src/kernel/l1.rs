//! The absolute error.

/// `|x|`.
#[inline(always)]
#[must_use]
pub fn l1(x: f32) -> f32 {
    x.abs()
}

/// The sign of `x`; 0 at 0, which is a subgradient and leaves a perfect prediction alone.
#[inline(always)]
#[must_use]
pub fn l1_derivative(x: f32) -> f32 {
    if x > 0.0 {
        1.0
    } else if x < 0.0 {
        -1.0
    } else {
        // 0 or NaN, and NaN must stay visible.
        x
    }
}

/// Under this an error counts as this in [`l1_weight`], colour units.
pub const L1_WEIGHT_FLOOR: f32 = 1e-6;

/// Weight of iteratively reweighted least squares: `1 / max(|x|, 1e-6)`. Without the floor it has no limit at 0.
#[inline(always)]
#[must_use]
pub fn l1_weight(x: f32) -> f32 {
    // Asked this way round, NaN stays NaN.
    if x.abs() < L1_WEIGHT_FLOOR { 1.0 / L1_WEIGHT_FLOOR } else { 1.0 / x.abs() }
}
