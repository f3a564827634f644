//! Exponentials.

use super::polynomial::polynomial;
use crate::Vector;

/// Arguments are clamped here, so that the power of two stays a normal number.
const EXP_MAX: f32 = 88.0;
const EXP_MIN: f32 = -87.0;
/// `e^x` below this is less than half of the smallest subnormal number.
const TAIL_MIN: f32 = -104.0;

/// `(e^r - 1, n)` with `e^x = 2^n e^r`, `|r| < 0.35`.
#[inline(always)]
fn reduced<V: Vector>(x: V) -> (V, V) {
    let n = (x * V::splat(core::f32::consts::LOG2_E)).round();
    // Cody-Waite: ln 2 in two parts, so that r keeps its digits.
    let r = n.mul_add(V::splat(-0.693_359_4), x);
    let r = n.mul_add(V::splat(2.121_944_4e-4), r);
    // Minimax polynomial of the Cephes library.
    let p = polynomial(r, [1.987_569_1e-4, 1.398_2e-3, 8.333_452e-3, 4.166_579_6e-2, 1.666_666_6e-1, 0.5]);
    ((p * r).mul_add(r, r), n)
}

/// `e^x`. Arguments are clamped to `[-87, 88]`: at most `1.65e38`, at least `1.6e-38`; never infinite. Error at most 1.1 ulp.
#[inline(always)]
pub fn exp<V: Vector>(x: V) -> V {
    let (p, n) = reduced(V::splat(EXP_MIN).max(V::splat(EXP_MAX).min(x)));
    (p + V::splat(1.0)).scale_by_pow2(n)
}

/// `2^x`. Arguments are clamped to `[-126, 127]`: never infinite, no subnormal numbers. Error at most 2.2 ulp (scalar level 2.4). Two thirds of the time of
/// [`exp`]: nothing has to be reduced in two parts.
#[inline(always)]
pub fn exp2<V: Vector>(x: V) -> V {
    let x = V::splat(-126.0).max(V::splat(127.0).min(x));
    let n = x.round();
    // Least relative error on [-1/2, 1/2] among those that are 1 at 0: 9.2e-8 before rounding.
    #[expect(
        clippy::approx_constant,
        reason = "the best polynomial is not the series: ln 2 would be further off at the ends"
    )]
    let coefficients = [1.326_473_8e-3, 9.671_517e-3, 5.550_734e-2, 2.402_224_2e-1, 6.931_47e-1, 1.0];
    polynomial(x - n, coefficients).scale_by_pow2(n)
}

/// `e^x` for `x <= 0`, through the subnormal numbers down to 0.
#[inline(always)]
pub(super) fn exp_tail<V: Vector>(x: V) -> V {
    let (p, n) = reduced(V::splat(TAIL_MIN).max(x));
    (p + V::splat(1.0)).scale_to_subnormal(n)
}

/// `e^x - 1`, with full digits near zero. Arguments are clamped to `[-87, 88]` (where the result is `-1` to the last
/// digit, and `1.65e38`); NaN counts as 88. Error at most 1.6 ulp (scalar level 1.7).
#[inline(always)]
pub fn exp_m1<V: Vector>(x: V) -> V {
    exp_m1_within(V::splat(EXP_MIN).max(x.min(V::splat(EXP_MAX))))
}

/// `1 - e^-x` for `x >= 0`, with full digits near zero: [`exp_m1`] where NaN stays NaN. Error as there.
#[inline(always)]
pub fn one_minus_exp_neg<V: Vector>(x: V) -> V {
    -exp_m1_tail(-x)
}

/// [`exp_m1`] for `x <= 0`; NaN stays NaN.
#[inline(always)]
pub(super) fn exp_m1_tail<V: Vector>(x: V) -> V {
    exp_m1_within(V::splat(EXP_MIN).max(x))
}

#[inline(always)]
fn exp_m1_within<V: Vector>(x: V) -> V {
    let (p, n) = reduced(x);
    // e^x - 1 = 2^n (e^r - 1) + (2^n - 1): for n = 0, that is |x| < 0.35, nothing cancels.
    let power = V::splat(1.0).scale_by_pow2(n);
    p.mul_add(power, power - V::splat(1.0))
}

/// `e^-x` for `x >= 0`, exactly 0 from `x = 87` on (also for `x = inf`); NaN gives 0. Error at most 1.1 ulp.
#[inline(always)]
pub fn exp_neg<V: Vector>(x: V) -> V {
    (V::splat(-EXP_MIN) - x).select_positive(exp(-x), V::splat(0.0))
}
