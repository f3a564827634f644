//! The SIMD token and the vector abstraction.
//!
//! A [`Simd`] value cannot be forged: its levels above scalar exist only after the CPU was asked. A kernel is a
//! [`Task`]; `Simd::run` compiles its body once for each level and picks the right one. Vector types are private, so
//! they are reachable only inside a `Task`, that is, only where the features they need are present.

mod bits;

use core::ops::{Add, Div, Mul, Neg, Sub};
use core::sync::atomic::{AtomicU8, Ordering};

/// Name of a level.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum SimdLevel {
    /// Plain Rust on arrays of 8; the compiler vectorises it as the target allows (NEON, SSE2).
    Scalar,
    /// 8 lanes, AVX2 and FMA.
    Avx2,
    /// 16 lanes, AVX-512 F, VL, DQ and BW.
    Avx512,
}

/// Proof that this CPU can run a level. Copy it into jobs and threads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Simd(SimdLevel);

/// A kernel written over [`Vector`]. Mark `run`, and what it calls, `#[inline(always)]`: only inlined code is compiled with the level's instructions.
pub trait Task {
    /// What the kernel returns.
    type Output;
    /// The body.
    fn run<V: Vector>(self) -> Self::Output;
}

/// What [`Simd::best`] goes up to.
static CAP: AtomicU8 = AtomicU8::new(u8::MAX);

impl Simd {
    /// The level every machine has.
    pub const SCALAR: Self = Self(SimdLevel::Scalar);

    /// Every level this CPU can run, slowest first: tests loop over it.
    pub fn available() -> impl Iterator<Item = Self> {
        #[cfg(all(feature = "std", target_arch = "x86_64"))]
        let has = [
            std::is_x86_feature_detected!("avx2") && std::is_x86_feature_detected!("fma"),
            // The functions of this level are compiled with AVX2 and FMA, too.
            std::is_x86_feature_detected!("avx2")
                && std::is_x86_feature_detected!("avx512f")
                && std::is_x86_feature_detected!("avx512vl")
                && std::is_x86_feature_detected!("avx512dq")
                && std::is_x86_feature_detected!("avx512bw")
                && std::is_x86_feature_detected!("fma"),
        ];
        #[cfg(not(all(feature = "std", target_arch = "x86_64")))]
        let has = [
            cfg!(all(target_arch = "x86_64", target_feature = "avx2", target_feature = "fma")),
            cfg!(all(
                target_arch = "x86_64",
                target_feature = "avx512f",
                target_feature = "avx512vl",
                target_feature = "avx512dq",
                target_feature = "avx512bw",
                target_feature = "avx2",
                target_feature = "fma"
            )),
        ];
        [(true, SimdLevel::Scalar), (has[0], SimdLevel::Avx2), (has[1], SimdLevel::Avx512)]
            .into_iter()
            .filter(|(available, _)| *available)
            .map(|(_, level)| Self(level))
    }

    /// The fastest level of this CPU, or the fastest that [`Simd::cap_best`] lets through.
    #[must_use]
    pub fn best() -> Self {
        let cap = CAP.load(Ordering::Relaxed);
        Self::available().filter(|simd| simd.0 as u8 <= cap).last().unwrap_or(Self::SCALAR)
    }

    /// Cap [`Simd::best`] at `level` for the whole process, to test programs that use it at each level. [`Simd::available`] does not
    /// change, and neither do tokens that exist.
    pub fn cap_best(level: SimdLevel) {
        CAP.store(level as u8, Ordering::Relaxed);
    }

    /// Which level this is.
    #[must_use]
    pub fn level(self) -> SimdLevel {
        self.0
    }

