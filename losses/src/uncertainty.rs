//! Errors under an uncertainty that is learned along: a ray may say that it can't be explained, at a price.
//!
//! Letters: `n` rays; `prediction`, `target` `[n][3]` colours; `beta` `[n]` standard deviation of each ray, colour units;
//! `w` `[n]` weights of the rays, one each where absent. One ray costs
//!
//! ```text
//! loss = e2 / (2 beta^2) + ln(beta)        e2 = mean (or sum) over channels of (prediction - target)^2
//! ```
//!
//! the negative logarithm of a normal density, without its constant. For a given error it is smallest where `beta` is the root
//! of `e2`, and it may be negative: down to `ln(beta_min)`.
//!
//! With a tail of scale `c` an error well above it costs its length instead of its square: `k2` stands in the place of `e2`,
//!
//! ```text
//! k2 = 2 c^2 (sqrt(1 + e2 / c^2) - 1)          d k2 / d e2 = 1 / sqrt(1 + e2 / c^2)
//! ```
//!
//! the Charbonnier kernel, which is `e2` for small errors. The published likelihood has none; see [`Likelihood::tail`].
//!
//! [`transient_density`] is the price of declaring matter transient. Sums are `f64` in index order; a batch in tiles sums and
//! divides at the end, as in [`crate::photometric`]. Values are not scanned: NaN in gives NaN out.
//!
//! Source: Martin-Brualla et al., "NeRF in the wild", 2021, eq. 13; Kendall and Gal, "What uncertainties do we need in
//! Bayesian deep learning for computer vision?", 2017.

use crate::{LossError, error::same};
use float_core::m64;

/// How the channels of a ray make one error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Channels {
    /// Their mean: `beta` is an error per channel, as in released code.
    #[default]
    Mean,
    /// Their sum, as published: `beta` is the length of the error in colour space, and the other terms weigh a third.
    Sum,
}

/// The likelihood of NeRF-W.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Likelihood {
    /// A smaller `beta` counts as this, and gets no gradient: `> 0`, colour units.
    pub beta_min: f32,
    /// How channels make one error.
    pub channels: Channels,
    /// Scale `c` of the tail, `>= 0`, colour units; 0: none, as published. Until outliers are explained their squares are
    /// most of a batch's gradient: with a tail the gradient of an error is at most `c / beta^2`.
    pub tail: f32,
}

impl Likelihood {
    /// For photographs: `beta_min` 0.03, mean over channels, no tail.
    pub const PHOTOGRAPHS: Self = Self { beta_min: 0.03, channels: Channels::Mean, tail: 0.0 };

    float_core::setters! {
        with_beta_min beta_min: f32;
        with_channels channels: Channels;
        with_tail tail: f32;
    }

    /// Cost of each ray.
    ///
    /// # Shapes and units
    /// * `prediction`, `target` `[n][3]`, `beta` `[n]` colour units
    /// * `loss` `[n]` out, written
    ///
    /// # Errors
    /// [`LossError::Shape`] where lengths disagree, [`LossError::Parameter`] unless `beta_min` is finite and above 0
    /// and `tail` finite and not below.
    pub fn per_ray(
        &self,
        prediction: &[[f32; 3]],
        target: &[[f32; 3]],
        beta: &[f32],
        loss: &mut [f32],
    ) -> Result<(), LossError> {
        self.check(prediction, target, beta, None)?;
        same("loss", prediction.len(), loss.len())?;
        for (i, loss) in loss.iter_mut().enumerate() {
            *loss = self.ray(&prediction[i], &target[i], beta[i]) as f32;
        }
        Ok(())
    }

    /// `sum_i w[i] loss[i]`; 0 for no rays.
    ///
    /// # Errors
    /// As [`Likelihood::per_ray`].
    pub fn sum(
        &self,
        prediction: &[[f32; 3]],
        target: &[[f32; 3]],
        beta: &[f32],
        w: Option<&[f32]>,
    ) -> Result<f64, LossError> {
        self.check(prediction, target, beta, w)?;
        Ok((0..prediction.len()).map(|i| weight(w, i) * self.ray(&prediction[i], &target[i], beta[i])).sum())
    }

