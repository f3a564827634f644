//! Entropy of a ray's background transmittance: a ray should end on matter or on the background, not on a mixture.
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
