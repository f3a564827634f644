//! The two float types, for functions that exist in both precisions.

use core::ops::{Add, AddAssign, Div, Mul, Neg, Sub};
use float_core::{m32, m64};

/// `f32` or `f64`.
pub trait Real:
    Copy
    + PartialOrd
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + sealed::Sealed
{
    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;
    /// 2.
    const TWO: Self;
    /// Infinity.
    const INFINITY: Self;
    /// Distance below 2 at which the inverse contraction stops: points further out than `1 / CONTRACT_GAP` don't come
    /// back. 1e-6 in `f32` (four ulps at 2), 1e-12 in `f64`.
    const CONTRACT_GAP: Self;
    /// Nearest number of this type.
    fn of(x: f64) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// `self^exponent`.
    fn powf(self, exponent: Self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// Larger one; the other where one is NaN.
    fn max(self, other: Self) -> Self;
    /// Smaller one; the other where one is NaN.
    fn min(self, other: Self) -> Self;
}

mod sealed {
    pub trait Sealed {}
    impl Sealed for f32 {}
    impl Sealed for f64 {}
}

macro_rules! real {
    ($ty:ident, $door:ident, $gap:literal) => {
        impl Real for $ty {
            const ZERO: Self = 0.0;
            const ONE: Self = 1.0;
            const TWO: Self = 2.0;
            const INFINITY: Self = $ty::INFINITY;
            const CONTRACT_GAP: Self = $gap;
            #[inline(always)]
            fn of(x: f64) -> Self {
                x as $ty
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                $door::sqrt(self)
            }
            #[inline(always)]
            fn powf(self, exponent: Self) -> Self {
                $door::powf(self, exponent)
            }
            #[inline(always)]
            fn abs(self) -> Self {
                $ty::abs(self)
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                $ty::max(self, other)
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                $ty::min(self, other)
            }
        }
    };
}
real!(f32, m32, 1e-6);
real!(f64, m64, 1e-12);

/// `a . b`
#[inline(always)]
pub(crate) fn dot<T: Real>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// `M x`, rows of `M` first.
#[inline(always)]
pub(crate) fn mat_vec<T: Real>(m: &[[T; 3]; 3], x: [T; 3]) -> [T; 3] {
    [dot(m[0], x), dot(m[1], x), dot(m[2], x)]
}

/// `M^T x`.
#[inline(always)]
pub(crate) fn mat_t_vec<T: Real>(m: &[[T; 3]; 3], x: [T; 3]) -> [T; 3] {
    core::array::from_fn(|j| m[0][j] * x[0] + m[1][j] * x[1] + m[2][j] * x[2])
}
