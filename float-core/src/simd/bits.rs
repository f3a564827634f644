//! Steps on the bits of lanes that [`vecmath`](crate::vecmath) needs and kernels do not: each written once a level.
//!
//! Nothing here is fused, so every level gives the same bits.

use super::Scalar;

/// `1.5 * 2^52`: adding it rounds an `f64` to an integer, found in the low bits of the mantissa.
const ROUND: f64 = 6_755_399_441_055_744.0;
/// `pi / 2` in two parts. The first has 25 bits: its product with an integer below `2^28` is exact.
const HALF_PI: (f64, f64) = (1.570_796_310_901_641_8, 1.589_325_477_352_819_7e-8);

/// The bits of lanes. A supertrait of [`Vector`](super::Vector) that seals it.
pub trait Bits: Sized {
    /// `self * 2^n` for integral `n` in `[-150, 127]`, rounded once where the result is subnormal.
    fn scale_to_subnormal(self, n: Self) -> Self;
    /// `m` in `[1, 2)` and integral `n` with `self = m * 2^n`, for positive normal numbers.
    fn split_pow2(self) -> (Self, Self);
    /// `r` in `[-pi/4, pi/4]` and `quadrant` with `self = r + n * pi / 2`, for numbers up to `2^28`; the last two bits of
    /// `quadrant` are those of `n`. Reduced in `f64`, then rounded once.
    fn reduce_half_pi(self) -> (Self, Self);
    /// `(sin, cos)` turned by as many quarters as the last two bits of `quadrant` say.
    fn turn(quadrant: Self, sin: Self, cos: Self) -> (Self, Self);
    /// Whether every lane is below `limit`; NaN is not.
    fn all_below(self, limit: Self) -> bool;
    /// One bit for each lane, the first the lowest: set where it is above 0.
    fn positive(self) -> u32;
}

