//! Logistic function and hyperbolic tangent: the same curve, scaled.

use super::exp::{exp_m1_tail, exp_tail};
use crate::Vector;

/// `1 / (1 + e^-x)`, with full digits where it is small, down to 0 through the subnormal numbers. Error at most
/// 2.5 ulp.
#[inline(always)]
pub fn logistic<V: Vector>(x: V) -> V {
    // exp of a non-positive number only: neither side overflows, neither loses digits.
    let e = exp_tail(-(x.max(-x)));
    x.select_positive(V::splat(1.0), e) / (V::splat(1.0) + e)
}

/// Hyperbolic tangent, with full digits near zero. Error at most 2.6 ulp.
#[inline(always)]
pub fn tanh<V: Vector>(x: V) -> V {
    // tanh |x| = (1 - e) / (1 + e) with e = e^-2|x|, from e - 1.
    let t = exp_m1_tail(V::splat(-2.0) * x.max(-x));
    let y = -t / (V::splat(2.0) + t);
    (-x).select_positive(-y, y)
}
