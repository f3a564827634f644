//! Gaussians that are too slender: the longest of their sizes over the shortest, above what is allowed.
//!
//! ```text
//! mean over Gaussians of max(s_max / s_min, free) - free
//! ```
//!
//! Sums are `f64` in index order; NaN in gives NaN out. The derivative with respect to the logarithm of a size is the ratio itself, at most
//! 1e30; of sizes that are equal the first counts.
//!
//! Source: Xie et al., "PhysGaussian", 2024, the regularizer of anisotropy; Wang et al., "DeGauss", 2025.

use crate::{LossError, error::same};
use float_core::m64;

/// Largest ratio that a gradient is of.
const STEEPEST: f64 = 1e30;

/// The loss of Gaussians by the natural logarithms of their sizes; 0 for none.
///
/// # Shapes and units
/// * `log_scales` `[3][n]`, of lengths in one unit
/// * `free`: the ratio that costs nothing, at least 1
///
/// # Errors
/// [`LossError::Shape`] unless `log_scales` is three rows; [`LossError::Parameter`] for `free` below 1 or infinite.
pub fn anisotropy(log_scales: &[f32], free: f64) -> Result<f64, LossError> {
    each(log_scales, free, |_, _, _| {})
}

/// Backward twin of [`anisotropy`], which it returns: adds into `log_scales_bar`, shaped as `log_scales`.
///
/// # Errors
/// As [`anisotropy`], and [`LossError::Shape`] where shapes differ.
pub fn anisotropy_backward(
    log_scales: &[f32],
    free: f64,
    loss_bar: f64,
    log_scales_bar: &mut [f32],
) -> Result<f64, LossError> {
    same("log_scales_bar", log_scales.len(), log_scales_bar.len())?;
    let n = (log_scales.len() / 3).max(1) as f64;
    each(log_scales, free, |longest, shortest, ratio| {
        let bar = (loss_bar / n * ratio.min(STEEPEST)) as f32;
        log_scales_bar[longest] += bar;
        log_scales_bar[shortest] -= bar;
    })
}

/// The loss; calls `slender(longest, shortest, ratio)` with places in `log_scales` for each Gaussian that costs something.
fn each(log_scales: &[f32], free: f64, mut slender: impl FnMut(usize, usize, f64)) -> Result<f64, LossError> {
    let n = log_scales.len() / 3;
    same("log_scales", 3 * n, log_scales.len())?;
    if !(free >= 1.0 && free.is_finite()) {
        return Err(LossError::Parameter { what: "free", value: free as f32, range: "at least 1" });
    }
    let mut sum = 0.0;
    for i in 0..n {
        let at = [i, n + i, 2 * n + i];
        if at.iter().any(|&k| log_scales[k].is_nan()) {
            sum = f64::NAN;
            continue;
        }
        let [mut longest, mut shortest] = [at[0]; 2];
        for k in [at[1], at[2]] {
            if log_scales[k] > log_scales[longest] {
                longest = k;
            }
            if log_scales[k] < log_scales[shortest] {
                shortest = k;
            }
        }
        let ratio = m64::exp(f64::from(log_scales[longest]) - f64::from(log_scales[shortest]));
        if ratio > free {
            sum += ratio - free;
            slender(longest, shortest, ratio);
        }
    }
    Ok(sum / n.max(1) as f64)
}
