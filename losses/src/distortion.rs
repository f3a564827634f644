//! Distortion: how far apart a ray's weight lies. Small for one thin surface, large for floaters and fog.
//!
//! For the step function with mass `w[i]` on `[s[i], s[i + 1]]`, middle `m[i]` and length `ds[i]`,
//!
//! ```text
//! loss = sum_ij w[i] w[j] |m[i] - m[j]| + 1/3 sum_i w[i]^2 ds[i]
//! ```
//!
//! the mean distance of two points drawn from it, times the square of its mass. Both orders of a pair count.
//!
//! The middles are sorted, so prefix sums `W[i] = sum(w[j], j < i)`, `M[i] = sum(w[j] m[j], j < i)` give loss and gradient in
//! one pass each:
//!
//! ```text
//! loss     = 2 sum_i w[i] (m[i] W[i] - M[i]) + 1/3 sum_i w[i]^2 ds[i]
//! w_bar[i] = 2 (m[i] (W[i] - W'[i]) - M[i] + M'[i]) + 2/3 w[i] ds[i]
//! ```
//!
//! with `W'`, `M'` the sums over `j > i`. `m W - M` cancels where all weight lies at one place far from 0: middles are measured
//! from the ray's first edge, and they and the sums are `f64`, which costs nothing here (each pass waits for its own
//! additions, not for the width of numbers).
//!
//! Intervals may have gaps ([`Edges::Apart`](crate::Edges::Apart)): an occupancy grid's samples are as good as a proposal's.
//! Positions are constants. Values are not scanned: NaN in gives NaN out.
//!
//! Source: Barron, Mildenhall, Verbin, Srinivasan, Hedman, "Mip-NeRF 360", 2022, eqs. 14 and 15.

use crate::{LossError, RayIntervals, Reduction};

/// Multiplier for unbounded scenes in Mip-NeRF 360, with [`Reduction::PerRay`].
pub const MULTIPLIER_360: f32 = 0.01;

/// Distortion of each ray.
///
/// # Shapes and units
/// * `w` `[n]` weight of each interval
/// * `loss` `[rays]` out, written, in units of `s`; 0 for a ray without intervals
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree, [`LossError::Order`] where offsets decrease.
pub fn per_ray(intervals: RayIntervals<'_>, w: &[f32], loss: &mut [f32]) -> Result<(), LossError> {
    intervals.check("w", w.len())?;
    if loss.len() != intervals.rays() {
        return Err(LossError::Shape { what: "loss", want: intervals.rays(), got: loss.len() });
    }
    for (r, loss) in loss.iter_mut().enumerate() {
        *loss = ray(intervals, w, r) as f32;
    }
    Ok(())
}

/// Distortion of a batch, reduced as said; 0 for no rays. Rays are summed in `f64` in index order.
///
/// # Shapes and units
/// As [`per_ray`].
///
/// # Errors
/// As [`per_ray`].
pub fn distortion(intervals: RayIntervals<'_>, w: &[f32], reduction: Reduction) -> Result<f64, LossError> {
    intervals.check("w", w.len())?;
    let mut total = 0.0;
    for r in 0..intervals.rays() {
        total += ray(intervals, w, r);
    }
    Ok(total * reduction.factor(intervals.rays(), w.len()))
}

/// Backward twin of [`distortion`]: adds `loss_bar * d loss / d w` into `w_bar` `[n]`.
///
/// A batch that is worked on in tiles takes [`Reduction::Sum`] for each tile, with `loss_bar` divided by the rays of the batch.
///
/// # Errors
/// As [`per_ray`].
pub fn distortion_backward(
    intervals: RayIntervals<'_>,
    w: &[f32],
    reduction: Reduction,
    loss_bar: f64,
    w_bar: &mut [f32],
) -> Result<(), LossError> {
    intervals.check("w", w.len())?;
    if w_bar.len() != w.len() {
        return Err(LossError::Shape { what: "w_bar", want: w.len(), got: w_bar.len() });
    }
    let factor = loss_bar * reduction.factor(intervals.rays(), w.len());
    for r in 0..intervals.rays() {
        ray_backward(intervals, w, r, factor, w_bar);
    }
    Ok(())
}

/// Where positions of a ray are measured from.
#[inline(always)]
fn origin(start: &[f32]) -> f64 {
    start.first().map_or(0.0, |&s| f64::from(s))
}

/// One ray, forward.
#[inline(always)]
fn ray(intervals: RayIntervals<'_>, w: &[f32], r: usize) -> f64 {
    let (start, end) = intervals.ends(r);
    let origin = origin(start);
    let (mut mass, mut moment, mut between, mut within) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64);
    for ((&w, &a), &b) in w[intervals.range(r)].iter().zip(start).zip(end) {
        let (w, a, b) = (f64::from(w), f64::from(a) - origin, f64::from(b) - origin);
        let m = 0.5 * (a + b);
        between += w * (m * mass - moment);
        within += w * w * (b - a);
        mass += w;
        moment += w * m;
    }
    2.0 * between + within / 3.0
}

/// One ray, backward: `w_bar += factor * d loss / d w`.
#[inline(always)]
fn ray_backward(intervals: RayIntervals<'_>, w: &[f32], r: usize, factor: f64, w_bar: &mut [f32]) {
    let (start, end) = intervals.ends(r);
    let span = intervals.range(r);
    let (w, w_bar) = (&w[span.clone()], &mut w_bar[span]);
    // Behind each interval lies what all have, less what is in front and what it holds itself.
    let origin = origin(start);
    let (mut mass, mut moment) = (0.0_f64, 0.0_f64);
    for ((&w, &a), &b) in w.iter().zip(start).zip(end) {
        let w = f64::from(w);
        mass += w;
        moment += w * 0.5 * ((f64::from(a) - origin) + (f64::from(b) - origin));
    }
    // `mass`, `moment` become front minus back: each interval first leaves the back, then joins the front.
    let (mut mass, mut moment) = (-mass, -moment);
    for (((out, &w), &a), &b) in w_bar.iter_mut().zip(w).zip(start).zip(end) {
        let (w, a, b) = (f64::from(w), f64::from(a) - origin, f64::from(b) - origin);
        let m = 0.5 * (a + b);
        mass += w;
        moment += w * m;
        *out += (factor * (2.0 * (m * mass - moment) + 2.0 / 3.0 * w * (b - a))) as f32;
        mass += w;
        moment += w * m;
    }
}
