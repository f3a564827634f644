//! The Huber kernel: a parabola that goes on as its tangents.

/// Where the parabola of [`huber_ngp`] ends, colour units.
pub const NGP_DELTA: f32 = 0.1;

/// What [`huber_ngp`] divides by, so that its parabola is exactly `x^2`: `1 / (2 * 0.1 * 5) = 1`.
pub const NGP_DIVISOR: f32 = 5.0;

/// `x^2 / 2` where `|x| <= delta`, else `delta (|x| - delta / 2)`.
///
/// # Source
/// Huber, "Robust estimation of a location parameter", 1964.
#[inline(always)]
#[must_use]
pub fn huber(x: f32, delta: f32) -> f32 {
    if x.abs() <= delta { 0.5 * x * x } else { delta * (x.abs() - 0.5 * delta) }
}

/// `x` clamped to `[-delta, delta]`.
#[inline(always)]
#[must_use]
pub fn huber_derivative(x: f32, delta: f32) -> f32 {
    // Asked this way round, NaN stays NaN.
    if x.abs() > delta { delta.copysign(x) } else { x }
}

/// Huber as Instant-NGP trains with: [`huber`] with `delta = 0.1`, divided by `delta` (derivative 1 outside), divided by 5.
///
/// That is `x^2` where `|x| <= 0.1`, else `(|x| - 0.05) / 5`: near the optimum it reads as a squared error.
///
/// # Source
/// Müller et al., "Instant Neural Graphics Primitives", 2022, as released.
#[inline(always)]
#[must_use]
pub fn huber_ngp(x: f32) -> f32 {
    huber(x, NGP_DELTA) / (NGP_DELTA * NGP_DIVISOR)
}

/// Derivative of [`huber_ngp`]: `2 x` inside, `±0.2` outside.
#[inline(always)]
#[must_use]
pub fn huber_ngp_derivative(x: f32) -> f32 {
    huber_derivative(x, NGP_DELTA) / (NGP_DELTA * NGP_DIVISOR)
}

/// Weight of iteratively reweighted least squares: 1 where `|x| <= delta`, else `delta / |x|`.
#[inline(always)]
#[must_use]
pub fn huber_weight(x: f32, delta: f32) -> f32 {
    if x.abs() <= delta { 1.0 } else { delta / x.abs() }
}

/// [`huber_weight`] of [`huber_ngp`]: 2 inside, `0.2 / |x|` outside.
#[inline(always)]
#[must_use]
pub fn huber_ngp_weight(x: f32) -> f32 {
    huber_weight(x, NGP_DELTA) / (NGP_DELTA * NGP_DIVISOR)
}
