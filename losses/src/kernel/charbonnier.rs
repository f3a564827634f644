//! The Charbonnier kernel: an L1 with a rounded tip.

use float_core::{m32, m64};

/// `sqrt(x^2 + c^2)`, a hyperbola that is `c` at 0 and tends to `|x|`.
///
/// # Numerics
/// `hypot`, so neither a tiny nor a huge `x` loses the other term. `c = 0` is [`l1`](super::l1).
///
/// # Source
/// Charbonnier et al., "Two deterministic half-quadratic regularization algorithms", 1994; the data term of Barron et
/// al., "mip-NeRF 360", 2022, with `c = 0.001`.
#[inline]
#[must_use]
pub fn charbonnier(x: f32, c: f32) -> f32 {
    m32::hypot(x, c)
}

/// `x / sqrt(x^2 + c^2)`, in `[-1, 1]`; 0 at `x = c = 0`, ±1 at `x = ±inf`.
#[inline]
#[must_use]
pub fn charbonnier_derivative(x: f32, c: f32) -> f32 {
    let root = m32::hypot(x, c);
    if root == 0.0 {
        0.0
    } else if x.is_infinite() {
        1.0_f32.copysign(x)
    } else {
        x / root
    }
}

/// Weight of iteratively reweighted least squares, `1 / sqrt(x^2 + c^2)`; `1 / c` at 0. `c = 0` is
/// [`l1_weight`](super::l1_weight).
#[inline]
#[must_use]
pub fn charbonnier_weight(x: f32, c: f32) -> f32 {
    if c == 0.0 { super::l1_weight(x) } else { (1.0 / m64::hypot(f64::from(x), f64::from(c))) as f32 }
}
