//! Sine and cosine of sixteen numbers, for frequency encodings.

use super::lattice::cell::{BLOCK, Lanes};
use float_core::m32;

/// `1.5 * 2^52`: adding it rounds an `f64` to an integer, found in the low bits of the mantissa.
const ROUND: f64 = 6_755_399_441_055_744.0;
/// Beyond this an `f32` no longer resolves a period, and `ROUND` loses quadrants; the float door does the work.
const LARGE: f32 = 1e12;

/// `(sin(k x), cos(k x))` with `quadrants = k * 2 / pi`. Error at most `1.5e-7`, absolute: the argument is reduced in
/// `f64`, so large ones are as exact as small ones.
#[inline(always)]
pub(super) fn sin_cos(x: &Lanes, quadrants: f64) -> (Lanes, Lanes) {
    let (mut s, mut c) = ([0.0; BLOCK], [0.0; BLOCK]);
    for i in 0..BLOCK {
        let t = f64::from(x[i]) * quadrants;
        let shifted = t + ROUND;
        let quadrant = shifted.to_bits() as u32;
        // In [-pi/4, pi/4].
        let a = (t - (shifted - ROUND)) as f32 * core::f32::consts::FRAC_PI_2;
        let a2 = a * a;
        // Minimax polynomials on that interval, of the Cephes library.
        let sin = a + a * a2 * ((-1.951_529_6e-4 * a2 + 8.332_161e-3) * a2 - 1.666_665_5e-1);
        let cos = 1.0 - 0.5 * a2 + a2 * a2 * ((2.443_315_7e-5 * a2 - 1.388_731_6e-3) * a2 + 4.166_664_6e-2);
        let odd = quadrant & 1 == 1;
        let (sin, cos) = (if odd { cos } else { sin }, if odd { sin } else { cos });
        // Negative sines in quadrants 2 and 3, negative cosines in 1 and 2.
        s[i] = f32::from_bits(sin.to_bits() ^ (quadrant & 2) << 30);
        c[i] = f32::from_bits(cos.to_bits() ^ (quadrant.wrapping_add(1) & 2) << 30);
    }
    if x.iter().any(|x| x.abs() * quadrants as f32 >= LARGE) {
        for i in (0..BLOCK).filter(|&i| x[i].abs() * quadrants as f32 >= LARGE) {
            let a = (f64::from(x[i]) * quadrants * core::f64::consts::FRAC_PI_2) as f32;
            (s[i], c[i]) = m32::sin_cos(a);
        }
    }
    (s, c)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sin_cos_is_within_its_error() {
        let mut worst = 0.0_f64;
        for (kappa, range) in
            [(1.0_f64, 10.0_f32), (1.0, 1e5), (core::f64::consts::PI, 4.0), (core::f64::consts::PI, 1e6)]
        {
            for k in 0..20_000 {
                let x = (k as f32 / 10_000.0 - 1.0) * range;
                let (s, c) = sin_cos(&[x; BLOCK], kappa * core::f64::consts::FRAC_2_PI);
                let want = f64::from(x) * kappa;
                worst = worst.max((f64::from(s[3]) - want.sin()).abs()).max((f64::from(c[3]) - want.cos()).abs());
            }
        }
        assert!(worst < 1.5e-7, "{worst:e}");
    }

    #[test]
    fn whole_turns_are_exact() {
        let (s, c) = sin_cos(&[3.0; BLOCK], 2.0);
        assert_eq!((s[0], c[0]), (0.0, -1.0));
        let (s, c) = sin_cos(&[-0.5; BLOCK], 2.0);
        assert_eq!((s[0], c[0]), (-1.0, 0.0));
    }

    #[test]
    fn extreme_arguments_stay_in_range_and_nan_stays_nan() {
        for x in [f32::MAX, f32::MIN, 1e12, 9.99e11, 1e20, 1e-42, -0.0] {
            let (s, c) = sin_cos(&[x; BLOCK], core::f64::consts::FRAC_2_PI);
            assert!(s[0].abs() <= 1.0 + 1e-6 && c[0].abs() <= 1.0 + 1e-6, "{x}: {} {}", s[0], c[0]);
        }
        for x in [f32::NAN, f32::INFINITY] {
            let (s, c) = sin_cos(&[x; BLOCK], 1.0);
            assert!(s[0].is_nan() && c[0].is_nan());
        }
    }
}