    /// Run a kernel at this level.
    #[inline]
    pub fn run<T: Task>(self, task: T) -> T::Output {
        match self.0 {
            // SAFETY: a level above scalar exists only after `available` saw its features.
            #[cfg(target_arch = "x86_64")]
            SimdLevel::Avx512 => unsafe { x86::run_avx512(task) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            SimdLevel::Avx2 => unsafe { x86::run_avx2(task) },
            _ => task.run::<Scalar>(),
        }
    }
}

/// Lanes of the widest [`Vector`].
pub const MAX_LANES: usize = 16;

/// `LANES` numbers worked on together. All operations are lane by lane; loads and stores of slices check their lengths
/// and panic on one shorter than `LANES`.
pub trait Vector:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + bits::Bits
{
    /// How many.
    const LANES: usize;
    /// All lanes `x`.
    fn splat(x: f32) -> Self;
    /// The first `LANES` numbers of `x`.
    ///
    /// # Panics
    /// Where `x` is shorter than `LANES`.
    fn load(x: &[f32]) -> Self;
    /// Write to the first `LANES` numbers of `out`.
    ///
    /// # Panics
    /// Where `out` is shorter than `LANES`.
    fn store(self, out: &mut [f32]);
    /// [`Vector::load`] without the length check, for inner loops whose bounds are checked once outside.
    ///
    /// # Safety
    /// `x` must be valid for reading `LANES` numbers; no alignment is needed.
    unsafe fn load_ptr(x: *const f32) -> Self;
    /// [`Vector::store`] without the length check.
    ///
    /// # Safety
    /// `out` must be valid for writing `LANES` numbers; no alignment is needed.
    unsafe fn store_ptr(self, out: *mut f32);
    /// `self * b + c`; fused where the level has it, two roundings at the scalar level.
    fn mul_add(self, b: Self, c: Self) -> Self;
    /// Smaller of each lane; the second operand where either is NaN.
    fn min(self, b: Self) -> Self;
    /// Larger of each lane; the second operand where either is NaN.
    fn max(self, b: Self) -> Self;
    /// Square root of each lane.
    fn sqrt(self) -> Self;
    /// Nearest integer, ties to even.
    fn round(self) -> Self;
    /// Round down.
    fn floor(self) -> Self;
    /// `a` where `self > 0`, else `b`.
    fn select_positive(self, a: Self, b: Self) -> Self;
    /// `self * 2^n` for integral `n` in `[-126, 127]`: builds the power from exponent bits.
    fn scale_by_pow2(self, n: Self) -> Self;
    /// `table[index[lane] * stride + offset]` for each lane, indices truncated from the integers in `index`.
    ///
    /// # Panics
    /// Where `index` is shorter than `LANES`, or an index is past the end; above the scalar level also past `i32::MAX`.
    fn gather(table: &[f32], index: &[u32]) -> Self;
    /// Sum of the lanes, in a fixed tree order.
    fn sum(self) -> f32;

    /// [`Vector::load`] of what may be shorter than a vector, such as the end of a row: the lanes past `x` are 0.
    #[inline(always)]
    fn load_part(x: &[f32]) -> Self {
        if x.len() >= Self::LANES {
            return Self::load(x);
        }
        let mut lanes = [0.0; MAX_LANES];
        lanes[..x.len()].copy_from_slice(x);
        Self::load(&lanes)
    }

    /// [`Vector::store`] to what may be shorter than a vector: the lanes past `out` are dropped.
    #[inline(always)]
    fn store_part(self, out: &mut [f32]) {
        if out.len() >= Self::LANES {
            return self.store(out);
        }
        let mut lanes = [0.0; MAX_LANES];
        self.store(&mut lanes);
        out.copy_from_slice(&lanes[..out.len()]);
    }
}

/// Plain arrays of eight.
#[derive(Clone, Copy)]
struct Scalar([f32; 8]);

macro_rules! lane_ops {
    ($($trait:ident $name:ident $op:tt;)+) => {$(
        impl $trait for Scalar {
            type Output = Self;
            #[inline(always)]
            fn $name(self, b: Self) -> Self {
                Self(core::array::from_fn(|i| self.0[i] $op b.0[i]))
            }
        }
    )+};
}
lane_ops! { Add add +; Sub sub -; Mul mul *; Div div /; }

impl Neg for Scalar {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(self.0.map(|x| -x))
    }
}

