//! Losses on the codes of images: what an encoder sees in a render has to be what the render was made with.
//!
//! Letters: `a` code of an image, any length; `code` what the encoder makes of a render. Sums are `f64` in index order. Values
//! are not scanned: NaN in gives NaN out.
//!
//! Source: Chen et al., "Hallucinated neural radiance fields in the wild" (Ha-NeRF), 2022, eq. 5, and as released; the mode
//! seeking term is that of Mao et al., "Mode seeking generative adversarial networks", 2019.

use crate::{LossError, error::same};

/// Keeps [`mode_seeking`] finite where two codes give the same picture.
pub const MODE_SEEKING_EPS: f64 = 1e-5;

/// View consistency: `mean |code - a|`; 0 for codes of length 0.
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree.
pub fn view_consistency(code: &[f32], a: &[f32]) -> Result<f64, LossError> {
    same("a", code.len(), a.len())?;
    Ok(mean_distance(code, a))
}

/// Backward twin of [`view_consistency`]: adds into `code_bar`. `a` is a constant: the encoder follows the code, not the other
/// way round.
///
/// # Errors
/// As [`view_consistency`].
pub fn view_consistency_backward(
    code: &[f32],
    a: &[f32],
    loss_bar: f64,
    code_bar: &mut [f32],
) -> Result<(), LossError> {
    same("a", code.len(), a.len())?;
    same("code_bar", code.len(), code_bar.len())?;
    add_signs(code, a, loss_bar * per(code.len()), code_bar);
    Ok(())
}

/// Size of a code: `mean a^2`; 0 for length 0. (SF-NeRF weighs `sum a^2 - 1`: times the length, less 1.)
#[must_use]
pub fn size(a: &[f32]) -> f64 {
    a.iter().map(|&a| f64::from(a) * f64::from(a)).sum::<f64>() * per(a.len())
}

/// Backward twin of [`size`]: adds into `a_bar`.
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree.
pub fn size_backward(a: &[f32], loss_bar: f64, a_bar: &mut [f32]) -> Result<(), LossError> {
    same("a_bar", a.len(), a_bar.len())?;
    let bar = 2.0 * loss_bar * per(a.len());
    a_bar.iter_mut().zip(a).for_each(|(b, &a)| *b += (bar * f64::from(a)) as f32);
    Ok(())
}

/// Two renders of the same rays with two codes.
#[derive(Clone, Copy, Debug)]
pub struct TwoModes<'a> {
    /// `[n]` render with the image's own code, any number of values; a constant.
    pub own: &'a [f32],
    /// `[n]` render of the same rays with the other code.
    pub other: &'a [f32],
    /// `[k]` the image's own code; a constant.
    pub code_own: &'a [f32],
    /// `[k]` the other code; a constant.
    pub code_other: &'a [f32],
}

/// Mode seeking: `1 / (mean |own - other| / mean |code_own - code_other| + 1e-5)`, small where different codes give different
/// pictures.
///
/// # Numerics
/// Written as `g / (d + 1e-5 g)`. Equal codes say nothing: 0, without gradient (the quotient would be 0/0 as long as there is no
/// other image's code).
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree.
pub fn mode_seeking(modes: TwoModes<'_>) -> Result<f64, LossError> {
    let (d, g) = modes.distances()?;
    Ok(if g == 0.0 { 0.0 } else { g / (d + MODE_SEEKING_EPS * g) })
}

/// Backward twin of [`mode_seeking`]: adds into `other_bar` `[n]`.
///
/// # Errors
/// As [`mode_seeking`].
pub fn mode_seeking_backward(modes: TwoModes<'_>, loss_bar: f64, other_bar: &mut [f32]) -> Result<(), LossError> {
    let (d, g) = modes.distances()?;
    same("other_bar", modes.other.len(), other_bar.len())?;
    if g != 0.0 {
        let root = d + MODE_SEEKING_EPS * g;
        add_signs(modes.other, modes.own, -loss_bar * g / (root * root) * per(modes.other.len()), other_bar);
    }
    Ok(())
}

impl TwoModes<'_> {
    /// Mean distances of the pictures and of the codes.
    fn distances(&self) -> Result<(f64, f64), LossError> {
        same("other", self.own.len(), self.other.len())?;
        same("code_other", self.code_own.len(), self.code_other.len())?;
        Ok((mean_distance(self.own, self.other), mean_distance(self.code_own, self.code_other)))
    }
}

fn mean_distance(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(&a, &b)| (f64::from(a) - f64::from(b)).abs()).sum::<f64>() * per(a.len())
}

/// `x_bar += bar sign(x - y)`, 0 where they are equal.
fn add_signs(x: &[f32], y: &[f32], bar: f64, x_bar: &mut [f32]) {
    let bar = bar as f32;
    for ((x_bar, &x), &y) in x_bar.iter_mut().zip(x).zip(y) {
        if x > y {
            *x_bar += bar;
        } else if x < y {
            *x_bar -= bar;
        } else if x != y {
            // NaN must stay visible.
            *x_bar = f32::NAN;
        }
    }
}

#[inline(always)]
fn per(n: usize) -> f64 {
    1.0 / n.max(1) as f64
}
