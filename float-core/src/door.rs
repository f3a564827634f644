//! Float functions that `core` lacks, from `std` or `libm`.

macro_rules! float_fns {
    ($ty:ty; $($(#[$doc:meta])* $name:ident($($arg:ident),+) = $std:path, $libm:path;)+) => {$(
        $(#[$doc])*
        #[inline(always)]
        #[must_use]
        pub fn $name($($arg: $ty),+) -> $ty {
            #[cfg(feature = "libm")]
            return $libm($($arg),+);
            #[cfg(not(feature = "libm"))]
            return $std($($arg),+);
        }
    )+};
}

macro_rules! door {
    ($ty:ident; $($libm:ident),+) => { door!(@ $ty; $($libm)+); };
    (@ $ty:ident; $acos:ident $asin:ident $atan:ident $atan2:ident $cbrt:ident $ceil:ident $cos:ident $cosh:ident
       $exp:ident $exp2:ident $exp_m1:ident $floor:ident $hypot:ident $ln:ident $ln_1p:ident $log2:ident $log10:ident
       $mul_add:ident $powf:ident $rint:ident $sin:ident $sinh:ident $sqrt:ident $tan:ident $tanh:ident $trunc:ident) => {
        float_fns! { $ty;
            /// Arc cosine, radians in `[0, pi]`.
            acos(x) = $ty::acos, libm::$acos;
            /// Arc sine, radians.
            asin(x) = $ty::asin, libm::$asin;
            /// Arc tangent, radians.
            atan(x) = $ty::atan, libm::$atan;
            /// Angle of the point `(x, y)`: note the order `atan2(y, x)`.
            atan2(y, x) = $ty::atan2, libm::$atan2;
            /// Cube root.
            cbrt(x) = $ty::cbrt, libm::$cbrt;
            /// Round up.
            ceil(x) = $ty::ceil, libm::$ceil;
            /// Cosine of radians.
            cos(x) = $ty::cos, libm::$cos;
            /// Hyperbolic cosine.
            cosh(x) = $ty::cosh, libm::$cosh;
            /// `e^x`.
            exp(x) = $ty::exp, libm::$exp;
            /// `2^x`.
            exp2(x) = $ty::exp2, libm::$exp2;
            /// `e^x - 1`, exact to an ulp or two near zero.
            exp_m1(x) = $ty::exp_m1, libm::$exp_m1;
            /// Round down.
            floor(x) = $ty::floor, libm::$floor;
            /// `sqrt(x^2 + y^2)` without overflow in between.
            hypot(x, y) = $ty::hypot, libm::$hypot;
            /// Natural logarithm.
            ln(x) = $ty::ln, libm::$ln;
            /// `ln(1 + x)`, exact to an ulp or two near zero.
            ln_1p(x) = $ty::ln_1p, libm::$ln_1p;
            /// Logarithm to base 2.
            log2(x) = $ty::log2, libm::$log2;
            /// Logarithm to base 10.
            log10(x) = $ty::log10, libm::$log10;
            /// `x * y + z`, rounded once. Slow where the target has no fused instruction.
            mul_add(x, y, z) = $ty::mul_add, libm::$mul_add;
            /// `x^y`.
            powf(x, y) = $ty::powf, libm::$powf;
            /// Round to nearest, ties to even.
            round_ties_even(x) = $ty::round_ties_even, libm::$rint;
            /// Sine of radians.
            sin(x) = $ty::sin, libm::$sin;
            /// Hyperbolic sine.
            sinh(x) = $ty::sinh, libm::$sinh;
            /// Square root.
            sqrt(x) = $ty::sqrt, libm::$sqrt;
            /// Tangent of radians.
            tan(x) = $ty::tan, libm::$tan;
            /// Hyperbolic tangent.
            tanh(x) = $ty::tanh, libm::$tanh;
            /// Round towards zero.
            trunc(x) = $ty::trunc, libm::$trunc;
        }

        /// `(sin x, cos x)` of radians.
        #[inline(always)]
        #[must_use]
        pub fn sin_cos(x: $ty) -> ($ty, $ty) {
            (sin(x), cos(x))
        }

        /// `1 / (1 + e^-x)`, without overflow on either side.
        #[inline(always)]
        #[must_use]
        pub fn logistic(x: $ty) -> $ty {
            // exp of a non-positive number only: neither branch overflows.
            let e = exp(-x.abs());
            if x >= 0.0 { 1.0 / (1.0 + e) } else { e / (1.0 + e) }
        }

        /// `ln(1 + e^x)`, without overflow and with full digits for very negative `x`.
        #[inline(always)]
        #[must_use]
        pub fn softplus(x: $ty) -> $ty {
            x.max(0.0) + ln_1p(exp(-x.abs()))
        }

        /// `x^n` by squaring.
        #[inline]
        #[must_use]
        pub fn powi(x: $ty, n: i32) -> $ty {
            let (mut base, mut n, invert) = (x, n.unsigned_abs(), n < 0);
            let mut acc = 1.0;
            while n > 0 {
                if n & 1 == 1 {
                    acc *= base;
                }
                base *= base;
                n >>= 1;
            }
            if invert { 1.0 / acc } else { acc }
        }
    };
}

/// `f32` functions.
pub mod m32 {
    door!(f32; acosf, asinf, atanf, atan2f, cbrtf, ceilf, cosf, coshf, expf, exp2f, expm1f, floorf, hypotf, logf,
        log1pf, log2f, log10f, fmaf, powf, rintf, sinf, sinhf, sqrtf, tanf, tanhf, truncf);
}

/// `f64` functions.
pub mod m64 {
    door!(f64; acos, asin, atan, atan2, cbrt, ceil, cos, cosh, exp, exp2, expm1, floor, hypot, log, log1p, log2, log10,
        fma, pow, rint, sin, sinh, sqrt, tan, tanh, trunc);
}

#[cfg(test)]
mod tests {
    use super::{m32, m64};

    #[test]
    fn logistic_and_softplus_hold_at_extremes() {
        for x in [-1e30_f32, -200.0, -1.0, 0.0, 1.0, 200.0, 1e30] {
            assert!((0.0..=1.0).contains(&m32::logistic(x)));
            assert!(m32::softplus(x) >= x.max(0.0) && m32::softplus(x).is_finite());
        }
        assert_eq!(m32::logistic(0.0), 0.5);
        assert!((m64::softplus(-50.0) / m64::exp(-50.0) - 1.0).abs() < 1e-14);
    }

    #[test]
    fn powi_matches_repeated_multiplication() {
        assert_eq!(m64::powi(1.5, 5), 1.5 * 1.5 * 1.5 * 1.5 * 1.5);
        assert_eq!(m64::powi(2.0, -3), 0.125);
        assert_eq!(m32::powi(7.0, 0), 1.0);
    }
}
