//! Depth known up to a line that rises: correlation.
//!
//! ```text
//! loss = 1 - r,   r = sum(a b) / sqrt(sum(a^2) sum(b^2)),   a = x - mean x, b = y - mean y
//! dr / dx_i = (b_i / sqrt(sum b^2) - r a_i / sqrt(sum a^2)) / sqrt(sum a^2)
//! ```
//!
//! Invariant to `c x + d`, `c > 0`, of either side; 2 where the sign of `c` is wrong. The paper prints `r` itself as the loss, which would
//! make shapes opposite.
//!
//! A side without spread has no shape to compare, nor have few pixels: the loss and its gradient are 0. No gradient is larger than
//! [`STEEPEST`]. Means and sums are `f64` in index order, about the mean.
//!
//! Source: Xu et al., "Wild-GS", 2024, depth regularisation; Zhu et al., "FSGS", 2023.

use crate::{LossError, error::same};
use float_core::m64;

/// A mean square about the mean below this share of the mean's own square counts as none.
pub const FLAT: f64 = 1e-8;
/// Largest gradient of the loss.
pub const STEEPEST: f64 = 1e3;

/// One side: its mean, and the root of the sum of squares about it.
#[derive(Clone, Copy, Debug)]
struct Side {
    mean: f64,
    spread: f64,
}

impl Side {
    /// `None` without spread, and for what is not finite.
    fn of(x: &[f32]) -> Option<Self> {
        let n = x.len() as f64;
        let mean = x.iter().map(|&x| f64::from(x)).sum::<f64>() / n;
        let squares = x.iter().map(|&x| (f64::from(x) - mean) * (f64::from(x) - mean)).sum::<f64>();
        // Asked this way round, NaN has none either.
        let has_spread = squares >= FLAT * n * (mean * mean + 1e-12) && squares.is_finite();
        has_spread.then(|| Self { mean, spread: m64::sqrt(squares) })
    }

    /// One value, about the mean, in units of the spread.
    fn normal(&self, x: f32) -> f64 {
        (f64::from(x) - self.mean) / self.spread
    }
}

/// `1 - r` of two pictures of depths, pixel by pixel in `x` and `y`; 0 for fewer than `fewest` pixels (or 2), and without spread.
///
/// # Shapes and units
/// * `x`, `y` `[n]`, of the same sense (disparity against disparity, depth against depth)
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree.
pub fn pearson(x: &[f32], y: &[f32], fewest: usize) -> Result<f64, LossError> {
    same("y", x.len(), y.len())?;
    Ok(sides(x, y, fewest).map_or(0.0, |[a, b]| 1.0 - correlation(x, y, &a, &b)))
}

/// Backward twin of [`pearson`], which it returns: adds into `x_bar` `[n]`. `y` is constant.
///
/// # Errors
/// As [`pearson`].
pub fn pearson_backward(
    x: &[f32],
    y: &[f32],
    fewest: usize,
    loss_bar: f64,
    x_bar: &mut [f32],
) -> Result<f64, LossError> {
    same("y", x.len(), y.len())?;
    same("x_bar", x.len(), x_bar.len())?;
    let Some([a, b]) = sides(x, y, fewest) else { return Ok(0.0) };
    let r = correlation(x, y, &a, &b);
    for ((bar, &x), &y) in x_bar.iter_mut().zip(x).zip(y) {
        let gradient = (r * a.normal(x) - b.normal(y)) / a.spread;
        *bar += (loss_bar * gradient.clamp(-STEEPEST, STEEPEST)) as f32;
    }
    Ok(1.0 - r)
}

fn sides(x: &[f32], y: &[f32], fewest: usize) -> Option<[Side; 2]> {
    if x.len() < fewest.max(2) {
        return None;
    }
    Some([Side::of(x)?, Side::of(y)?])
}

fn correlation(x: &[f32], y: &[f32], a: &Side, b: &Side) -> f64 {
    x.iter().zip(y).map(|(&x, &y)| a.normal(x) * b.normal(y)).sum()
}
