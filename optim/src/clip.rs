//! Clipping of gradients.
//!
//! The order: [`sanitise`], [`clip_by_value`] if wanted, [`clip_by_global_norm`] for each network. (A NaN would make
//! the norm NaN and cost the whole step, therefore sanitising comes first.)

use crate::CHUNK;
use alloc::vec::Vec;
use float_core::{Simd, Task, Vector, m64};

/// Added to the norm before dividing by it.
const NORM_EPS: f64 = 1e-6;

/// Replace NaN and infinite entries by 0. Returns how many there were.
pub fn sanitise(simd: Simd, grad: &mut [f32]) -> usize {
    for_chunks(grad, |chunk| simd.run(Sanitise(chunk)))
}

/// Limit every entry to `[-limit, limit]`. NaN stays NaN.
///
/// # Panics
/// If `limit` is negative or NaN.
pub fn clip_by_value(simd: Simd, limit: f32, grad: &mut [f32]) {
    assert!(limit >= 0.0, "clip_by_value: limit {limit}");
    for_chunks(grad, |chunk| simd.run(Clamp(chunk, limit)));
}

/// Result of [`clip_by_global_norm`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clipped {
    /// Norm before clipping.
    pub norm: f64,
    /// Factor of every entry, in `[0, 1]`.
    pub factor: f64,
}

/// Euclidean norm over all slices together, summed in `f64`: no overflow for any finite gradient. NaN or infinite if an
/// entry is.
#[must_use]
pub fn global_norm<'a>(simd: Simd, grads: impl IntoIterator<Item = &'a [f32]>) -> f64 {
    let sum = |grad: &[f32]| {
        #[cfg(feature = "rayon")]
        let parts: Vec<f64> = {
            use rayon::prelude::*;
            grad.par_chunks(CHUNK).map(|chunk| simd.run(SumOfSquares(chunk))).collect()
        };
        #[cfg(not(feature = "rayon"))]
        let parts: Vec<f64> = grad.chunks(CHUNK).map(|chunk| simd.run(SumOfSquares(chunk))).collect();
        parts.iter().sum::<f64>()
    };
    m64::sqrt(grads.into_iter().map(sum).sum())
}

/// Multiply all slices by `min(1, max_norm / (norm + 1e-6))`, the norm taken over all of them together.
///
/// Where the norm is not finite nothing is changed and the factor is 1: [`sanitise`] first.
///
/// # Panics
/// If `max_norm` is negative or NaN.
pub fn clip_by_global_norm(simd: Simd, max_norm: f64, grads: &mut [&mut [f32]]) -> Clipped {
    assert!(max_norm >= 0.0, "clip_by_global_norm: limit {max_norm}");
    let norm = global_norm(simd, grads.iter().map(|g| &**g));
    let factor = if norm.is_finite() { (max_norm / (norm + NORM_EPS)).min(1.0) } else { 1.0 };
    if factor < 1.0 {
        for grad in grads {
            for_chunks(grad, |chunk| simd.run(Scale(chunk, factor)));
        }
    }
    Clipped { norm, factor }
}

/// Run over fixed chunks, in parallel where the feature is on, and add up the results.
#[cfg(feature = "rayon")]
fn for_chunks(grad: &mut [f32], work: impl Fn(&mut [f32]) -> usize + Sync + Send) -> usize {
    use rayon::prelude::*;
    grad.par_chunks_mut(CHUNK).map(work).sum()
}

/// Run over fixed chunks and add up the results.
#[cfg(not(feature = "rayon"))]
fn for_chunks(grad: &mut [f32], work: impl Fn(&mut [f32]) -> usize) -> usize {
    grad.chunks_mut(CHUNK).map(work).sum()
}

// The bodies below are plain loops: `Simd::run` compiles them for each level and the compiler vectorises them.

struct Sanitise<'a>(&'a mut [f32]);
impl Task for Sanitise<'_> {
    type Output = usize;
    #[inline(always)]
    fn run<V: Vector>(self) -> usize {
        let mut count = 0;
        for g in self.0 {
            let finite = g.is_finite();
            count += u32::from(!finite);
            *g = if finite { *g } else { 0.0 };
        }
        count as usize
    }
}

struct Clamp<'a>(&'a mut [f32], f32);
impl Task for Clamp<'_> {
    type Output = usize;
    #[inline(always)]
    fn run<V: Vector>(self) -> usize {
        for g in self.0 {
            *g = g.clamp(-self.1, self.1);
        }
        0
    }
}

struct Scale<'a>(&'a mut [f32], f64);
impl Task for Scale<'_> {
    type Output = usize;
    #[inline(always)]
    fn run<V: Vector>(self) -> usize {
        for g in self.0 {
            *g = (f64::from(*g) * self.1) as f32;
        }
        0
    }
}

