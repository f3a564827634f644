//! Scene flow: where the samples of a ray are one frame later, and one frame earlier.
//!
//! Letters: `S` scene flow of a sample, its position in another frame minus its position in this one; `x` the sample. Scene flow is
//! `[rows][n]`, usually three rows, for `n` samples of all rays.
//!
//! | term | function | of each sample |
//! | --- | --- | --- |
//! | cycle | [`cycle`] | `w abs(S_next(x) + S_back(x + S_next))`: there and back again |
//! | minimal | [`variation::magnitude`](crate::variation::magnitude) | `abs(S)`: little motion |
//! | temporal | [`temporal`] | `(S_next + S_previous)^2`: the second difference of the sample's path, its acceleration |
//! | spatial | [`spatial`] | `abs(S_k - S_(k + 1))` of neighbours on a ray |
//!
//! The cycle without weights is [`variation::acceleration`](crate::variation::acceleration) of the two flows. Temporal and spatial
//! terms look at the [`Near`] samples only: in normalised device coordinates the last ones are at infinity. They are meant for flow in
//! the world (`x + S` and `x` both taken there, then subtracted), the others for flow in the coordinates of the field.
//!
//! All are sums, so that a batch can be cut into tiles: the caller divides by what he counts, [`Near::samples`] or [`Near::pairs`]
//! times the rows. Sums are `f64` in index order. Values are not scanned: NaN in gives NaN out. The kernel must be one of the
//! difference of two numbers, that is, any but the log-squared.
//!
//! Source: Li et al., "Neural scene flow fields", 2021, section 3.2 and released code (cycle L1 times `1 - p` of the disocclusion `p`;
//! spatial L1 over 95 % of the samples; temporal half the square over 90 %). Gao et al., "Dynamic view synthesis from dynamic monocular
//! video", 2021, eq. 10-13 (the paper squares the cycle, its released code takes L1).

use crate::variation::check;
use crate::{LossError, error::same, kernel::Kernel};
use core::ops::Range;

/// Share of a ray's samples that NSFF and DynamicNeRF compare with their neighbours on the ray.
pub const SPATIAL_SHARE: f64 = 0.95;
/// Share of a ray's samples of which NSFF and DynamicNeRF take the acceleration.
pub const TEMPORAL_SHARE: f64 = 0.9;

/// The first samples of each ray.
#[derive(Clone, Copy, Debug)]
pub struct Near<'a> {
    /// `[rays + 1]`, non-decreasing: ray `r` owns the samples `offsets[r] .. offsets[r + 1]`.
    pub offsets: &'a [u32],
    /// Share of a ray's samples that take part, rounded down to whole samples, in `[0, 1]`.
    pub share: f64,
}

impl Near<'_> {
    /// Number of samples that take part.
    #[must_use]
    pub fn samples(&self) -> usize {
        self.spans().map(|span| span.len()).sum()
    }

    /// Number of pairs of neighbours that take part.
    #[must_use]
    pub fn pairs(&self) -> usize {
        self.spans().map(|span| span.len().saturating_sub(1)).sum()
    }

    /// The samples of each ray that take part.
    fn spans(&self) -> impl Iterator<Item = Range<usize>> + '_ {
        let share = self.share;
        self.offsets.windows(2).map(move |ends| {
            let (from, to) = (ends[0] as usize, ends[1] as usize);
            // Rounded down: the cast cuts the fraction off.
            let taken = (share * to.saturating_sub(from) as f64) as usize;
            from..from + taken
        })
    }

    /// The number of samples that the offsets tell of.
    fn check(&self) -> Result<usize, LossError> {
        if !self.offsets.is_sorted() {
            return Err(LossError::Order { what: "offsets" });
        }
        if !(0.0..=1.0).contains(&self.share) {
            let value = self.share as f32;
            return Err(LossError::Parameter { what: "`share` of the samples of a ray", value, range: "[0, 1]" });
        }
        Ok(self.offsets.last().copied().unwrap_or(0) as usize)
    }
}

/// `sum w kernel(there + back)` over all rows of all samples; 0 for nothing, and where every sample comes back to where it was.
///
/// # Shapes and units
/// * `there` `[rows][n]` scene flow of the samples to another frame
/// * `back` `[rows][n]` scene flow from that frame to this one, at the places where the samples are there
/// * `w` `[n]` weight of each sample, 0 where it cannot be seen in the other frame
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree, [`LossError::Parameter`] for an unusable kernel.
pub fn cycle(there: &[f32], back: &[f32], w: &[f32], kernel: Kernel) -> Result<f64, LossError> {
    check(kernel)?;
    rows_of("there", there.len(), w.len())?;
    same("back", there.len(), back.len())?;
    let n = w.len().max(1);
    let mut sum = 0.0;
    for (there, back) in there.chunks_exact(n).zip(back.chunks_exact(n)) {
        for ((&there, &back), &w) in there.iter().zip(back).zip(w) {
            sum += f64::from(w) * f64::from(kernel.value(there, -back));
        }
    }
    Ok(sum)
}

/// Where the gradients of [`cycle`] go.
#[derive(Debug)]
pub struct CycleBar<'a> {
    /// `[rows][n]`.
    pub there: &'a mut [f32],
    /// `[rows][n]`.
    pub back: &'a mut [f32],
    /// `[n]`.
    pub w: &'a mut [f32],
}

