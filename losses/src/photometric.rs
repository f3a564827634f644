//! Colour losses of a batch of rays.
//!
//! Letters: `n` rays; `prediction`, `target` `[n][3]` colours; `w` `[n]` weights of the rays (a mask, a robust weight), one
//! each where absent. One ray costs the **mean over its three channels** of the kernel, times its weight; a batch costs
//! the sum or the **mean over its `n` rays**, never divided by the sum of the weights: leaving a ray out does not make
//! the others louder.
//!
//! Work is `f32` per channel; sums are `f64`, one after the other in index order, so the number depends on nothing but
//! the input. A batch that is worked on in tiles is [`sum`]med tile by tile and divided by its rays at the end; its
//! backward pass hands `1 / n` to [`sum_backward`] of each tile.
//!
//! Values are not scanned: NaN in gives NaN out.

use crate::{LossError, error::same, kernel::Kernel};

/// Loss of each ray: the mean over channels of the kernel.
///
/// # Shapes and units
/// * `prediction`, `target` `[n][3]` colours
/// * `loss` `[n]` out, written
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree, [`LossError::Parameter`] for an unusable kernel.
pub fn per_ray(
    kernel: Kernel,
    prediction: &[[f32; 3]],
    target: &[[f32; 3]],
    loss: &mut [f32],
) -> Result<(), LossError> {
    check(kernel, prediction, target, None)?;
    same("loss", prediction.len(), loss.len())?;
    for ((loss, p), t) in loss.iter_mut().zip(prediction).zip(target) {
        *loss = ray(kernel, p, t) as f32;
    }
    Ok(())
}

/// Backward twin of [`per_ray`]: adds `loss_bar[i] * d loss[i] / d prediction[i]` into `prediction_bar`.
///
/// # Errors
/// As [`per_ray`].
pub fn per_ray_backward(
    kernel: Kernel,
    prediction: &[[f32; 3]],
    target: &[[f32; 3]],
    loss_bar: &[f32],
    prediction_bar: &mut [[f32; 3]],
) -> Result<(), LossError> {
    check(kernel, prediction, target, None)?;
    same("loss_bar", prediction.len(), loss_bar.len())?;
    same("prediction_bar", prediction.len(), prediction_bar.len())?;
    for (((bar, p), t), &loss_bar) in prediction_bar.iter_mut().zip(prediction).zip(target).zip(loss_bar) {
        ray_backward(kernel, p, t, f64::from(loss_bar), bar);
    }
    Ok(())
}

/// `sum_i w[i] * mean_c kernel(prediction[i][c], target[i][c])`; 0 for no rays.
///
/// # Errors
/// As [`per_ray`].
pub fn sum(kernel: Kernel, prediction: &[[f32; 3]], target: &[[f32; 3]], w: Option<&[f32]>) -> Result<f64, LossError> {
    check(kernel, prediction, target, w)?;
    let mut total = 0.0;
    for (i, (p, t)) in prediction.iter().zip(target).enumerate() {
        total += weight(w, i) * ray(kernel, p, t);
    }
    Ok(total)
}

/// Backward twin of [`sum`]: adds `loss_bar * d sum / d prediction` into `prediction_bar`. Weights are constants (a mask, or
/// weights of a reweighted least squares), so they get no gradient.
///
/// # Errors
/// As [`per_ray`].
pub fn sum_backward(
    kernel: Kernel,
    prediction: &[[f32; 3]],
    target: &[[f32; 3]],
    w: Option<&[f32]>,
    loss_bar: f64,
    prediction_bar: &mut [[f32; 3]],
) -> Result<(), LossError> {
    check(kernel, prediction, target, w)?;
    same("prediction_bar", prediction.len(), prediction_bar.len())?;
    for (i, ((bar, p), t)) in prediction_bar.iter_mut().zip(prediction).zip(target).enumerate() {
        ray_backward(kernel, p, t, loss_bar * weight(w, i), bar);
    }
    Ok(())
}

/// [`sum`] divided by the number of rays; 0 for no rays.
///
/// # Errors
/// As [`per_ray`].
pub fn mean(kernel: Kernel, prediction: &[[f32; 3]], target: &[[f32; 3]], w: Option<&[f32]>) -> Result<f64, LossError> {
    // max: no rays cost 0, not 0/0.
    Ok(sum(kernel, prediction, target, w)? / prediction.len().max(1) as f64)
}

/// Backward twin of [`mean`]; see [`sum_backward`].
///
/// # Errors
/// As [`per_ray`].
pub fn mean_backward(
    kernel: Kernel,
    prediction: &[[f32; 3]],
    target: &[[f32; 3]],
    w: Option<&[f32]>,
    loss_bar: f64,
    prediction_bar: &mut [[f32; 3]],
) -> Result<(), LossError> {
    sum_backward(kernel, prediction, target, w, loss_bar / prediction.len().max(1) as f64, prediction_bar)
}

/// Mean over channels for one ray.
#[inline(always)]
fn ray(kernel: Kernel, p: &[f32; 3], t: &[f32; 3]) -> f64 {
    (f64::from(kernel.value(p[0], t[0])) + f64::from(kernel.value(p[1], t[1])) + f64::from(kernel.value(p[2], t[2])))
        / 3.0
}

#[inline(always)]
fn ray_backward(kernel: Kernel, p: &[f32; 3], t: &[f32; 3], loss_bar: f64, bar: &mut [f32; 3]) {
    for c in 0..3 {
        bar[c] += (loss_bar / 3.0 * f64::from(kernel.derivative(p[c], t[c]))) as f32;
    }
}

#[inline(always)]
fn weight(w: Option<&[f32]>, i: usize) -> f64 {
    w.map_or(1.0, |w| f64::from(w[i]))
}

fn check(kernel: Kernel, prediction: &[[f32; 3]], target: &[[f32; 3]], w: Option<&[f32]>) -> Result<(), LossError> {
    kernel.check()?;
    same("target", prediction.len(), target.len())?;
    w.map_or(Ok(()), |w| same("w", prediction.len(), w.len()))
}
