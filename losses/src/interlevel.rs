//! Interlevel loss: a proposal's weights have to bound those that the final network finds.
//!
//! For an interval `i` of the final histogram `(s, w)`, the proposal `(s^, w^)` allows
//!
//! ```text
//! bound[i] = sum of w^[j] over the intervals j that touch i        loss[i] = max(0, w[i] - bound[i])^2 / (w[i] + eps)
//! ```
//!
//! Only the proposal learns from it: the final weights are constants.
//!
//! **Touching** is decided the same way everywhere: `j` touches `i` when `s^[j + 1] > s[i]` and `s^[j] <= s[i + 1]`. An interval that
//! begins exactly where `i` ends counts, one that ends exactly where `i` begins does not.
//!
//! Both sets are sorted, so the intervals that touch follow by a merge, their sums from prefix sums, and the gradient from
//! a difference array: linear time, sums in `f64`.
//!
//! The published code divides by rays **and** final intervals ([`Reduction::PerInterval`]), unlike for the distortion loss
//! ([`Reduction::PerRay`]).
//!
//! Source: Barron, Mildenhall, Verbin, Srinivasan, Hedman, "Mip-NeRF 360", 2022, eqs. 12 and 13.

use crate::{LossError, RayIntervals, Reduction, error::same};
use alloc::vec::Vec;

/// Added to a weight that divides: one ulp at 1.
pub const EPS: f64 = 1.0 / (1 << 23) as f64;

/// Two histograms of the same rays.
#[derive(Clone, Copy, Debug)]
pub struct Levels<'a> {
    /// Intervals of the final network.
    pub fine: RayIntervals<'a>,
    /// `[n]` their weights; constants.
    pub w: &'a [f32],
    /// Intervals of the proposal.
    pub proposal: RayIntervals<'a>,
    /// `[m]` their weights.
    pub w_proposal: &'a [f32],
}

/// Memory of a ray, kept from call to call: 16 bytes for each of its proposal's intervals.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    /// `[m + 1]` sums of the proposal's weights in front of each interval.
    prefix: Vec<f64>,
    /// `[m + 1]` gradient of an interval less that of the one before.
    difference: Vec<f64>,
}

/// What the proposal allows each final interval.
///
/// # Shapes and units
/// * `bound` `[n]` out, written
///
/// # Errors
/// [`LossError::Shape`] where lengths or numbers of rays disagree, [`LossError::Order`] where offsets decrease.
pub fn bounds(levels: Levels<'_>, bound: &mut [f32], scratch: &mut Scratch) -> Result<(), LossError> {
    levels.check()?;
    same("bound", levels.w.len(), bound.len())?;
    for r in 0..levels.fine.rays() {
        let bound = &mut bound[levels.fine.range(r)];
        levels.sweep(r, scratch, |i, allowed, _| {
            bound[i] = allowed as f32;
            0.0
        });
    }
    Ok(())
}

/// Backward twin of [`bounds`]: adds into `w_proposal_bar` `[m]`.
///
/// # Errors
/// As [`bounds`].
pub fn bounds_backward(
    levels: Levels<'_>,
    bound_bar: &[f32],
    w_proposal_bar: &mut [f32],
    scratch: &mut Scratch,
) -> Result<(), LossError> {
    levels.check()?;
    same("bound_bar", levels.w.len(), bound_bar.len())?;
    same("w_proposal_bar", levels.w_proposal.len(), w_proposal_bar.len())?;
    for r in 0..levels.fine.rays() {
        let bound_bar = &bound_bar[levels.fine.range(r)];
        levels.sweep(r, scratch, |i, _, _| f64::from(bound_bar[i]));
        levels.collect(r, scratch, w_proposal_bar);
    }
    Ok(())
}

/// Loss of each final interval: `loss` `[n]`, written.
///
/// # Errors
/// As [`bounds`].
pub fn per_interval(levels: Levels<'_>, loss: &mut [f32], scratch: &mut Scratch) -> Result<(), LossError> {
    levels.check()?;
    same("loss", levels.w.len(), loss.len())?;
    for r in 0..levels.fine.rays() {
        let loss = &mut loss[levels.fine.range(r)];
        levels.sweep(r, scratch, |i, allowed, w| {
            loss[i] = value(w, allowed) as f32;
            0.0
        });
    }
    Ok(())
}

