//! Mean squared error and PSNR.

use super::{
    MetricError,
    image::{Image, check_pair},
};
use float_core::m64;

/// Mean squared error over all pixels and channels.
///
/// # Errors
/// [`MetricError::Mismatch`]; [`MetricError::TooSmall`] for an image without pixels, [`MetricError::Channels`] without
/// channels.
pub fn mse(a: &Image<'_>, b: &Image<'_>) -> Result<f64, MetricError> {
    check_pair("MSE", a, b)?;
    let total: f64 = (0..a.len()).map(|i| a.value(i) - b.value(i)).map(|d| d * d).sum();
    Ok(total / a.len() as f64)
}

/// Peak signal-to-noise ratio in dB: `-10 log10(mse)`, peak 1; `inf` for equal images.
///
/// # Errors
/// As [`mse`].
pub fn psnr(a: &Image<'_>, b: &Image<'_>) -> Result<f64, MetricError> {
    mse(a, b).map(psnr_of_mse)
}

/// `-10 log10(mse)` in dB; `inf` for 0.
#[must_use]
pub fn psnr_of_mse(mse: f64) -> f64 {
    if mse == 0.0 { f64::INFINITY } else { -10.0 * m64::log10(mse) }
}