    /// Backward twin of [`Likelihood::sum`]: adds `loss_bar * d sum / d prediction` into `prediction_bar` `[n][3]` and
    /// `loss_bar * d sum / d beta` into `beta_bar` `[n]`. Weights are constants.
    ///
    /// # Errors
    /// As [`Likelihood::per_ray`].
    #[expect(clippy::too_many_arguments, reason = "inputs and their gradients, as in every backward twin")]
    pub fn sum_backward(
        &self,
        prediction: &[[f32; 3]],
        target: &[[f32; 3]],
        beta: &[f32],
        w: Option<&[f32]>,
        loss_bar: f64,
        prediction_bar: &mut [[f32; 3]],
        beta_bar: &mut [f32],
    ) -> Result<(), LossError> {
        self.check(prediction, target, beta, w)?;
        same("prediction_bar", prediction.len(), prediction_bar.len())?;
        same("beta_bar", prediction.len(), beta_bar.len())?;
        for i in 0..prediction.len() {
            let (bar, b) = (loss_bar * weight(w, i), self.floor(beta[i]));
            let precision = 1.0 / (b * b);
            let (k2, derivative) = self.shortened(self.error(&prediction[i], &target[i]));
            for c in 0..3 {
                let x = f64::from(prediction[i][c]) - f64::from(target[i][c]);
                prediction_bar[i][c] += (bar * self.share() * precision * derivative * x) as f32;
            }
            // Under the floor the cost does not depend on beta.
            if beta[i] >= self.beta_min {
                beta_bar[i] += (bar * (1.0 - k2 * precision) / b) as f32;
            } else if beta[i].is_nan() {
                beta_bar[i] = beta[i];
            }
        }
        Ok(())
    }

    /// [`Likelihood::sum`] divided by the number of rays; 0 for no rays.
    ///
    /// # Errors
    /// As [`Likelihood::per_ray`].
    pub fn mean(
        &self,
        prediction: &[[f32; 3]],
        target: &[[f32; 3]],
        beta: &[f32],
        w: Option<&[f32]>,
    ) -> Result<f64, LossError> {
        Ok(self.sum(prediction, target, beta, w)? / prediction.len().max(1) as f64)
    }

    /// Backward twin of [`Likelihood::mean`]; see [`Likelihood::sum_backward`].
    ///
    /// # Errors
    /// As [`Likelihood::per_ray`].
    #[expect(clippy::too_many_arguments, reason = "inputs and their gradients, as in every backward twin")]
    pub fn mean_backward(
        &self,
        prediction: &[[f32; 3]],
        target: &[[f32; 3]],
        beta: &[f32],
        w: Option<&[f32]>,
        loss_bar: f64,
        prediction_bar: &mut [[f32; 3]],
        beta_bar: &mut [f32],
    ) -> Result<(), LossError> {
        let bar = loss_bar / prediction.len().max(1) as f64;
        self.sum_backward(prediction, target, beta, w, bar, prediction_bar, beta_bar)
    }

    #[inline(always)]
    fn share(&self) -> f64 {
        match self.channels {
            Channels::Mean => 1.0 / 3.0,
            Channels::Sum => 1.0,
        }
    }

    /// `e2` of one ray.
    #[inline(always)]
    fn error(&self, p: &[f32; 3], t: &[f32; 3]) -> f64 {
        let square = |c: usize| {
            let x = f64::from(p[c]) - f64::from(t[c]);
            x * x
        };
        self.share() * (square(0) + square(1) + square(2))
    }