/// Backward twin of [`per_interval`]: adds into `w_proposal_bar` `[m]`.
///
/// # Errors
/// As [`bounds`].
pub fn per_interval_backward(
    levels: Levels<'_>,
    loss_bar: &[f32],
    w_proposal_bar: &mut [f32],
    scratch: &mut Scratch,
) -> Result<(), LossError> {
    levels.check()?;
    same("loss_bar", levels.w.len(), loss_bar.len())?;
    same("w_proposal_bar", levels.w_proposal.len(), w_proposal_bar.len())?;
    for r in 0..levels.fine.rays() {
        let loss_bar = &loss_bar[levels.fine.range(r)];
        levels.sweep(r, scratch, |i, allowed, w| f64::from(loss_bar[i]) * derivative(w, allowed));
        levels.collect(r, scratch, w_proposal_bar);
    }
    Ok(())
}

/// Loss of a batch, reduced as said; 0 for no rays. Summed in `f64` in index order.
///
/// # Errors
/// As [`bounds`].
pub fn interlevel(levels: Levels<'_>, reduction: Reduction, scratch: &mut Scratch) -> Result<f64, LossError> {
    levels.check()?;
    let mut total = 0.0;
    for r in 0..levels.fine.rays() {
        levels.sweep(r, scratch, |_, allowed, w| {
            total += value(w, allowed);
            0.0
        });
    }
    Ok(total * reduction.factor(levels.fine.rays(), levels.w.len()))
}

/// Backward twin of [`interlevel`]: adds `loss_bar * d loss / d w_proposal` into `w_proposal_bar` `[m]`.
///
/// # Errors
/// As [`bounds`].
pub fn interlevel_backward(
    levels: Levels<'_>,
    reduction: Reduction,
    loss_bar: f64,
    w_proposal_bar: &mut [f32],
    scratch: &mut Scratch,
) -> Result<(), LossError> {
    levels.check()?;
    same("w_proposal_bar", levels.w_proposal.len(), w_proposal_bar.len())?;
    let factor = loss_bar * reduction.factor(levels.fine.rays(), levels.w.len());
    for r in 0..levels.fine.rays() {
        levels.sweep(r, scratch, |_, allowed, w| factor * derivative(w, allowed));
        levels.collect(r, scratch, w_proposal_bar);
    }
    Ok(())
}

/// Loss of one interval.
#[inline(always)]
fn value(w: f64, bound: f64) -> f64 {
    let missing = (w - bound).max(0.0);
    missing * missing / (w + EPS)
}

/// Its derivative with respect to the bound.
#[inline(always)]
fn derivative(w: f64, bound: f64) -> f64 {
    -2.0 * (w - bound).max(0.0) / (w + EPS)
}

impl Levels<'_> {
    fn check(&self) -> Result<(), LossError> {
        self.fine.check("w", self.w.len())?;
        self.proposal.check("w_proposal", self.w_proposal.len())?;
        same("proposal", self.fine.rays(), self.proposal.rays())
    }

    /// One ray: `each(i, bound, w)` for every final interval, in order; what it returns is the gradient of the bound.
    #[inline(always)]
    fn sweep(&self, r: usize, scratch: &mut Scratch, mut each: impl FnMut(usize, f64, f64) -> f64) {
        let (start, end) = self.fine.ends(r);
        let (p_start, p_end) = self.proposal.ends(r);
        let m = p_start.len();
        let Scratch { prefix, difference } = scratch;
        prefix.clear();
        prefix.push(0.0);
        let mut sum = 0.0;
        for &w in &self.w_proposal[self.proposal.range(r)] {
            sum += f64::from(w);
            prefix.push(sum);
        }
        difference.clear();
        difference.resize(m + 1, 0.0);
        let (mut low, mut high) = (0, 0);
        for (i, &w) in self.w[self.fine.range(r)].iter().enumerate() {
            while low < m && p_end[low] <= start[i] {
                low += 1;
            }
            while high < m && p_start[high] <= end[i] {
                high += 1;
            }
            let high = high.max(low);
            let bar = each(i, prefix[high] - prefix[low], f64::from(w));
            difference[low] += bar;
            difference[high] -= bar;
        }
    }

    /// Add up the gradients that [`sweep`](Self::sweep) left.
    fn collect(&self, r: usize, scratch: &Scratch, w_proposal_bar: &mut [f32]) {
        let mut bar = 0.0;
        for (out, change) in w_proposal_bar[self.proposal.range(r)].iter_mut().zip(&scratch.difference) {
            bar += change;
            *out += bar as f32;
        }
    }
}