impl Bits for Scalar {
    #[inline(always)]
    fn scale_to_subnormal(self, n: Self) -> Self {
        Self(core::array::from_fn(|i| {
            let n = n.0[i] as i32;
            let power = |n: i32| f32::from_bits(((n + 127) as u32) << 23);
            // Half of it is a normal power, and so is the number times that: only the second product rounds.
            self.0[i] * power(n >> 1) * power(n - (n >> 1))
        }))
    }
    #[inline(always)]
    fn split_pow2(self) -> (Self, Self) {
        let bits = self.0.map(f32::to_bits);
        (
            Self(bits.map(|b| f32::from_bits(b & 0x007f_ffff | 0x3f80_0000))),
            Self(bits.map(|b| ((b >> 23) as i32 - 127) as f32)),
        )
    }
    #[inline(always)]
    fn reduce_half_pi(self) -> (Self, Self) {
        let x = self.0.map(f64::from);
        let shifted = x.map(|x| x * core::f64::consts::FRAC_2_PI + ROUND);
        let r = core::array::from_fn(|i| {
            let n = shifted[i] - ROUND;
            (x[i] - n * HALF_PI.0 - n * HALF_PI.1) as f32
        });
        (Self(r), Self(shifted.map(|s| f32::from_bits(s.to_bits() as u32))))
    }
    #[inline(always)]
    fn turn(quadrant: Self, sin: Self, cos: Self) -> (Self, Self) {
        let q = quadrant.0.map(f32::to_bits);
        let pick = |i: usize, even: &Self, odd: &Self| if q[i] & 1 == 1 { odd.0[i] } else { even.0[i] };
        // Negative sines in quadrants 2 and 3, negative cosines in 1 and 2.
        let flip = |x: f32, q: u32| f32::from_bits(x.to_bits() ^ (q & 2) << 30);
        (
            Self(core::array::from_fn(|i| flip(pick(i, &sin, &cos), q[i]))),
            Self(core::array::from_fn(|i| flip(pick(i, &cos, &sin), q[i].wrapping_add(1)))),
        )
    }
    #[inline(always)]
    fn all_below(self, limit: Self) -> bool {
        (0..8).fold(true, |all, i| all & (self.0[i] < limit.0[i]))
    }
    #[inline(always)]
    fn positive(self) -> u32 {
        (0..8).fold(0, |bits, i| bits | u32::from(self.0[i] > 0.0) << i)
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::super::x86::{Avx2, Avx512};
    use super::{Bits, HALF_PI, ROUND};
    use core::arch::x86_64::*;
    use core::f64::consts::FRAC_2_PI;

    /// `x - n pi / 2`, and `n` in the low bits of the mantissa.
    ///
    /// # Safety
    /// The CPU must have AVX2.
    #[inline(always)]
    unsafe fn reduce_4(x: __m128) -> (__m128, __m256d) {
        // SAFETY: the caller vouches for the instructions.
        unsafe {
            let (x, round) = (_mm256_cvtps_pd(x), _mm256_set1_pd(ROUND));
            let shifted = _mm256_add_pd(_mm256_mul_pd(x, _mm256_set1_pd(FRAC_2_PI)), round);
            let n = _mm256_sub_pd(shifted, round);
            let r = _mm256_sub_pd(x, _mm256_mul_pd(n, _mm256_set1_pd(HALF_PI.0)));
            let r = _mm256_sub_pd(r, _mm256_mul_pd(n, _mm256_set1_pd(HALF_PI.1)));
            (_mm256_cvtpd_ps(r), shifted)
        }
    }

    /// [`reduce_4`] for eight.
    ///
    /// # Safety
    /// The CPU must have AVX-512 F.
    #[inline(always)]
    unsafe fn reduce_8(x: __m256) -> (__m256, __m512d) {
        // SAFETY: the caller vouches for the instructions.
        unsafe {
            let (x, round) = (_mm512_cvtps_pd(x), _mm512_set1_pd(ROUND));
            let shifted = _mm512_add_pd(_mm512_mul_pd(x, _mm512_set1_pd(FRAC_2_PI)), round);
            let n = _mm512_sub_pd(shifted, round);
            let r = _mm512_sub_pd(x, _mm512_mul_pd(n, _mm512_set1_pd(HALF_PI.0)));
            let r = _mm512_sub_pd(r, _mm512_mul_pd(n, _mm512_set1_pd(HALF_PI.1)));
            (_mm512_cvtpd_ps(r), shifted)
        }
    }

    // SAFETY (all intrinsics below): the types exist only inside a `Task` run at their level, so the features are present.
    impl Bits for Avx2 {
        #[inline(always)]
        fn scale_to_subnormal(self, n: Self) -> Self {
            // SAFETY: see the head of this module.
            unsafe {
                let (n, bias) = (_mm256_cvtps_epi32(n.0), _mm256_set1_epi32(127));
                let half = _mm256_srai_epi32::<1>(n);
                let a = _mm256_slli_epi32::<23>(_mm256_add_epi32(half, bias));
                let b = _mm256_slli_epi32::<23>(_mm256_add_epi32(_mm256_sub_epi32(n, half), bias));
                let x = _mm256_mul_ps(self.0, _mm256_castsi256_ps(a));
                Self(_mm256_mul_ps(x, _mm256_castsi256_ps(b)))
            }
        }
        #[inline(always)]
        fn split_pow2(self) -> (Self, Self) {
            // SAFETY: see the head of this module.
            unsafe {
                let bits = _mm256_castps_si256(self.0);
                let m = _mm256_and_si256(bits, _mm256_set1_epi32(0x007f_ffff));
                let m = _mm256_or_si256(m, _mm256_set1_epi32(0x3f80_0000));
                let n = _mm256_sub_epi32(_mm256_srli_epi32::<23>(bits), _mm256_set1_epi32(127));
                (Self(_mm256_castsi256_ps(m)), Self(_mm256_cvtepi32_ps(n)))
            }
        }
        #[inline(always)]
        fn reduce_half_pi(self) -> (Self, Self) {
            // SAFETY: see the head of this module.
            unsafe {
                let (a, qa) = reduce_4(_mm256_castps256_ps128(self.0));
                let (b, qb) = reduce_4(_mm256_extractf128_ps::<1>(self.0));
                // Low words of both: pairs of `a` and `b` alternate after the shuffle.
                let q =
                    _mm256_castps_pd(_mm256_shuffle_ps::<0b10_00_10_00>(_mm256_castpd_ps(qa), _mm256_castpd_ps(qb)));
                let q = _mm256_castpd_ps(_mm256_permute4x64_pd::<0b11_01_10_00>(q));
                (Self(_mm256_set_m128(b, a)), Self(q))
            }
        }
        #[inline(always)]
        fn turn(quadrant: Self, sin: Self, cos: Self) -> (Self, Self) {
            // SAFETY: see the head of this module.
            unsafe {
                let q = _mm256_castps_si256(quadrant.0);
                let odd = _mm256_castsi256_ps(_mm256_slli_epi32::<31>(q));
                let sign = _mm256_set1_epi32(i32::MIN);
                let s_sign = _mm256_and_si256(_mm256_slli_epi32::<30>(q), sign);
                let next = _mm256_add_epi32(q, _mm256_set1_epi32(1));
                let c_sign = _mm256_and_si256(_mm256_slli_epi32::<30>(next), sign);
                (
                    Self(_mm256_xor_ps(_mm256_blendv_ps(sin.0, cos.0, odd), _mm256_castsi256_ps(s_sign))),
                    Self(_mm256_xor_ps(_mm256_blendv_ps(cos.0, sin.0, odd), _mm256_castsi256_ps(c_sign))),
                )
            }
        }
        #[inline(always)]
        fn all_below(self, limit: Self) -> bool {
            // SAFETY: see the head of this module.
            unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(self.0, limit.0)) == 0xff }
        }
        #[inline(always)]
        fn positive(self) -> u32 {
            // SAFETY: see the head of this module.
            unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(self.0, _mm256_setzero_ps())) as u32 }
        }
    }

    // SAFETY: as for AVX2.
    impl Bits for Avx512 {
        #[inline(always)]
        fn scale_to_subnormal(self, n: Self) -> Self {
            // SAFETY: see the head of this module.
            unsafe { Self(_mm512_scalef_ps(self.0, n.0)) }
        }
        #[inline(always)]
        fn split_pow2(self) -> (Self, Self) {
            // SAFETY: see the head of this module.
            unsafe {
                let m = _mm512_getmant_ps::<_MM_MANT_NORM_1_2, _MM_MANT_SIGN_ZERO>(self.0);
                (Self(m), Self(_mm512_getexp_ps(self.0)))
            }
        }
        #[inline(always)]
        fn reduce_half_pi(self) -> (Self, Self) {
            // SAFETY: see the head of this module.
            unsafe {
                let (a, qa) = reduce_8(_mm512_castps512_ps256(self.0));
                let (b, qb) = reduce_8(_mm512_extractf32x8_ps::<1>(self.0));
                let low = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
                let q = _mm512_permutex2var_epi32(_mm512_castpd_si512(qa), low, _mm512_castpd_si512(qb));
                (Self(_mm512_insertf32x8::<1>(_mm512_castps256_ps512(a), b)), Self(_mm512_castsi512_ps(q)))
            }
        }
        #[inline(always)]
        fn turn(quadrant: Self, sin: Self, cos: Self) -> (Self, Self) {
            // SAFETY: see the head of this module.
            unsafe {
                let q = _mm512_castps_si512(quadrant.0);
                let odd = _mm512_test_epi32_mask(q, _mm512_set1_epi32(1));
                let sign = _mm512_set1_epi32(i32::MIN);
                let s_sign = _mm512_and_si512(_mm512_slli_epi32::<30>(q), sign);
                let next = _mm512_add_epi32(q, _mm512_set1_epi32(1));
                let c_sign = _mm512_and_si512(_mm512_slli_epi32::<30>(next), sign);
                (
                    Self(_mm512_xor_ps(_mm512_mask_blend_ps(odd, sin.0, cos.0), _mm512_castsi512_ps(s_sign))),
                    Self(_mm512_xor_ps(_mm512_mask_blend_ps(odd, cos.0, sin.0), _mm512_castsi512_ps(c_sign))),
                )
            }
        }
        #[inline(always)]
        fn all_below(self, limit: Self) -> bool {
            // SAFETY: see the head of this module.
            unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, limit.0) == 0xffff }
        }
        #[inline(always)]
        fn positive(self) -> u32 {
            // SAFETY: see the head of this module.
            unsafe { u32::from(_mm512_cmp_ps_mask::<_CMP_GT_OQ>(self.0, _mm512_setzero_ps())) }
        }
    }
}