/// Backward twin of [`cycle`]: adds into all of `bars`; the same to `there` and to `back`.
///
/// # Errors
/// As [`cycle`].
pub fn cycle_backward(
    there: &[f32],
    back: &[f32],
    w: &[f32],
    kernel: Kernel,
    loss_bar: f64,
    bars: CycleBar<'_>,
) -> Result<(), LossError> {
    check(kernel)?;
    let rows = rows_of("there", there.len(), w.len())?;
    same("back", there.len(), back.len())?;
    same("there_bar", there.len(), bars.there.len())?;
    same("back_bar", there.len(), bars.back.len())?;
    same("w_bar", w.len(), bars.w.len())?;
    let n = w.len();
    for (i, (&w, w_bar)) in w.iter().zip(bars.w.iter_mut()).enumerate() {
        let mut cost = 0.0;
        for at in (0..rows).map(|row| row * n + i) {
            let (a, b) = (there[at], -back[at]);
            cost += f64::from(kernel.value(a, b));
            let bar = (loss_bar * f64::from(w) * f64::from(kernel.derivative(a, b))) as f32;
            bars.there[at] += bar;
            bars.back[at] += bar;
        }
        *w_bar += (loss_bar * cost) as f32;
    }
    Ok(())
}

/// `sum kernel(next + previous)` over all rows of the near samples; 0 for nothing, and for samples that move steadily.
///
/// # Shapes and units
/// * `next`, `previous` `[rows][n]` scene flow to the next and to the previous frame
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree, [`LossError::Order`] for offsets that decrease, [`LossError::Parameter`] for an
/// unusable kernel or share.
pub fn temporal(next: &[f32], previous: &[f32], near: Near<'_>, kernel: Kernel) -> Result<f64, LossError> {
    check(kernel)?;
    let n = near.check()?;
    let rows = rows_of("next", next.len(), n)?;
    same("previous", next.len(), previous.len())?;
    let mut sum = 0.0;
    for start in (0..rows).map(|row| row * n) {
        for at in near.spans().flatten().map(|i| start + i) {
            sum += f64::from(kernel.value(next[at], -previous[at]));
        }
    }
    Ok(sum)
}

/// Backward twin of [`temporal`]: adds into `next_bar` and `previous_bar`, the same to both.
///
/// # Errors
/// As [`temporal`].
pub fn temporal_backward(
    next: &[f32],
    previous: &[f32],
    near: Near<'_>,
    kernel: Kernel,
    loss_bar: f64,
    next_bar: &mut [f32],
    previous_bar: &mut [f32],
) -> Result<(), LossError> {
    check(kernel)?;
    let n = near.check()?;
    let rows = rows_of("next", next.len(), n)?;
    same("previous", next.len(), previous.len())?;
    same("next_bar", next.len(), next_bar.len())?;
    same("previous_bar", next.len(), previous_bar.len())?;
    for start in (0..rows).map(|row| row * n) {
        for at in near.spans().flatten().map(|i| start + i) {
            let bar = (loss_bar * f64::from(kernel.derivative(next[at], -previous[at]))) as f32;
            next_bar[at] += bar;
            previous_bar[at] += bar;
        }
    }
    Ok(())
}

/// `sum kernel(S_k - S_(k + 1))` over all rows of neighbours among the near samples of a ray; 0 for nothing, and for flow that is the
/// same along each ray. Samples of different rays are no neighbours.
///
/// # Shapes and units
/// * `flow` `[rows][n]` scene flow to one frame
///
/// # Errors
/// As [`temporal`].
pub fn spatial(flow: &[f32], near: Near<'_>, kernel: Kernel) -> Result<f64, LossError> {
    check(kernel)?;
    let n = near.check()?;
    let rows = rows_of("flow", flow.len(), n)?;
    let mut sum = 0.0;
    for start in (0..rows).map(|row| row * n) {
        for span in near.spans() {
            for pair in flow[start + span.start..start + span.end].windows(2) {
                sum += f64::from(kernel.value(pair[0], pair[1]));
            }
        }
    }
    Ok(sum)
}

/// Backward twin of [`spatial`]: adds into `flow_bar`.
///
/// # Errors
/// As [`temporal`].
pub fn spatial_backward(
    flow: &[f32],
    near: Near<'_>,
    kernel: Kernel,
    loss_bar: f64,
    flow_bar: &mut [f32],
) -> Result<(), LossError> {
    check(kernel)?;
    let n = near.check()?;
    let rows = rows_of("flow", flow.len(), n)?;
    same("flow_bar", flow.len(), flow_bar.len())?;
    for start in (0..rows).map(|row| row * n) {
        for span in near.spans() {
            for at in (start + span.start..start + span.end).skip(1) {
                let bar = (loss_bar * f64::from(kernel.derivative(flow[at - 1], flow[at]))) as f32;
                flow_bar[at - 1] += bar;
                flow_bar[at] -= bar;
            }
        }
    }
    Ok(())
}

/// How many rows of `n` samples `len` values are.
fn rows_of(what: &'static str, len: usize, n: usize) -> Result<usize, LossError> {
    if n == 0 {
        return same(what, 0, len).map(|()| 0);
    }
    same(what, len.div_ceil(n) * n, len).map(|()| len / n)
}
