//! Softplus.

use super::exp::exp_tail;
use super::polynomial::polynomial;
use crate::Vector;

/// `ln(1 + e^x) = max(x, 0) + ln(1 + e^-|x|)`, with full digits where it is small, down to 0 through the subnormal numbers.
/// Error at most 1.9 ulp (scalar level 2.3).
#[inline(always)]
pub fn softplus<V: Vector>(x: V) -> V {
    V::splat(0.0).max(x) + ln_1p_unit(exp_tail(-(x.max(-x))))
}

/// `ln(1 + e)` for `e` in `[0, 1]`: a minimax polynomial, relative error below `2^-30`, and no division.
#[inline(always)]
fn ln_1p_unit<V: Vector>(e: V) -> V {
    let p = polynomial(
        e,
        [
            0.002_084_633_8,
            -0.013_691_999,
            0.042_115_293,
            -0.083_239_28,
            0.124_795_41,
            -0.161_351_73,
            0.198_996_23,
            -0.249_888_64,
            0.333_327_14,
            -0.499_999_88,
        ],
    );
    (e * e).mul_add(p, e)
}
