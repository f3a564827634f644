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
