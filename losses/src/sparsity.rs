//! Priors that prefer less: little density, little of what covers the picture.
//!
//! Sums are `f64` in index order. Values are not scanned: NaN in gives NaN out.

use crate::{LossError, error::same};
use float_core::m64;

/// `mean ln(1 + 2 sigma^2)`; 0 for no samples. Samples that are nearly empty are pulled to 0, dense ones hardly.
///
/// # Shapes and units
/// * `sigma` `[n]` density, 1 / world unit
///
/// # Source
/// Hedman et al., "Baking neural radiance fields", 2021, eq. 9 (a Cauchy loss); in SF-NeRF on coarse samples, times 1e-10.
#[must_use]
pub fn density(sigma: &[f32]) -> f64 {
    let one = |&sigma: &f32| {
        let sigma = f64::from(sigma);
        m64::ln_1p(2.0 * sigma * sigma)
    };
    sigma.iter().map(one).sum::<f64>() / sigma.len().max(1) as f64
}

/// Backward twin of [`density`]: adds `loss_bar / n * 4 sigma / (1 + 2 sigma^2)` into `sigma_bar` `[n]`.
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree.
pub fn density_backward(sigma: &[f32], loss_bar: f64, sigma_bar: &mut [f32]) -> Result<(), LossError> {
    same("sigma_bar", sigma.len(), sigma_bar.len())?;
    let bar = loss_bar / sigma.len().max(1) as f64;
    for (sigma_bar, &sigma) in sigma_bar.iter_mut().zip(sigma) {
        // In units that fit: 2 sigma^2 stays far from overflow in f64, an infinite sigma has derivative 0.
        let sigma = f64::from(sigma);
        if !sigma.is_infinite() {
            *sigma_bar += (bar * 4.0 * sigma / (1.0 + 2.0 * sigma * sigma)) as f32;
        }
    }
    Ok(())
}

/// Opacity prior: `mean alpha` of what covers the picture, `alpha` `[n]`; 0 for none.
///
/// # Source
/// Lee et al., "Semantic-aware occlusion filtering neural radiance fields in the wild" (SF-NeRF), 2023 (there times
/// `lambda_alpha` 0.2).
#[must_use]
pub fn opacity(alpha: &[f32]) -> f64 {
    alpha.iter().map(|&a| f64::from(a)).sum::<f64>() / alpha.len().max(1) as f64
}

/// Backward twin of [`opacity`]: adds `loss_bar / n` into `alpha_bar` `[n]`. It is linear: values are not needed.
pub fn opacity_backward(loss_bar: f64, alpha_bar: &mut [f32]) {
    let bar = (loss_bar / alpha_bar.len().max(1) as f64) as f32;
    alpha_bar.iter_mut().for_each(|b| *b += bar);
}
