//! Depth known up to a monotone line: medians and mean deviations aligned.
//!
//! ```text
//! normal(d) = (d - med d) / mean|d - med d|          loss = mean (normal(prediction) - normal(target))^2
//! ```
//!
//! The median is the lower one, a value of the input, and its gradient goes to the element that holds it. Invariant to
//! `a d + b`, `a > 0`, of either side; a wrong sign of `a` shows as a loss near 4.
//!
//! A side without spread has no shape to compare: the loss and its gradient are 0 (published code adds 1e-10 to the
//! denominator, and its gradients reach 1e10).
//!
//! Source: Ranftl et al., "Towards robust monocular depth estimation" (MiDaS), 2020, eq. 5; in DynamicNeRF and RoDynRF.

use crate::{LossError, error::same, order::lower_quantile};
use alloc::vec::Vec;

/// A mean deviation below this share of the median (at least of 1) counts as none.
pub const FLAT: f64 = 1e-6;

/// Median and mean deviation of one side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Alignment {
    /// Lower median.
    pub median: f64,
    /// Mean of the distances from it.
    pub deviation: f64,
    /// Which element holds it.
    holder: usize,
}

impl Alignment {
    /// Of some depths; `None` for fewer than two, and for depths without spread. `scratch` keeps its memory.
    #[must_use]
    pub fn of(d: &[f32], scratch: &mut Vec<f32>) -> Option<Self> {
        if d.len() < 2 {
            return None;
        }
        let value = lower_quantile(d, 0.5, scratch);
        let holder = d.iter().position(|&d| d == value)?;
        let median = f64::from(value);
        let deviation = d.iter().map(|&d| (f64::from(d) - median).abs()).sum::<f64>() / d.len() as f64;
        // Asked this way round, NaN has no alignment either.
        (deviation >= FLAT * median.abs().max(1.0)).then_some(Self { median, deviation, holder })
    }

    /// One depth, aligned.
    #[must_use]
    pub fn normal(&self, d: f32) -> f64 {
        (f64::from(d) - self.median) / self.deviation
    }

    /// Adds into `d_bar` `[n]` the gradient of `sum normal_bar[i] normal(d[i])`; `normal_bar` answers by index.
    ///
    /// # Errors
    /// [`LossError::Shape`] where lengths disagree.
    pub fn backward(&self, d: &[f32], normal_bar: impl Fn(usize) -> f64, d_bar: &mut [f32]) -> Result<(), LossError> {
        same("d_bar", d.len(), d_bar.len())?;
        let n = d.len() as f64;
        let side = |d: f32| {
            let off = f64::from(d) - self.median;
            if off == 0.0 { 0.0 } else { off.signum() }
        };
        let (mut sum, mut along, mut sides) = (0.0, 0.0, 0.0);
        for (i, &d) in d.iter().enumerate() {
            let bar = normal_bar(i);
            sum += bar;
            along += bar * self.normal(d);
            sides += side(d);
        }
        for (i, (bar, &d)) in d_bar.iter_mut().zip(d).enumerate() {
            let mut gradient = normal_bar(i) - along * side(d) / n;
            if i == self.holder {
                gradient += along * sides / n - sum;
            }
            *bar += (gradient / self.deviation) as f32;
        }
        Ok(())
    }
}

/// The loss; 0 where either side has no shape, and for fewer than two rays. Rays of one frame.
///
/// # Shapes and units
/// * `prediction`, `target` `[n]`, of the same sense (disparity against disparity, depth against depth)
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree.
pub fn aligned(prediction: &[f32], target: &[f32], scratch: &mut Vec<f32>) -> Result<f64, LossError> {
    same("target", prediction.len(), target.len())?;
    let Some([p, t]) = sides(prediction, target, scratch) else { return Ok(0.0) };
    let errors = prediction.iter().zip(target).map(|(&a, &b)| p.normal(a) - t.normal(b));
    Ok(errors.map(|e| e * e).sum::<f64>() / prediction.len() as f64)
}

/// Backward twin of [`aligned`]: adds into `prediction_bar` `[n]`. Targets are constants.
///
/// # Errors
/// As [`aligned`].
pub fn aligned_backward(
    prediction: &[f32],
    target: &[f32],
    loss_bar: f64,
    prediction_bar: &mut [f32],
    scratch: &mut Vec<f32>,
) -> Result<(), LossError> {
    same("target", prediction.len(), target.len())?;
    same("prediction_bar", prediction.len(), prediction_bar.len())?;
    let Some([p, t]) = sides(prediction, target, scratch) else { return Ok(()) };
    let factor = 2.0 * loss_bar / prediction.len() as f64;
    p.backward(prediction, |i| factor * (p.normal(prediction[i]) - t.normal(target[i])), prediction_bar)
}

fn sides(prediction: &[f32], target: &[f32], scratch: &mut Vec<f32>) -> Option<[Alignment; 2]> {
    Some([Alignment::of(prediction, scratch)?, Alignment::of(target, scratch)?])
}