impl Vector for Scalar {
    const LANES: usize = 8;
    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self([x; 8])
    }
    #[inline(always)]
    fn load(x: &[f32]) -> Self {
        Self(core::array::from_fn(|i| x[..8][i]))
    }
    #[inline(always)]
    fn store(self, out: &mut [f32]) {
        out[..8].copy_from_slice(&self.0);
    }
    #[inline(always)]
    unsafe fn load_ptr(x: *const f32) -> Self {
        // SAFETY: the caller vouches for `LANES` readable numbers; `[f32; 8]` is read unaligned.
        Self(unsafe { x.cast::<[f32; 8]>().read_unaligned() })
    }
    #[inline(always)]
    unsafe fn store_ptr(self, out: *mut f32) {
        // SAFETY: the caller vouches for `LANES` writable numbers.
        unsafe { out.cast::<[f32; 8]>().write_unaligned(self.0) }
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        self * b + c
    }
    #[inline(always)]
    fn min(self, b: Self) -> Self {
        Self(core::array::from_fn(|i| if self.0[i] < b.0[i] { self.0[i] } else { b.0[i] }))
    }
    #[inline(always)]
    fn max(self, b: Self) -> Self {
        Self(core::array::from_fn(|i| if self.0[i] > b.0[i] { self.0[i] } else { b.0[i] }))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.map(crate::m32::sqrt))
    }
    #[inline(always)]
    fn round(self) -> Self {
        Self(self.0.map(crate::m32::round_ties_even))
    }
    #[inline(always)]
    fn floor(self) -> Self {
        Self(self.0.map(crate::m32::floor))
    }
    #[inline(always)]
    fn select_positive(self, a: Self, b: Self) -> Self {
        Self(core::array::from_fn(|i| if self.0[i] > 0.0 { a.0[i] } else { b.0[i] }))
    }
    #[inline(always)]
    fn scale_by_pow2(self, n: Self) -> Self {
        Self(core::array::from_fn(|i| self.0[i] * f32::from_bits(((n.0[i] as i32 + 127) as u32) << 23)))
    }
    #[inline(always)]
    fn gather(table: &[f32], index: &[u32]) -> Self {
        Self(core::array::from_fn(|i| table[index[..8][i] as usize]))
    }
    #[inline(always)]
    fn sum(self) -> f32 {
        let a: [f32; 4] = core::array::from_fn(|i| self.0[i] + self.0[i + 4]);
        (a[0] + a[2]) + (a[1] + a[3])
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{Task, Vector};
    use core::arch::x86_64::*;
    use core::ops::{Add, Div, Mul, Neg, Sub};

    /// # Safety
    /// The CPU must have AVX2 and FMA.
    #[target_feature(enable = "avx2,fma")]
    pub(super) unsafe fn run_avx2<T: Task>(task: T) -> T::Output {
        task.run::<Avx2>()
    }

    /// # Safety
    /// The CPU must have AVX-512 F, VL, DQ, BW and FMA.
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma")]
    pub(super) unsafe fn run_avx512<T: Task>(task: T) -> T::Output {
        task.run::<Avx512>()
    }

    #[derive(Clone, Copy)]
    pub(super) struct Avx2(pub(super) __m256);
    #[derive(Clone, Copy)]
    pub(super) struct Avx512(pub(super) __m512);

    // SAFETY (all intrinsics below): the types are private and handed out only as the type parameter of a `Task` that
    // `run_avx2` / `run_avx512` runs, so the features are present; loads and stores go through slices of checked length.
    macro_rules! vector {
        ($ty:ident, $reg:ty, $lanes:literal, $add:ident $sub:ident $mul:ident $div:ident $xor:expr, $set1:ident $loadu:ident $storeu:ident $fma:ident
         $min:ident $max:ident $sqrt:ident, $round:expr, $floor:expr, $select:expr, $pow2:expr, $gather:expr, $sum:expr) => {
            impl Add for $ty {
                type Output = Self;
                #[inline(always)]
                fn add(self, b: Self) -> Self {
                    // SAFETY: see the head of this macro.
                    unsafe { Self($add(self.0, b.0)) }
                }
            }
            impl Sub for $ty {
                type Output = Self;
                #[inline(always)]
                fn sub(self, b: Self) -> Self {
                    // SAFETY: see the head of this macro.
                    unsafe { Self($sub(self.0, b.0)) }
                }
            }
            impl Mul for $ty {
                type Output = Self;
                #[inline(always)]
                fn mul(self, b: Self) -> Self {
                    // SAFETY: see the head of this macro.
                    unsafe { Self($mul(self.0, b.0)) }
                }
            }
            impl Div for $ty {
                type Output = Self;
                #[inline(always)]
                fn div(self, b: Self) -> Self {
                    // SAFETY: see the head of this macro.
                    unsafe { Self($div(self.0, b.0)) }
                }
            }
            impl Neg for $ty {
                type Output = Self;
                #[inline(always)]
                fn neg(self) -> Self {
                    let flip: fn($reg) -> $reg = $xor;
                    Self(flip(self.0))
                }
            }
            impl Vector for $ty {
                const LANES: usize = $lanes;
                #[inline(always)]
                fn splat(x: f32) -> Self {
                    // SAFETY: see the head of this macro.
                    unsafe { Self($set1(x)) }
                }
                #[inline(always)]
                fn load(x: &[f32]) -> Self {
                    let x = &x[..$lanes];
                    // SAFETY: `x` holds `LANES` numbers; the load needs no alignment.
                    unsafe { Self($loadu(x.as_ptr())) }
                }
                #[inline(always)]
                fn store(self, out: &mut [f32]) {
                    let out = &mut out[..$lanes];
                    // SAFETY: `out` holds `LANES` numbers; the store needs no alignment.
                    unsafe { $storeu(out.as_mut_ptr(), self.0) }
                }
                #[inline(always)]
                unsafe fn load_ptr(x: *const f32) -> Self {
                    // SAFETY: the caller vouches for `LANES` readable numbers.
                    unsafe { Self($loadu(x)) }
                }
                #[inline(always)]
                unsafe fn store_ptr(self, out: *mut f32) {
                    // SAFETY: the caller vouches for `LANES` writable numbers.
                    unsafe { $storeu(out, self.0) }
                }
                #[inline(always)]
                fn mul_add(self, b: Self, c: Self) -> Self {
                    // SAFETY: see the head of this macro.
                    unsafe { Self($fma(self.0, b.0, c.0)) }
                }
                #[inline(always)]
                fn min(self, b: Self) -> Self {
                    // SAFETY: see the head of this macro.
                    unsafe { Self($min(self.0, b.0)) }
                }
                #[inline(always)]
                fn max(self, b: Self) -> Self {
                    // SAFETY: see the head of this macro.
                    unsafe { Self($max(self.0, b.0)) }
                }
                #[inline(always)]
                fn sqrt(self) -> Self {
                    // SAFETY: see the head of this macro.
                    unsafe { Self($sqrt(self.0)) }
                }
                #[inline(always)]
                fn round(self) -> Self {
                    let f: fn($reg) -> $reg = $round;
                    Self(f(self.0))
                }
                #[inline(always)]
                fn floor(self) -> Self {
                    let f: fn($reg) -> $reg = $floor;
                    Self(f(self.0))
                }
                #[inline(always)]
                fn select_positive(self, a: Self, b: Self) -> Self {
                    let f: fn($reg, $reg, $reg) -> $reg = $select;
                    Self(f(self.0, a.0, b.0))
                }
                #[inline(always)]
                fn scale_by_pow2(self, n: Self) -> Self {
                    let f: fn($reg, $reg) -> $reg = $pow2;
                    Self(f(self.0, n.0))
                }
                #[inline(always)]
                fn gather(table: &[f32], index: &[u32]) -> Self {
                    let index = &index[..$lanes];
                    let last = index.iter().fold(0, |m, &i| m.max(i));
                    assert!((last as usize) < table.len() && last <= i32::MAX as u32, "gather past the end");
                    let f: fn(&[f32], &[u32]) -> $reg = $gather;
                    Self(f(table, index))
                }
                #[inline(always)]
                fn sum(self) -> f32 {
                    let f: fn($reg) -> f32 = $sum;
                    f(self.0)
                }
            }
        };
    }

    vector!(
        Avx2, __m256, 8,
        _mm256_add_ps _mm256_sub_ps _mm256_mul_ps _mm256_div_ps
        // SAFETY: see the head of the macro.
        |x| unsafe { _mm256_xor_ps(x, _mm256_set1_ps(-0.0)) },
        _mm256_set1_ps _mm256_loadu_ps _mm256_storeu_ps _mm256_fmadd_ps _mm256_min_ps _mm256_max_ps _mm256_sqrt_ps,
        // SAFETY: see the head of the macro.
        |x| unsafe { _mm256_round_ps::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(x) },
        // SAFETY: see the head of the macro.
        |x| unsafe { _mm256_floor_ps(x) },
        // SAFETY: see the head of the macro.
        |x, a, b| unsafe { _mm256_blendv_ps(b, a, _mm256_cmp_ps::<_CMP_GT_OQ>(x, _mm256_setzero_ps())) },
        // SAFETY: see the head of the macro.
        |x, n| unsafe {
            let bits = _mm256_slli_epi32::<23>(_mm256_add_epi32(_mm256_cvtps_epi32(n), _mm256_set1_epi32(127)));
            _mm256_mul_ps(x, _mm256_castsi256_ps(bits))
        },
        // SAFETY: `Vector::gather` has checked every index against the table.
        |table, index| unsafe {
            _mm256_i32gather_ps::<4>(table.as_ptr(), _mm256_loadu_si256(index.as_ptr().cast()))
        },
        // SAFETY: see the head of the macro.
        |x| unsafe {
            let a = _mm_add_ps(_mm256_castps256_ps128(x), _mm256_extractf128_ps::<1>(x));
            let b = _mm_add_ps(a, _mm_movehl_ps(a, a));
            _mm_cvtss_f32(_mm_add_ss(b, _mm_shuffle_ps::<1>(b, b)))
        }
    );

    vector!(
        Avx512, __m512, 16,
        _mm512_add_ps _mm512_sub_ps _mm512_mul_ps _mm512_div_ps
        // SAFETY: see the head of the macro.
        |x| unsafe { _mm512_xor_ps(x, _mm512_set1_ps(-0.0)) },
        _mm512_set1_ps _mm512_loadu_ps _mm512_storeu_ps _mm512_fmadd_ps _mm512_min_ps _mm512_max_ps _mm512_sqrt_ps,
        // SAFETY: see the head of the macro.
        |x| unsafe { _mm512_roundscale_ps::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(x) },
        // SAFETY: see the head of the macro.
        |x| unsafe { _mm512_roundscale_ps::<{ _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC }>(x) },
        // SAFETY: see the head of the macro.
        |x, a, b| unsafe { _mm512_mask_blend_ps(_mm512_cmp_ps_mask::<_CMP_GT_OQ>(x, _mm512_setzero_ps()), b, a) },
        // SAFETY: see the head of the macro.
        |x, n| unsafe { _mm512_scalef_ps(x, n) },
        // SAFETY: `Vector::gather` has checked every index against the table.
        |table, index| unsafe {
            _mm512_i32gather_ps::<4>(_mm512_loadu_si512(index.as_ptr().cast()), table.as_ptr())
        },
        // SAFETY: see the head of the macro.
        |x| unsafe { _mm512_reduce_add_ps(x) }
    );
}
