//! Losses of a learned mask of what does not belong to the scene: colour through the mask, how much it may take, how
//! undecided it may be.
//!
//! Letters: `m` `[n]` transient map, 0 keeps a ray and 1 leaves it out (visibility is `1 - m`); `e2` `[n]` squared error of each
//! ray, the mean over channels ([`photometric::per_ray`](crate::photometric::per_ray) of the squared kernel); `lambda` weight of
//! the size of the map.
//!
//! ```text
//! loss = mean (1 - m) e2 / 2  +  lambda mean m^2  +  delta mean 1 / ((m - 1/2)^2 + 0.02)
//!        [`masked`]              [`size`]            [`indecision`]
//! ```
//!
//! Without the last term a given error is best left out to [`best_map`]`(e2, lambda)`. The published form, `M e2 + lambda (1 - M)^2`
//! with `M = 1 - m`, is twice the first term and the second. Sums are `f64` in index order.
//! Values are not scanned: NaN in gives NaN out.
//!
//! Source: Chen et al., "Hallucinated neural radiance fields in the wild" (Ha-NeRF), 2022, eqs. 7 and 8, and as released.

use crate::{LossError, error::same};
use float_core::m64;

/// Keeps [`indecision`] finite at 1/2, where it is 50.
pub const INDECISION_FLOOR: f64 = 0.02;

/// `mean (1 - m) e2 / 2`; 0 for no rays.
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree.
pub fn masked(m: &[f32], e2: &[f32]) -> Result<f64, LossError> {
    same("e2", m.len(), e2.len())?;
    let total: f64 = m.iter().zip(e2).map(|(&m, &e2)| (1.0 - f64::from(m)) * f64::from(e2)).sum();
    Ok(0.5 * total * per(m.len()))
}

/// Backward twin of [`masked`]: adds into `e2_bar` `[n]` and, if there is one, `m_bar` `[n]`. Without it the map is a constant,
/// as it is for the coarse network.
///
/// # Errors
/// As [`masked`].
pub fn masked_backward(
    m: &[f32],
    e2: &[f32],
    loss_bar: f64,
    m_bar: Option<&mut [f32]>,
    e2_bar: &mut [f32],
) -> Result<(), LossError> {
    same("e2", m.len(), e2.len())?;
    same("e2_bar", m.len(), e2_bar.len())?;
    let bar = 0.5 * loss_bar * per(m.len());
    for (e2_bar, &m) in e2_bar.iter_mut().zip(m) {
        *e2_bar += (bar * (1.0 - f64::from(m))) as f32;
    }
    if let Some(m_bar) = m_bar {
        same("m_bar", m.len(), m_bar.len())?;
        for (m_bar, &e2) in m_bar.iter_mut().zip(e2) {
            *m_bar -= (bar * f64::from(e2)) as f32;
        }
    }
    Ok(())
}

/// `mean m^2`; 0 for no rays.
#[must_use]
pub fn size(m: &[f32]) -> f64 {
    m.iter().map(|&m| f64::from(m) * f64::from(m)).sum::<f64>() * per(m.len())
}

/// Backward twin of [`size`]: adds into `m_bar` `[n]`.
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree.
pub fn size_backward(m: &[f32], loss_bar: f64, m_bar: &mut [f32]) -> Result<(), LossError> {
    same("m_bar", m.len(), m_bar.len())?;
    let bar = 2.0 * loss_bar * per(m.len());
    m_bar.iter_mut().zip(m).for_each(|(b, &m)| *b += (bar * f64::from(m)) as f32);
    Ok(())
}

/// `mean 1 / ((m - 1/2)^2 + 0.02)`, largest where the map is undecided; 0 for no rays. The released weight is 0.
#[must_use]
pub fn indecision(m: &[f32]) -> f64 {
    let one = |&m: &f32| {
        let x = f64::from(m) - 0.5;
        1.0 / (x * x + INDECISION_FLOOR)
    };
    m.iter().map(one).sum::<f64>() * per(m.len())
}

/// Backward twin of [`indecision`]: adds into `m_bar` `[n]`.
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree.
pub fn indecision_backward(m: &[f32], loss_bar: f64, m_bar: &mut [f32]) -> Result<(), LossError> {
    same("m_bar", m.len(), m_bar.len())?;
    let bar = loss_bar * per(m.len());
    for (m_bar, &m) in m_bar.iter_mut().zip(m) {
        let x = f64::from(m) - 0.5;
        let root = 1.0 / (x * x + INDECISION_FLOOR);
        *m_bar -= (bar * 2.0 * x * root * root) as f32;
    }
    Ok(())
}

/// The weight of [`size`] over training: `max(floor, start exp(-rate step))`.
///
/// High, the map keeps everything; too low, it takes hard texture for occluders.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SizeSchedule {
    /// At step 0: 0.05.
    pub start: f64,
    /// Per step: 0.001.
    pub rate: f64,
    /// Never below: 0.006, reached at step 2121.
    pub floor: f64,
}

impl Default for SizeSchedule {
    /// As released.
    fn default() -> Self {
        Self { start: 5e-2, rate: 1e-3, floor: 6e-3 }
    }
}

impl SizeSchedule {
    /// `lambda` at a step.
    #[must_use]
    pub fn at(&self, step: u64) -> f64 {
        (self.start * m64::exp(-self.rate * step as f64)).max(self.floor)
    }
}

/// The map that minimises `(1 - m) e2 / 2 + lambda m^2` for a given error: `min(1, e2 / (4 lambda))`. With `lambda = 0.006` a
/// ray is left out entirely from an error of 0.155 a channel on.
///
/// `lambda` `> 0`.
#[must_use]
pub fn best_map(e2: f64, lambda: f64) -> f64 {
    (e2 / (4.0 * lambda)).min(1.0)
}

/// The visibility `M = 1 - m` that minimises the published form `M e2 + lambda (1 - M)^2`: `max(0, 1 - e2 / (2 lambda))`.
///
/// `lambda` `> 0`.
#[must_use]
pub fn best_visibility(e2: f64, lambda: f64) -> f64 {
    (1.0 - e2 / (2.0 * lambda)).max(0.0)
}

#[inline(always)]
fn per(n: usize) -> f64 {
    1.0 / n.max(1) as f64
}
