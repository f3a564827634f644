//! Sine and cosine. Nothing is fused, and arguments are reduced in `f64`: every level gives the same bits.

use crate::{MAX_LANES, Vector, m64};

/// Up to here the vector reduction holds its error; beyond it, `f64` functions do the work, number by number.
const LARGE: f32 = 33_554_432.0;

/// Sine of radians; see [`sin_cos`].
#[inline(always)]
pub fn sin<V: Vector>(x: V) -> V {
    sin_cos(x).0
}

/// Cosine of radians; see [`sin_cos`].
#[inline(always)]
pub fn cos<V: Vector>(x: V) -> V {
    sin_cos(x).1
}

/// `(sin x, cos x)` of radians, for every argument; infinity gives NaN. Error at most 1.7 ulp.
///
/// Below `2^25` the argument is reduced to `[-pi/4, pi/4]` in `f64`, with `pi / 2` in two parts (Cody-Waite, 78 bits).
/// From there on the reduction would run out of digits: such lanes go through `f64` functions, about twenty times slower,
/// within half a unit in the last place. The other lanes keep the bits they have without them.
#[inline(always)]
pub fn sin_cos<V: Vector>(x: V) -> (V, V) {
    let (r, quadrant) = x.reduce_half_pi();
    let z = r * r;
    // Minimax polynomials, relative error below 2^-27 and 2^-32.
    let p = (V::splat(-1.951_809_5e-4) * z + V::splat(8.332_188e-3)) * z + V::splat(-1.666_665_5e-1);
    let q = (V::splat(2.443_232_7e-5) * z + V::splat(-1.388_731e-3)) * z + V::splat(4.166_664_6e-2);
    let sin = r + r * (z * p);
    let cos = V::splat(1.0) + z * (V::splat(-0.5) + z * q);
    let (sin, cos) = V::turn(quadrant, sin, cos);
    if x.max(-x).all_below(V::splat(LARGE)) { (sin, cos) } else { with_large(x, sin, cos) }
}

/// `(sin(pi x), cos(pi x))`, for every argument: the reduction is exact. Infinity gives NaN. Error at most 1.7 ulp.
#[inline(always)]
pub fn sin_cos_pi<V: Vector>(x: V) -> (V, V) {
    // Whole turns, then quarters: both differences are exact, and large numbers are even.
    let two = V::splat(2.0);
    let t = x - (x * V::splat(0.5)).round() * two;
    let quadrant = (t * two).round();
    let a = t * two - quadrant;
    let z = a * a;
    // In quarters; pi / 2 in two parts.
    let p = (V::splat(-4.603_732e-3) * z + V::splat(7.968_108e-2)) * z + V::splat(-6.459_636e-1);
    let q = (V::splat(8.944_864e-4) * z + V::splat(-2.085_559_6e-2)) * z + V::splat(2.536_685_5e-1);
    let sin = a * V::splat(core::f32::consts::FRAC_PI_2) + a * (V::splat(-4.371_139e-8) + z * p);
    let cos = V::splat(1.0) + z * (V::splat(-1.233_700_5) + z * q);
    // Adding 1.5 * 2^23 brings the integer to the end of the mantissa.
    V::turn(quadrant + V::splat(12_582_912.0), sin, cos)
}

#[inline(always)]
fn with_large<V: Vector>(x: V, sin: V, cos: V) -> (V, V) {
    let (mut at, mut s, mut c) = ([0.0; MAX_LANES], [0.0; MAX_LANES], [0.0; MAX_LANES]);
    x.store(&mut at);
    sin.store(&mut s);
    cos.store(&mut c);
    exact(&at, &mut s, &mut c);
    (V::load(&s), V::load(&c))
}

/// Replace the large ones.
#[cold]
#[inline(never)]
fn exact(x: &[f32; MAX_LANES], sin: &mut [f32; MAX_LANES], cos: &mut [f32; MAX_LANES]) {
    for i in 0..MAX_LANES {
        if x[i].abs() >= LARGE {
            let (s, c) = m64::sin_cos(f64::from(x[i]));
            (sin[i], cos[i]) = (s as f32, c as f32);
        }
    }
}
