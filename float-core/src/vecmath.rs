//! Vector `exp`, logistic and friends, over [`Vector`]. Fast versions of the door's functions, with measured errors.
//!
//! Largest error over the whole finite range, measured by the tests against `f64`, in units in the last place:
//! [`exp`] 2 (results below `1.2e-38` go to 0), [`exp_m1`] 2, [`exp_neg`] 2, [`logistic`] 4.

use crate::Vector;

/// Arguments are clamped here, so that the power of two stays a normal number.
const EXP_MAX: f32 = 88.0;
const EXP_MIN: f32 = -87.0;

/// `e^x`. Arguments are clamped to `[-87, 88]`: at most `1.65e38`, at least `1.6e-38`; never infinite.
#[inline(always)]
pub fn exp<V: Vector>(x: V) -> V {
    let x = V::splat(EXP_MIN).max(V::splat(EXP_MAX).min(x));
    let n = (x * V::splat(core::f32::consts::LOG2_E)).round();
    // Cody-Waite: ln 2 in two parts, so that r keeps its digits.
    let r = n.mul_add(V::splat(-0.693_359_4), x);
    let r = n.mul_add(V::splat(2.121_944_4e-4), r);
    let mut p = V::splat(1.987_569_1e-4);
    for c in [1.398_2e-3, 8.333_452e-3, 4.166_579_6e-2, 1.666_666_6e-1, 0.5] {
        p = p.mul_add(r, V::splat(c));
    }
    (p * r).mul_add(r, r + V::splat(1.0)).scale_by_pow2(n)
}

/// `1 / (1 + e^-x)`.
#[inline(always)]
pub fn logistic<V: Vector>(x: V) -> V {
    V::splat(1.0) / (V::splat(1.0) + exp(-x))
}

/// `e^x - 1`, with full digits near zero. Arguments are clamped to `[-87, 88]` (where the result is `-1` to the last
/// digit, and `1.65e38`); NaN counts as 88.
#[inline(always)]
pub fn exp_m1<V: Vector>(x: V) -> V {
    let x = V::splat(EXP_MIN).max(x.min(V::splat(EXP_MAX)));
    let n = (x * V::splat(core::f32::consts::LOG2_E)).round();
    let r = n.mul_add(V::splat(-0.693_359_4), x);
    let r = n.mul_add(V::splat(2.121_944_4e-4), r);
    let mut p = V::splat(1.987_569_1e-4);
    for c in [1.398_2e-3, 8.333_452e-3, 4.166_579_6e-2, 1.666_666_6e-1, 0.5] {
        p = p.mul_add(r, V::splat(c));
    }
    // e^x - 1 = 2^n (e^r - 1) + (2^n - 1): for n = 0, that is |x| < 0.35, nothing cancels.
    let p = (p * r).mul_add(r, r);
    let power = V::splat(1.0).scale_by_pow2(n);
    p.mul_add(power, power - V::splat(1.0))
}

/// `e^-x` for `x >= 0`, exactly 0 from `x = 87` on (also for `x = inf`); NaN gives 0.
#[inline(always)]
pub fn exp_neg<V: Vector>(x: V) -> V {
    (V::splat(-EXP_MIN) - x).select_positive(exp(-x), V::splat(0.0))
}
