//! Losses on depth: where its unit is known (stereo, lidar), and where only its order and shape are (monocular).
//!
//! Letters: `n` rays; `prediction` rendered depth, `target` measured, both `[n]`; `w` `[n]` weights, 0 = no measurement.
//!
//! * [`supervised`]: a kernel of the error; the unit is known. EndoNeRF takes Huber with [`ENDO_DELTA`].
//! * [`ScaleShift`]: the target is known up to a factor and a shift, both by least squares.
//! * [`median`]: both sides less their median and divided by their mean deviation from it.
//! * [`pearson`]: both sides less their mean, and the cosine of the angle between them.
//! * [`ranking`]: the order of pairs alone.
//!
//! Sums are `f64` in index order. A ray of weight 0 is skipped: holes may hold anything.

pub mod median;
pub mod pearson;
pub mod ranking;
mod scale_shift;

pub use scale_shift::ScaleShift;

use crate::{LossError, error::same, kernel::Kernel};

/// Width of EndoNeRF's Huber kernel, in units of the normalised depth.
pub const ENDO_DELTA: f32 = 0.2;

/// `sum w kernel(prediction, target)`; 0 for nothing. The caller divides by the measurements, at least 1.
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree, [`LossError::Parameter`] for an unusable kernel.
///
/// # Source
/// Wang et al., "Neural rendering for stereo 3D reconstruction of deformable tissues in robotic surgery" (EndoNeRF),
/// 2022 (Huber); Gao et al., "Monocular dynamic view synthesis: a reality check", 2022 (squared).
pub fn supervised(kernel: Kernel, prediction: &[f32], target: &[f32], w: &[f32]) -> Result<f64, LossError> {
    check(kernel, prediction, target, w)?;
    let measured = prediction.iter().zip(target).zip(w).filter(|(_, w)| **w != 0.0);
    Ok(measured.map(|((&p, &t), &w)| f64::from(w) * f64::from(kernel.value(p, t))).sum())
}

/// Backward twin of [`supervised`]: adds into `prediction_bar` `[n]`.
///
/// # Errors
/// As [`supervised`].
pub fn supervised_backward(
    kernel: Kernel,
    prediction: &[f32],
    target: &[f32],
    w: &[f32],
    loss_bar: f64,
    prediction_bar: &mut [f32],
) -> Result<(), LossError> {
    check(kernel, prediction, target, w)?;
    same("prediction_bar", prediction.len(), prediction_bar.len())?;
    for (((bar, &p), &t), &w) in prediction_bar.iter_mut().zip(prediction).zip(target).zip(w) {
        if w != 0.0 {
            *bar += (loss_bar * f64::from(w) * f64::from(kernel.derivative(p, t))) as f32;
        }
    }
    Ok(())
}

fn check(kernel: Kernel, prediction: &[f32], target: &[f32], w: &[f32]) -> Result<(), LossError> {
    kernel.check()?;
    same("target", prediction.len(), target.len())?;
    same("w", prediction.len(), w.len())
}
