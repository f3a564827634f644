//! Depth of which the order alone is known: what another program says is nearer has to be nearer.
//!
//! ```text
//! loss = sum over pairs with y_i < y_j of max(0, x_i - x_j + margin) / (n (n - 1) / 2)
//! ```
//!
//! Pairs whose `y` are equal, or no numbers, say nothing. The work is `n^2`: `n` pixels of a patch, not of a photo. Sums are `f64` in
//! index order. Values are not scanned: NaN in `x` adds nothing, as NaN is not above 0.
//!
//! Source: Wang et al., "SparseNeRF: Distilling depth ranking for few-shot novel view synthesis", 2023, local depth ranking.

use crate::{LossError, error::same};

/// Margin of the paper, in the unit of its depths.
pub const MARGIN: f32 = 1e-4;

/// Loss of depths `x` against others, `y`, of which the order alone counts; 0 for fewer than two.
///
/// # Shapes and units
/// * `x`, `y` `[n]`, of the same sense (both larger where farther, or both smaller); `margin` in the unit of `x`
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree, [`LossError::Parameter`] for a margin below 0 or not finite.
pub fn ranking(x: &[f32], y: &[f32], margin: f32) -> Result<f64, LossError> {
    check(x, y, margin)?;
    let mut sum = 0.0;
    each_wrong_pair(x, y, margin, |_, _, by| sum += by);
    Ok(sum * per_pair(x.len()))
}

/// Backward twin of [`ranking`], which it returns: adds into `x_bar` `[n]`. `y` is constant; where a pair is just right the gradient is 0.
///
/// # Errors
/// As [`ranking`].
pub fn ranking_backward(x: &[f32], y: &[f32], margin: f32, loss_bar: f64, x_bar: &mut [f32]) -> Result<f64, LossError> {
    check(x, y, margin)?;
    same("x_bar", x.len(), x_bar.len())?;
    let mut sum = 0.0;
    // Whole numbers, so no order of adding changes them.
    let mut wrong = alloc::vec![0_i64; x.len()];
    each_wrong_pair(x, y, margin, |near, far, by| {
        sum += by;
        wrong[near] += 1;
        wrong[far] -= 1;
    });
    let share = per_pair(x.len());
    x_bar.iter_mut().zip(wrong).for_each(|(bar, wrong)| *bar += (loss_bar * share * wrong as f64) as f32);
    Ok(sum * share)
}

fn check(x: &[f32], y: &[f32], margin: f32) -> Result<(), LossError> {
    same("y", x.len(), y.len())?;
    if margin >= 0.0 && margin.is_finite() {
        Ok(())
    } else {
        Err(LossError::Parameter { what: "margin", value: margin, range: "0 or more" })
    }
}

/// One over the number of pairs.
fn per_pair(n: usize) -> f64 {
    let n = n as f64;
    if n > 1.0 { 2.0 / (n * (n - 1.0)) } else { 0.0 }
}

/// Pairs in the wrong order, or in the right one by less than the margin: which is said to be nearer, which farther, and by how much.
fn each_wrong_pair(x: &[f32], y: &[f32], margin: f32, mut each: impl FnMut(usize, usize, f64)) {
    for i in 0..x.len() {
        for j in (0..x.len()).filter(|&j| y[i] < y[j]) {
            let by = f64::from(x[i]) - f64::from(x[j]) + f64::from(margin);
            if by > 0.0 {
                each(i, j, by);
            }
        }
    }
}
