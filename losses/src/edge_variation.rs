//! Variation of a picture of depths, less where the photo has an edge.
//!
//! ```text
//! mean |d(x + 1, y) - d(x, y)| exp(-mean_c |I_c(x + 1, y) - I_c(x, y)|)  +  the same of y
//! ```
//!
//! Each mean is over its pairs of neighbours. Sums are `f64` in index order; NaN in gives NaN out.
//!
//! Source: Godard et al., "Unsupervised monocular depth estimation with left-right consistency", 2017, equation 3; Wang et al., "DeGauss",
//! 2025, equation 5, which prints the first term twice.

use crate::{LossError, error::same};
use float_core::m64;

/// A picture of depths and the photo beside it.
#[derive(Clone, Copy, Debug)]
pub struct DepthAndPhoto<'a> {
    /// Columns and rows.
    pub size: [usize; 2],
    /// `[rows][columns]`, depths.
    pub depth: &'a [f32],
    /// `[channels][rows][columns]`, colours.
    pub photo: &'a [f32],
}

impl DepthAndPhoto<'_> {
    fn check(&self) -> Result<usize, LossError> {
        let pixels = self.size[0] * self.size[1];
        same("depth", pixels, self.depth.len())?;
        let channels = self.photo.len() / pixels.max(1);
        same("photo", channels * pixels, self.photo.len())?;
        Ok(channels)
    }

    /// Calls `pair(i, j, weight)` for all neighbours along an axis; `weight` includes that of the mean.
    fn pairs(&self, axis: usize, channels: usize, mut pair: impl FnMut(usize, usize, f64)) {
        let [w, h] = self.size;
        let (columns, rows, next) = if axis == 0 { (w.saturating_sub(1), h, 1) } else { (w, h.saturating_sub(1), w) };
        let count = (columns * rows).max(1) as f64;
        for y in 0..rows {
            for x in 0..columns {
                let (i, j) = (y * w + x, y * w + x + next);
                let edge: f64 = self
                    .photo
                    .chunks_exact(w * h)
                    .map(|plane| (f64::from(plane[j]) - f64::from(plane[i])).abs())
                    .sum::<f64>()
                    / channels.max(1) as f64;
                pair(i, j, m64::exp(-edge) / count);
            }
        }
    }
}

/// The variation; 0 for fewer than two pixels.
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree.
pub fn edge_variation(of: &DepthAndPhoto<'_>) -> Result<f64, LossError> {
    let channels = of.check()?;
    let mut sum = 0.0;
    for axis in 0..2 {
        of.pairs(axis, channels, |i, j, weight| {
            sum += weight * (f64::from(of.depth[j]) - f64::from(of.depth[i])).abs();
        });
    }
    Ok(sum)
}

/// Backward twin of [`edge_variation`], which it returns: adds into `depth_bar` `[rows][columns]`. The derivative of `|x|` at 0 is 0; the
/// photo has none.
///
/// # Errors
/// As [`edge_variation`].
pub fn edge_variation_backward(of: &DepthAndPhoto<'_>, loss_bar: f64, depth_bar: &mut [f32]) -> Result<f64, LossError> {
    let channels = of.check()?;
    same("depth_bar", of.depth.len(), depth_bar.len())?;
    let mut sum = 0.0;
    for axis in 0..2 {
        of.pairs(axis, channels, |i, j, weight| {
            let difference = f64::from(of.depth[j]) - f64::from(of.depth[i]);
            sum += weight * difference.abs();
            let sign = if difference == 0.0 { 0.0 } else { difference.signum() };
            let bar = (loss_bar * weight * sign) as f32;
            depth_bar[j] += bar;
            depth_bar[i] -= bar;
        });
    }
    Ok(sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::vec;

    #[test]
    fn an_edge_of_the_photo_allows_an_edge_of_depth_and_one_pixel_has_none() {
        let of = |photo: [f32; 2]| {
            edge_variation(&DepthAndPhoto { size: [2, 1], depth: &[1.0, 3.0], photo: &photo }).unwrap()
        };
        assert_eq!(of([0.5, 0.5]), 2.0);
        assert!((of([0.0, 1.0]) - 2.0 * (-1.0_f64).exp()).abs() < 1e-12);
        for size in [[0, 0], [1, 1]] {
            let depth = vec![1.0; size[0] * size[1]];
            let mut bar = depth.clone();
            let empty = DepthAndPhoto { size, depth: &depth, photo: &depth };
            assert_eq!(edge_variation_backward(&empty, 1.0, &mut bar).unwrap(), 0.0);
            assert_eq!(bar, depth);
        }
        let short = DepthAndPhoto { size: [2, 2], depth: &[1.0; 3], photo: &[1.0; 4] };
        assert!(edge_variation(&short).is_err());
    }
}
