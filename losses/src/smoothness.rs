//! Smoothness of an opacity over the picture, measured where it hears of the place: at the encoding of the pixel.
//!
//! Letters: `n` pixels `p` in `[0, 1]^2`; `gamma_k(p)` the rows of octave `k` of their frequency encoding (sines and cosines
//! of each coordinate: 4 rows in 2-D); `d` derivative of the opacity with respect to the encoding, row by row.
//!
//! ```text
//! loss = mean over pixels of sum_k 2^k sum over the rows of octave k of |d|
//! ```
//!
//! By the chain rule the derivative `|d alpha / d p|_1` over the picture is at most `loss` times the factor inside the sine (`pi` for
//! `sin(2^k pi p)`, 1 for `sin(2^k p)`): a small loss forbids opacities that flicker from pixel to pixel.
//!
//! `d` is itself a derivative through the network; [`smoothness_backward`] ends at it, the rest is the network's own
//! second-order backward pass.
//!
//! Source: Lee et al., "Semantic-aware occlusion filtering neural radiance fields in the wild" (SF-NeRF), 2023, the smoothness
//! term.

use crate::LossError;
use float_core::m64;

/// The value; 0 for no pixels.
///
/// # Shapes and units
/// * `d` `[octaves * rows_per_octave][n]`, octave by octave from the lowest
///
/// # Errors
/// [`LossError::Shape`] unless `d` is whole octaves of equal rows.
pub fn smoothness(d: &[f32], octaves: usize, rows_per_octave: usize) -> Result<f64, LossError> {
    let n = pixels(d.len(), octaves, rows_per_octave)?;
    let mut total = 0.0;
    for (k, octave) in d.chunks_exact((rows_per_octave * n).max(1)).enumerate() {
        total += m64::powi(2.0, k as i32) * octave.iter().map(|&d| f64::from(d).abs()).sum::<f64>();
    }
    Ok(total / n.max(1) as f64)
}

/// Backward twin of [`smoothness`]: adds `loss_bar 2^k / n` times the sign of `d` into `d_bar`, shaped as `d`; nothing where `d`
/// is 0.
///
/// # Errors
/// As [`smoothness`].
pub fn smoothness_backward(
    d: &[f32],
    octaves: usize,
    rows_per_octave: usize,
    loss_bar: f64,
    d_bar: &mut [f32],
) -> Result<(), LossError> {
    let n = pixels(d.len(), octaves, rows_per_octave)?;
    crate::error::same("d_bar", d.len(), d_bar.len())?;
    let rows = (rows_per_octave * n).max(1);
    for (k, (d_bar, d)) in d_bar.chunks_exact_mut(rows).zip(d.chunks_exact(rows)).enumerate() {
        let bar = (loss_bar * m64::powi(2.0, k as i32) / n as f64) as f32;
        for (d_bar, &d) in d_bar.iter_mut().zip(d) {
            *d_bar += bar * crate::kernel::l1_derivative(d);
        }
    }
    Ok(())
}

/// Pixels of `len` values in `octaves * rows_per_octave` rows.
fn pixels(len: usize, octaves: usize, rows_per_octave: usize) -> Result<usize, LossError> {
    let rows = octaves * rows_per_octave;
    if rows == 0 {
        return crate::error::same("d", 0, len).map(|()| 0);
    }
    crate::error::same("d", len.div_ceil(rows) * rows, len).map(|()| len / rows)
}