/// Sixteen running sums folded in one order, so that every level gives the same bits.
struct SumOfSquares<'a>(&'a [f32]);
impl Task for SumOfSquares<'_> {
    type Output = f64;
    #[inline(always)]
    fn run<V: Vector>(self) -> f64 {
        let (body, tail) = self.0.as_chunks::<16>();
        let mut sums = [0.0_f64; 16];
        for x in body {
            for (sum, x) in sums.iter_mut().zip(x) {
                *sum += f64::from(*x) * f64::from(*x);
            }
        }
        for (sum, x) in sums.iter_mut().zip(tail) {
            *sum += f64::from(*x) * f64::from(*x);
        }
        let mut width = 8;
        while width > 0 {
            for i in 0..width {
                sums[i] += sums[i + width];
            }
            width /= 2;
        }
        sums[0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::vec;

    fn levels() -> impl Iterator<Item = Simd> {
        Simd::available()
    }

    #[test]
    fn sanitise_replaces_and_counts() {
        for simd in levels() {
            for n in (0..=70).chain([CHUNK - 1, CHUNK + 5]) {
                let mut grad: Vec<f32> = (0..n).map(|i| i as f32 - 30.0).collect();
                let bad = [(0, f32::NAN), (16, f32::INFINITY), (n.wrapping_sub(1), f32::NEG_INFINITY)];
                let mut want = grad.clone();
                for (i, value) in bad {
                    if i < n {
                        (grad[i], want[i]) = (value, 0.0);
                    }
                }
                let count = grad.iter().filter(|g| !g.is_finite()).count();
                assert_eq!(sanitise(simd, &mut grad), count, "n = {n}");
                assert_eq!(grad, want);
                assert_eq!(sanitise(simd, &mut grad), 0);
            }
        }
    }

    #[test]
    fn sanitise_keeps_every_finite_value() {
        let mut grad = [f32::MAX, f32::MIN, -0.0, 1e-45, 0.0, 1.0];
        let before = grad.map(f32::to_bits);
        assert_eq!(sanitise(Simd::best(), &mut grad), 0);
        assert_eq!(grad.map(f32::to_bits), before);
    }

    #[test]
    fn norm_holds_at_extremes() {
        for simd in levels() {
            assert_eq!(global_norm(simd, []), 0.0);
            assert_eq!(global_norm(simd, [&[] as &[f32]]), 0.0);
            assert_eq!(global_norm(simd, [&[3.0_f32] as &[f32], &[4.0]]), 5.0);
            let huge = global_norm(simd, [&[f32::MAX; 4] as &[f32]]);
            assert!((huge / (2.0 * f64::from(f32::MAX)) - 1.0).abs() < 1e-15);
            let tiny = global_norm(simd, [&[1e-45_f32; 16] as &[f32]]);
            assert!((tiny / (4.0 * f64::from(1e-45_f32)) - 1.0).abs() < 1e-15);
            assert!(global_norm(simd, [&[1.0, f32::NAN] as &[f32]]).is_nan());
        }
    }

    #[test]
    fn clipping_by_norm_keeps_direction_and_reaches_the_norm() {
        for simd in levels() {
            let (mut a, mut b) = (vec![3.0_f32; 40], vec![-4.0_f32; 7]);
            let clipped = clip_by_global_norm(simd, 0.5, &mut [&mut a, &mut b]);
            let after = global_norm(simd, [&a[..], &b[..]]);
            assert!((after - 0.5).abs() < 1e-6, "{after}");
            assert!((a[0] / b[0] + 0.75).abs() < 1e-6 && clipped.factor < 1.0);
            let untouched = clip_by_global_norm(simd, 10.0, &mut [&mut a, &mut b]);
            assert_eq!(untouched.factor, 1.0);
        }
    }

    #[test]
    fn a_norm_that_is_not_finite_changes_nothing() {
        let mut a = [1.0, f32::INFINITY];
        let clipped = clip_by_global_norm(Simd::best(), 0.1, &mut [&mut a]);
        assert_eq!((a, clipped.factor), ([1.0, f32::INFINITY], 1.0));
    }

    #[test]
    fn clipping_to_nothing_gives_zero() {
        let mut a = [1.0_f32, -2.0];
        assert_eq!(clip_by_global_norm(Simd::best(), 0.0, &mut [&mut a]).factor, 0.0);
        assert_eq!(a, [0.0, 0.0]);
        let mut b = [1.0_f32, -2.0, f32::NAN, f32::INFINITY];
        clip_by_value(Simd::best(), 1.5, &mut b);
        assert_eq!(b[..2], [1.0, -1.5]);
        assert!(b[2].is_nan() && b[3] == 1.5);
    }

    #[test]
    fn levels_agree_bit_for_bit() {
        let grad: Vec<f32> = (0..CHUNK * 2 + 77).map(|i| ((i * 7919) % 1013) as f32 * 1e-3 - 0.5).collect();
        let want = global_norm(Simd::SCALAR, [&grad[..]]);
        let naive = m64::sqrt(grad.iter().map(|g| f64::from(*g) * f64::from(*g)).sum());
        assert!((want / naive - 1.0).abs() < 1e-12);
        assert!(levels().all(|simd| global_norm(simd, [&grad[..]]).to_bits() == want.to_bits()));
    }
}
