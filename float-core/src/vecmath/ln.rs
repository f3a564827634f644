//! Natural logarithm.

use super::polynomial::polynomial;
use crate::Vector;

/// `ln x`, subnormal numbers included; `-inf` at 0, NaN below. Error at most 0.9 ulp.
#[inline(always)]
pub fn ln<V: Vector>(x: V) -> V {
    // Subnormal numbers are made normal first.
    let tiny = V::splat(f32::MIN_POSITIVE) - x;
    let normal = tiny.select_positive(x * V::splat(16_777_216.0), x);
    let (m, n) = normal.split_pow2();
    // m in [sqrt(1/2), sqrt 2): near 1 the power is 0 and nothing cancels.
    let upper = m - V::splat(core::f32::consts::SQRT_2);
    let m = upper.select_positive(m * V::splat(0.5), m);
    let n = n + upper.select_positive(V::splat(1.0), V::splat(0.0));
    let n = n - tiny.select_positive(V::splat(24.0), V::splat(0.0));
    let f = m - V::splat(1.0);
    // Minimax: ln(1 + f) = f - f^2 / 2 + f^3 p, relative error below 2^-28.
    let p = polynomial(
        f,
        [
            0.053_509_347,
            -0.109_225_34,
            0.121_088_855,
            -0.125_496_33,
            0.142_096_37,
            -0.166_593_73,
            0.200_022_22,
            -0.250_001_67,
            0.333_333_13,
        ],
    );
    let f2 = f * f;
    // ln 2 in two parts; the product with the first is exact.
    let small = n.mul_add(V::splat(-2.121_944_4e-4), f2.mul_add(V::splat(-0.5), f2 * f * p));
    let y = n.mul_add(V::splat(0.693_359_4), f + small);
    let y = (x - V::splat(f32::MAX)).select_positive(x, y);
    // 0 gives -inf, NaN stays: both by this sum.
    let y = x.select_positive(y, x + V::splat(f32::NEG_INFINITY));
    (-x).select_positive(V::splat(f32::NAN), y)
}
