//! The general robust kernel: one family from the parabola to kernels that forget outliers.

use float_core::m64;

/// `b / a ((x^2 / c^2 / b + 1)^(a / 2) - 1)` with `b = |a - 2|`, `a` the shape.
///
/// * `shape` `a`: how much outliers count. 2 is least squares `(x / c)^2 / 2`, 1 Charbonnier less its value at 0
///   (in units of `c`), 0 [`cauchy`](super::cauchy), -2 [`geman_mcclure`](super::geman_mcclure), `-inf`
///   [`welsch`](super::welsch). Above 2 outliers count more than in least squares; `+inf` is `exp((x / c)^2 / 2) - 1`.
/// * `c`: `> 0`, colour units: errors well below it count as in least squares, whatever the shape
///
/// # Numerics
/// `b / a expm1(a / 2 ln_1p(x^2 / c^2 / b))` in `f64`: with it the cases need no neighbourhood, only `a` exactly 2, 0 or infinite
/// is a case of its own. Even, never decreasing in `|x|`; as `x` grows without end `|b / a|` for `a < 0`, else `+inf`.
///
/// # Source
/// Barron, "A general and adaptive robust loss function", 2019, eqs. 8 and 13.
#[inline]
#[must_use]
pub fn general(x: f32, shape: f32, c: f32) -> f32 {
    let (a, z) = (f64::from(shape), ratio_squared(x, c));
    let value = if a == 2.0 {
        0.5 * z
    } else if a == 0.0 {
        m64::ln_1p(0.5 * z)
    } else if a.is_infinite() {
        a.signum() * m64::exp_m1(0.5 * a.signum() * z)
    } else {
        let b = (a - 2.0).abs();
        b / a * m64::exp_m1(0.5 * a * m64::ln_1p(z / b))
    };
    value as f32
}

/// Derivative of [`general`]: `x` times [`general_weight`].
///
/// At `±inf` the limit: 0 for `a < 1`, `±1 / c` for `a = 1`, `±inf` above.
#[inline]
#[must_use]
pub fn general_derivative(x: f32, shape: f32, c: f32) -> f32 {
    if x.is_infinite() {
        let limit = if shape < 1.0 {
            0.0
        } else if shape == 1.0 {
            1.0 / c
        } else {
            f32::INFINITY
        };
        return limit.copysign(x);
    }
    (f64::from(x) * weight(x, shape, c)) as f32
}

/// Weight of iteratively reweighted least squares, `kappa'(x) / x = (x^2 / c^2 / b + 1)^(a / 2 - 1) / c^2`; `1 / c^2` at 0.
///
/// Never increasing in `|x|` for `a <= 2`.
#[inline]
#[must_use]
pub fn general_weight(x: f32, shape: f32, c: f32) -> f32 {
    weight(x, shape, c) as f32
}

#[inline]
fn weight(x: f32, shape: f32, c: f32) -> f64 {
    let (a, z, c) = (f64::from(shape), ratio_squared(x, c), f64::from(c));
    let relative = if a == 2.0 {
        if z.is_nan() { z } else { 1.0 }
    } else if a.is_infinite() {
        m64::exp(0.5 * a.signum() * z)
    } else {
        m64::exp((0.5 * a - 1.0) * m64::ln_1p(z / (a - 2.0).abs()))
    };
    relative / (c * c)
}

/// `(x / c)^2`, without overflow for any finite `f32`.
#[inline(always)]
pub(super) fn ratio_squared(x: f32, c: f32) -> f64 {
    let y = f64::from(x) / f64::from(c);
    y * y
}
