//! Every sample of a ray by itself should have the colour of its pixel, as far as it is seen.
//!
//! ```text
//! L = sum(w[i] |c[i] - C|^2)           weights are taken as they are: they learn nothing from it
//! ```
//!
//! The squares are summed over the channels. Sums are `f64` in index order. Values are not scanned: NaN in gives NaN out.
//!
//! Source: Sun et al., "Direct voxel grid optimization", 2022, the per-point loss; Fang et al., "Fast dynamic radiance fields
//! with time-aware neural voxels" (TiNeuVox), 2022, released code (the sum over rays divided by their number, times 0.01).

use crate::{LossError, error::same};

/// What the samples of one ray cost; 0 for a ray without samples.
///
/// # Shapes and units
/// * `w`      `[n]` weights of the samples
/// * `rgb`    `[3][n]` their colours
/// * `target` the colour of the pixel
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree.
pub fn of_ray(w: &[f32], rgb: [&[f32]; 3], target: [f32; 3]) -> Result<f64, LossError> {
    let mut sum = 0.0;
    for (colours, target) in rgb.into_iter().zip(target) {
        same("rgb", w.len(), colours.len())?;
        for (&w, &colour) in w.iter().zip(colours) {
            let off = f64::from(colour) - f64::from(target);
            sum += f64::from(w) * off * off;
        }
    }
    Ok(sum)
}

/// Backward twin of [`of_ray`]: adds `loss_bar 2 w (c - C)` into `rgb_bar` `[3][n]`.
///
/// # Errors
/// As [`of_ray`].
pub fn of_ray_backward(
    w: &[f32],
    rgb: [&[f32]; 3],
    target: [f32; 3],
    loss_bar: f64,
    rgb_bar: [&mut [f32]; 3],
) -> Result<(), LossError> {
    for ((colours, target), bars) in rgb.into_iter().zip(target).zip(rgb_bar) {
        same("rgb", w.len(), colours.len())?;
        same("rgb_bar", w.len(), bars.len())?;
        for ((&w, &colour), bar) in w.iter().zip(colours).zip(bars) {
            *bar += (2.0 * loss_bar * f64::from(w) * (f64::from(colour) - f64::from(target))) as f32;
        }
    }
    Ok(())
}
