//! What the errors of a half-trained model say.

use crate::{LossError, error::same, order::lower_quantile};
use alloc::vec::Vec;

/// Share of the mean error that is added to it before errors are compared with it: the mean of equal numbers may round to less
/// than they are.
pub const MEAN_SLACK: f64 = 1e-9;

/// Static by their errors: `h_cr = [r <= mean r]` and `h_most = h_cr or [r <= quantile of r]`.
///
/// The second is there to take things out that err most; it holds the first also where the mean lies above the quantile (a few
/// huge errors).
///
/// # Shapes and units
/// * `r` `[n]` errors of one image, `>= 0`, any unit; NaN and infinite ones are never static, and stay out of the mean
/// * `quantile` `[0, 1]`, usually 0.95; an order statistic of all `n`
/// * `scratch` grows to `n` values and is kept by the caller
/// * `h_cr`, `h_most` `[n]` masks, written
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree, [`LossError::Parameter`] for a quantile outside its range.
pub fn residual_masks(
    r: &[f32],
    quantile: f32,
    scratch: &mut Vec<f32>,
    h_cr: &mut [u8],
    h_most: &mut [u8],
) -> Result<(), LossError> {
    same("h_cr", r.len(), h_cr.len())?;
    same("h_most", r.len(), h_most.len())?;
    if !(0.0..=1.0).contains(&quantile) {
        return Err(LossError::Parameter { what: "`quantile` of the errors", value: quantile, range: "0 to 1" });
    }
    let (mut total, mut count) = (0.0, 0_usize);
    for &r in r.iter().filter(|r| r.is_finite()) {
        total += f64::from(r);
        count += 1;
    }
    let mean = total / count.max(1) as f64 * (1.0 + MEAN_SLACK);
    let most = lower_quantile(r, quantile, scratch);
    for ((h_cr, h_most), &r) in h_cr.iter_mut().zip(h_most).zip(r) {
        let below_mean = r.is_finite() && f64::from(r) <= mean;
        *h_cr = u8::from(below_mean);
        *h_most = u8::from(below_mean || (r.is_finite() && r <= most));
    }
    Ok(())
}

/// `(h_sfm or h_cr) and h_most`, pixel by pixel.
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree.
pub fn combine(h_sfm: &[u8], h_cr: &[u8], h_most: &[u8], out: &mut [u8]) -> Result<(), LossError> {
    same("h_cr", h_sfm.len(), h_cr.len())?;
    same("h_most", h_sfm.len(), h_most.len())?;
    same("out", h_sfm.len(), out.len())?;
    for (i, out) in out.iter_mut().enumerate() {
        *out = u8::from((h_sfm[i] != 0 || h_cr[i] != 0) && h_most[i] != 0);
    }
    Ok(())
}
