//! Depth known up to a factor and a shift.

use crate::{LossError, error::same};
use float_core::m64;

/// Spread of a prediction, as a share of its size, below which no factor can be told.
const FLAT: f64 = 1e-6;

/// The factor and the shift that take a prediction closest to its target, `scale * prediction + shift`: weighted least
/// squares.
///
/// # Numerics
/// The data are centred first, in `f64`: depths of 1000 with a spread of 1 keep their digits, where the normal equations in
/// `f32` lose all.
///
/// # Source
/// Ranftl et al., "Towards robust monocular depth estimation" (MiDaS), 2020, eq. 3 and 4; in NSFF.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScaleShift {
    /// Factor.
    pub scale: f64,
    /// Shift, unit of the target.
    pub shift: f64,
    /// Half the weighted mean of squared errors.
    pub loss: f64,
    /// Sum of the weights, weighted means, and the prediction's sum of squared deviations.
    mass: f64,
    means: [f64; 2],
    spread: f64,
}

impl ScaleShift {
    /// Fit a batch. `None` where no factor can be told: fewer than two measurements, or predictions that are all the same;
    /// such a batch has loss 0 and gradient 0.
    ///
    /// # Shapes and units
    /// * `prediction`, `target` `[n]`; `w` `[n]`, `>= 0`, 0 = no measurement
    ///
    /// # Errors
    /// [`LossError::Shape`] where lengths disagree.
    pub fn fit(prediction: &[f32], target: &[f32], w: &[f32]) -> Result<Option<Self>, LossError> {
        same("target", prediction.len(), target.len())?;
        same("w", prediction.len(), w.len())?;
        let (mut mass, mut sums) = (0.0, [0.0; 2]);
        for [p, t, w] in measured(prediction, target, w) {
            mass += w;
            sums[0] += w * p;
            sums[1] += w * t;
        }
        if mass <= 0.0 {
            return Ok(None);
        }
        let means = sums.map(|s| s / mass);
        let (mut spread, mut shared) = (0.0, 0.0);
        for [p, t, w] in measured(prediction, target, w) {
            spread += w * (p - means[0]) * (p - means[0]);
            shared += w * (p - means[0]) * (t - means[1]);
        }
        if m64::sqrt(spread / mass) <= FLAT * means[0].abs().max(f64::MIN_POSITIVE) {
            return Ok(None);
        }
        let scale = shared / spread;
        let shift = means[1] - scale * means[0];
        let squares: f64 = measured(prediction, target, w)
            .map(|[p, t, w]| {
                let error = scale * (p - means[0]) - (t - means[1]);
                w * error * error
            })
            .sum();
        Ok(Some(Self { scale, shift, loss: 0.5 * squares / mass, mass, means, spread }))
    }

    /// Adds the gradient of `bars . [scale, shift, loss]` into `prediction_bar` and `target_bar`, both `[n]`; the data are
    /// those that were fitted. The loss is at its least in scale and shift, so it has no gradient through them.
    ///
    /// # Errors
    /// [`LossError::Shape`] where lengths disagree.
    pub fn backward(
        &self,
        prediction: &[f32],
        target: &[f32],
        w: &[f32],
        [scale_bar, shift_bar, loss_bar]: [f64; 3],
        prediction_bar: &mut [f32],
        target_bar: &mut [f32],
    ) -> Result<(), LossError> {
        let n = prediction.len();
        same("target", n, target.len())?;
        same("w", n, w.len())?;
        same("prediction_bar", n, prediction_bar.len())?;
        same("target_bar", n, target_bar.len())?;
        let Self { scale, mass, means: [p_mean, t_mean], spread, .. } = *self;
        // shift = mean(t) - scale mean(p)
        let scale_bar = scale_bar - shift_bar * p_mean;
        for i in (0..n).filter(|&i| w[i] != 0.0) {
            let [p, t, w] = [prediction[i], target[i], w[i]].map(f64::from);
            let (p, t) = (p - p_mean, t - t_mean);
            let error_bar = loss_bar * w * (scale * p - t) / mass;
            prediction_bar[i] += (error_bar * scale + scale_bar * w * (t - 2.0 * scale * p) / spread
                - shift_bar * scale * w / mass) as f32;
            target_bar[i] += (scale_bar * w * p / spread + shift_bar * w / mass - error_bar) as f32;
        }
        Ok(())
    }
}

fn measured<'a>(prediction: &'a [f32], target: &'a [f32], w: &'a [f32]) -> impl Iterator<Item = [f64; 3]> + 'a {
    let all = prediction.iter().zip(target).zip(w);
    all.filter(|(_, w)| **w != 0.0).map(|((&p, &t), &w)| [p, t, w].map(f64::from))
}