    /// `k2` and `d k2 / d e2`.
    #[inline(always)]
    fn shortened(&self, e2: f64) -> (f64, f64) {
        if self.tail == 0.0 {
            return (e2, 1.0);
        }
        let c = f64::from(self.tail);
        let root = m64::sqrt(1.0 + e2 / (c * c));
        // 2 c^2 (root - 1), without the difference of near numbers.
        (2.0 * e2 / (root + 1.0), 1.0 / root)
    }

    #[inline(always)]
    fn floor(&self, beta: f32) -> f64 {
        // Asked this way round, NaN stays NaN.
        f64::from(if beta < self.beta_min { self.beta_min } else { beta })
    }

    #[inline(always)]
    fn ray(&self, p: &[f32; 3], t: &[f32; 3], beta: f32) -> f64 {
        let b = self.floor(beta);
        0.5 * self.shortened(self.error(p, t)).0 / (b * b) + m64::ln(b)
    }

    fn check(
        &self,
        prediction: &[[f32; 3]],
        target: &[[f32; 3]],
        beta: &[f32],
        w: Option<&[f32]>,
    ) -> Result<(), LossError> {
        if !(self.beta_min > 0.0 && self.beta_min.is_finite()) {
            let what = "`beta_min` of the likelihood";
            return Err(LossError::Parameter { what, value: self.beta_min, range: "a finite number above 0" });
        }
        if !(self.tail >= 0.0 && self.tail.is_finite()) {
            let what = "`tail` of the likelihood";
            return Err(LossError::Parameter { what, value: self.tail, range: "a finite number, 0 or above" });
        }
        same("target", prediction.len(), target.len())?;
        same("beta", prediction.len(), beta.len())?;
        w.map_or(Ok(()), |w| same("w", prediction.len(), w.len()))
    }
}

/// Mean over rays of the mean transient density of a ray's samples; a ray without samples counts as 0.
///
/// # Shapes and units
/// * `offsets` `[rays + 1]`, non-decreasing: ray `r` owns the samples `offsets[r] .. offsets[r + 1]`
/// * `sigma` `[n]` density of transient matter, 1 / world unit
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree, [`LossError::Order`] where offsets decrease.
///
/// # Source
/// Martin-Brualla et al., "NeRF in the wild", 2021, eq. 13, third term (there times `lambda_u` 0.01).
pub fn transient_density(offsets: &[u32], sigma: &[f32]) -> Result<f64, LossError> {
    check_offsets(offsets, "sigma", sigma.len())?;
    let ray = |ends: &[u32]| {
        let sigma = &sigma[ends[0] as usize..ends[1] as usize];
        sigma.iter().map(|&s| f64::from(s)).sum::<f64>() / sigma.len().max(1) as f64
    };
    Ok(offsets.windows(2).map(ray).sum::<f64>() / offsets.len().saturating_sub(1).max(1) as f64)
}

/// Backward twin of [`transient_density`]: adds into `sigma_bar` `[n]`. It is linear: values are not needed.
///
/// # Errors
/// As [`transient_density`].
pub fn transient_density_backward(offsets: &[u32], loss_bar: f64, sigma_bar: &mut [f32]) -> Result<(), LossError> {
    check_offsets(offsets, "sigma_bar", sigma_bar.len())?;
    let rays = offsets.len().saturating_sub(1).max(1) as f64;
    for ends in offsets.windows(2) {
        let bar = (loss_bar / rays / f64::from((ends[1] - ends[0]).max(1))) as f32;
        sigma_bar[ends[0] as usize..ends[1] as usize].iter_mut().for_each(|b| *b += bar);
    }
    Ok(())
}

fn check_offsets(offsets: &[u32], what: &'static str, got: usize) -> Result<(), LossError> {
    if !offsets.is_sorted() {
        return Err(LossError::Order { what: "offsets" });
    }
    same(what, offsets.last().copied().unwrap_or(0) as usize, got)
}

#[inline(always)]
fn weight(w: Option<&[f32]>, i: usize) -> f64 {
    w.map_or(1.0, |w| f64::from(w[i]))
}
