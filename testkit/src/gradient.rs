//! Is the backward function the derivative of the forward function?
//!
//! Two steps, because differencing `f32` mostly measures rounding:
//!
//! 1. the `f64` twin of a pair against central differences, tightly: [`check_pair`] (or [`check_kinked`] where the
//!    function has corners);
//! 2. the `f32` pair against the twin, loosely: [`check_f32_pair`] does this and the first step in one call.
//!
//! A pair is `forward(x, out)` and `backward(x, out_bar, x_bar)`, which **adds** `J^T out_bar` into `x_bar`. A function
//! of several inputs is checked once for each of them, or on their concatenation.
//!
//! ```
//! use testkit::gradient::{Tolerance, check_pair, cotangent};
//!
//! let forward = |x: &[f64], out: &mut [f64]| out[0] = x[0] * x[1].sin();
//! let backward = |x: &[f64], out_bar: &[f64], x_bar: &mut [f64]| {
//!     x_bar[0] += out_bar[0] * x[1].sin();
//!     x_bar[1] += out_bar[0] * x[0] * x[1].cos();
//! };
//! check_pair(&[0.3, 2.0], &cotangent(1, 0), forward, backward, Tolerance::TWIN).unwrap();
//! // A wrong sign is found.
//! let wrong = |x: &[f64], out_bar: &[f64], x_bar: &mut [f64]| x_bar[0] -= out_bar[0] * x[1].sin();
//! assert!(check_pair(&[0.3, 2.0], &cotangent(1, 0), forward, wrong, Tolerance::TWIN).is_err());
//! ```

use crate::golden::Number;
use std::fmt;

mod difference;
mod f32_pair;
mod kinked;
#[cfg(test)]
mod tests;

pub use difference::{central_difference, directional_difference, step};
pub use f32_pair::{PairTolerances, check_f32_pair};
pub use kinked::{Flips, check_kinked, check_with_flips};

/// An entry is right if `|got - want| <= absolute + relative * max|want|`, the maximum taken over the whole tensor: small
/// entries beside large ones carry the rounding of the large ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// In units of the largest entry.
    pub relative: f64,
    /// In units of the entries.
    pub absolute: f64,
}

impl Tolerance {
    /// An `f64` twin against central differences of step `1e-6`: they lose about ten of sixteen digits.
    pub const TWIN: Self = Self { relative: 1e-7, absolute: 1e-8 };
    /// `f32` code against its `f64` twin.
    pub const SINGLE: Self = Self { relative: 1e-4, absolute: 1e-6 };

    /// Both numbers.
    #[must_use]
    pub const fn new(relative: f64, absolute: f64) -> Self {
        Self { relative, absolute }
    }

    /// The bound for a tensor of these values. Infinite values do not count: they would allow everything.
    #[must_use]
    pub fn bound(self, want: &[f64]) -> f64 {
        let largest = want.iter().map(|w| w.abs()).filter(|w| w.is_finite()).fold(0.0, f64::max);
        self.absolute + self.relative * largest
    }
}

/// Why a check failed: the worst entry.
#[derive(Clone, Debug, PartialEq)]
pub struct Mismatch {
    /// What was compared with what.
    pub what: &'static str,
    /// The entry.
    pub index: usize,
    /// Its value.
    pub got: f64,
    /// The value it should have.
    pub want: f64,
    /// What `|got - want|` may be.
    pub bound: f64,
    /// How many entries are outside the bound.
    pub wrong: usize,
    /// Of how many.
    pub of: usize,
}

impl fmt::Display for Mismatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { what, index, got, want, bound, wrong, of } = self;
        let difference = (got - want).abs();
        write!(
            f,
            "{what}: [{index}]: got {got:e}, want {want:e}, difference {difference:.3e} > bound {bound:.3e} ({wrong} of {of} wrong)"
        )
    }
}

impl std::error::Error for Mismatch {}

/// Distance of two values: 0 for equal infinities, NaN where either is NaN.
fn distance(got: f64, want: f64) -> f64 {
    if got == want { 0.0 } else { (got - want).abs() }
}

