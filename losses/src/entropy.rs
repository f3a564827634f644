//! Entropy along rays: a ray should end on matter or on the background, not on a mixture, and its weight should lie in few samples.
//!
//! | function | of |
//! | --- | --- |
//! | [`binary`] | what of a ray reaches the background |
//! | [`weights`] | the weights of its samples |
//!
//! Sums are `f64` in index order. Values are not scanned: NaN in gives NaN out.

use crate::{LossError, error::same};
use float_core::m64;

/// Probabilities closer to 0 or 1 than this count as that close, and have derivative 0.
pub const CLAMP: f64 = 1e-6;

/// `sum -(p ln p + (1 - p) ln(1 - p))` with `p` held in `CLAMP ..= 1 - CLAMP`; 0 for nothing.
///
/// # Shapes and units
/// * `p` `[n]` what of each ray reaches the background, in `[0, 1]`
///
/// # Source
/// Fang et al., "Fast dynamic radiance fields with time-aware neural voxels" (TiNeuVox), 2022, released code (the mean over rays,
/// times 1e-3).
#[must_use]
pub fn binary(p: &[f32]) -> f64 {
    p.iter().map(|&p| value(p)).sum()
}

/// [`binary`] of one ray.
#[must_use]
pub fn value(p: f32) -> f64 {
    let p = f64::from(p).clamp(CLAMP, 1.0 - CLAMP);
    -(p * m64::ln(p) + (1.0 - p) * m64::ln_1p(-p))
}

/// `ln((1 - p) / p)`, the derivative of [`value`]; 0 where `p` was held.
#[must_use]
pub fn derivative(p: f32) -> f64 {
    let p = f64::from(p);
    if (CLAMP..=1.0 - CLAMP).contains(&p) { m64::ln_1p(-p) - m64::ln(p) } else { 0.0 }
}

/// Backward twin of [`binary`]: adds `loss_bar ln((1 - p) / p)` into `p_bar` `[n]`, nothing where `p` was held.
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree.
pub fn binary_backward(p: &[f32], loss_bar: f64, p_bar: &mut [f32]) -> Result<(), LossError> {
    same("p_bar", p.len(), p_bar.len())?;
    for (p_bar, &p) in p_bar.iter_mut().zip(p) {
        *p_bar += (loss_bar * derivative(p)) as f32;
    }
    Ok(())
}

/// Weights below this count as this in the logarithm of [`weights`].
pub const LEAST_WEIGHT: f64 = 1e-12;

/// `sum -w ln max(w, LEAST_WEIGHT)`: the more samples share a weight, the more it costs. 0 for nothing, and where one sample has all of
/// it.
///
/// # Shapes and units
/// * `w` `[n]` weights of the samples of any number of rays, in `[0, 1]`; those of a ray need not sum to 1
///
/// # Source
/// Gao et al., "Dynamic view synthesis from dynamic monocular video" (DynamicNeRF), 2021, sparsity; released code (the mean over
/// rays, times 1e-3).
#[must_use]
pub fn weights(w: &[f32]) -> f64 {
    w.iter().map(|&w| f64::from(w)).map(|w| -w * m64::ln(w.max(LEAST_WEIGHT))).sum()
}

/// Backward twin of [`weights`]: adds `loss_bar` times `-ln w - 1` into `w_bar` `[n]`, `-ln LEAST_WEIGHT` where `w` is below that.
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree.
pub fn weights_backward(w: &[f32], loss_bar: f64, w_bar: &mut [f32]) -> Result<(), LossError> {
    same("w_bar", w.len(), w_bar.len())?;
    for (w_bar, &w) in w_bar.iter_mut().zip(w) {
        let w = f64::from(w);
        // Asked this way round, NaN stays NaN.
        let derivative = if w < LEAST_WEIGHT { -m64::ln(LEAST_WEIGHT) } else { -m64::ln(w) - 1.0 };
        *w_bar += (loss_bar * derivative) as f32;
    }
    Ok(())
}