/// Compare two tensors under the rule of [`Tolerance`]. NaN is never right, infinity only where infinity is wanted.
///
/// # Errors
/// The worst entry.
///
/// # Panics
/// If the lengths differ.
#[track_caller]
pub fn compare<G: Number, W: Number>(
    what: &'static str,
    got: &[G],
    want: &[W],
    tolerance: Tolerance,
) -> Result<(), Mismatch> {
    assert_eq!(got.len(), want.len(), "{what}: lengths differ");
    let want: Vec<f64> = want.iter().map(|w| w.to_f64()).collect();
    let bound = tolerance.bound(&want);
    let mut worst: Option<Mismatch> = None;
    for (index, (g, &want)) in got.iter().zip(&want).enumerate() {
        let got_value = g.to_f64();
        let d = distance(got_value, want);
        // A NaN distance is outside every bound and worse than everything.
        if d <= bound {
            continue;
        }
        let wrong = worst.as_ref().map_or(0, |w| w.wrong) + 1;
        let worse = worst.as_ref().is_none_or(|w| d.is_nan() || d > distance(w.got, w.want));
        let entry = match worst {
            Some(worst) if !worse => Mismatch { wrong, ..worst },
            _ => Mismatch { what, index, got: got_value, want, bound, wrong, of: got.len() },
        };
        worst = Some(entry);
    }
    worst.map_or(Ok(()), Err)
}

/// Reproducible cotangents in `[-2, 2]`, none of them near 0: `n` multiples of 1/64, so they are exact in `f32`.
#[must_use]
pub fn cotangent(n: usize, seed: u64) -> Vec<f64> {
    let value = |i: usize| {
        // SplitMix64, public domain: the state is a function of seed and index only.
        let mut z = seed.wrapping_add(i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        let size = (8 + z % 121) as f64 / 64.0;
        if z >> 63 == 0 { size } else { -size }
    };
    (0..n).map(value).collect()
}

/// Check a pair in `f64`: `backward` against central differences of `<out_bar, forward>` at `x`, and that it adds.
///
/// `out_bar` also says how many outputs there are; [`cotangent`] makes one. `forward` gets `out` filled with NaN, so an
/// output it forgets is seen.
///
/// # Errors
/// The worst entry of the gradient, or of the second run, whose `x_bar` starts at other values than 0.
pub fn check_pair(
    x: &[f64],
    out_bar: &[f64],
    mut forward: impl FnMut(&[f64], &mut [f64]),
    mut backward: impl FnMut(&[f64], &[f64], &mut [f64]),
    tolerance: Tolerance,
) -> Result<(), Mismatch> {
    let mut got = vec![0.0; x.len()];
    backward(x, out_bar, &mut got);
    let want = central_difference(x, weighted(out_bar, &mut forward));
    compare("backward against central differences", &got, &want, tolerance)?;
    check_adds(&got, |x_bar| backward(x, out_bar, x_bar))
}

/// Check the tangent rule `tangent(x, x_dot, out_dot)`, which writes `out_dot = J x_dot`, against central differences
/// along `x_dot`.
///
/// # Errors
/// The worst entry.
pub fn check_tangent(
    x: &[f64],
    x_dot: &[f64],
    outputs: usize,
    forward: impl FnMut(&[f64], &mut [f64]),
    mut tangent: impl FnMut(&[f64], &[f64], &mut [f64]),
    tolerance: Tolerance,
) -> Result<(), Mismatch> {
    let mut got = vec![f64::NAN; outputs];
    tangent(x, x_dot, &mut got);
    let want = directional_difference(x, x_dot, outputs, forward);
    compare("tangent against central differences", &got, &want, tolerance)
}

/// `<out_bar, forward(x)>` as a function of `x`. An output with cotangent 0 does not enter, whatever its value.
fn weighted<'a>(out_bar: &'a [f64], forward: &'a mut impl FnMut(&[f64], &mut [f64])) -> impl FnMut(&[f64]) -> f64 + 'a {
    let mut out = vec![0.0; out_bar.len()];
    move |x| {
        out.fill(f64::NAN);
        forward(x, &mut out);
        out.iter().zip(out_bar).filter(|(_, b)| **b != 0.0).map(|(o, b)| o * b).sum()
    }
}

/// Does `backward` add into `x_bar`? `fresh` is what it gives when `x_bar` starts at 0.
fn check_adds<T: Number + From<f32>>(fresh: &[T], mut backward: impl FnMut(&mut [T])) -> Result<(), Mismatch> {
    let scale = fresh.iter().map(|g| g.to_f64().abs()).filter(|g| g.is_finite()).fold(1.0, f64::max);
    // A power of two near the largest entry, where one rounding is the only difference.
    let start = scale.log2().ceil().exp2().min(1e30) as f32;
    let mut got: Vec<T> = fresh.iter().map(|_| T::from(start)).collect();
    backward(&mut got);
    let want: Vec<f64> = fresh.iter().map(|g| g.to_f64() + f64::from(start)).collect();
    // Loose: many small terms added to a large start each round. A backward that writes is off by all of the start.
    compare("backward must add into x_bar", &got, &want, Tolerance::new(1e-3, 0.0))
}
