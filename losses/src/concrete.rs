//! Binary Concrete: an opacity that is nearly a coin toss, and still has a derivative.
//!
//! ```text
//! alpha = logistic((ln(x) + ln(U) - ln(1 - U)) / kappa)        x = softplus(h)
//! ```
//!
//! Letters: `h` raw output of a network; `x` the odds of being opaque, `> 0`; `u` uniform random numbers, `[0, 1]`; `kappa`
//! temperature. `P(alpha > 1/2) = x / (1 + x)` at every temperature; towards 0 `alpha` becomes the coin toss itself, at 1
//! without noise it is `x / (1 + x)`. Swapping the sides, `1 / x` and `1 - u`, gives `1 - alpha`.
//!
//! `ln(x)` comes from `h` directly, `ln(softplus(h)) ~ h` far below 0, so nothing takes the logarithm of 0; noise takes
//! `ln(u + 1e-8)`, which holds it within ±18.4.
//!
//! Source: Maddison, Mnih, Teh, "The Concrete distribution", 2017, eq. 2 and appendix B; in radiance fields Lee et al.,
//! "Semantic-aware occlusion filtering neural radiance fields in the wild" (SF-NeRF), 2023.

use crate::{LossError, error::same};
use float_core::m32;

/// Added inside the logarithms of the noise.
pub const NOISE_EPS: f32 = 1e-8;

/// Under this `ln(softplus(h))` is `h - e^h / 2`: the next term is below `1e-14`.
const LINEAR_BELOW: f32 = -15.0;

/// Binary Concrete with a temperature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BinaryConcrete {
    /// `kappa`: finite and above 0. 1 in the released training, 0.1 and below is nearly a coin toss.
    pub temperature: f32,
}

impl Default for BinaryConcrete {
    fn default() -> Self {
        Self { temperature: 1.0 }
    }
}

/// A temperature that falls: `max(floor, start exp(-rate step))`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Annealing {
    /// At step 0.
    pub start: f64,
    /// Per step.
    pub rate: f64,
    /// Never below.
    pub floor: f64,
}

impl Annealing {
    /// The temperature at a step.
    #[must_use]
    pub fn at(&self, step: u64) -> BinaryConcrete {
        let temperature = (self.start * float_core::m64::exp(-self.rate * step as f64)).max(self.floor);
        BinaryConcrete { temperature: temperature as f32 }
    }
}

/// `ln(softplus(h))`: the logarithm of the odds.
#[inline]
#[must_use]
pub fn ln_odds(h: f32) -> f32 {
    if h < LINEAR_BELOW { h - 0.5 * m32::exp(h) } else { m32::ln(m32::softplus(h)) }
}

/// Derivative of [`ln_odds`]: `logistic(h) / softplus(h)`, 1 far below 0, `1 / h` far above.
#[inline]
#[must_use]
pub fn ln_odds_derivative(h: f32) -> f32 {
    if h < LINEAR_BELOW { 1.0 - 0.5 * m32::exp(h) } else { m32::logistic(h) / m32::softplus(h) }
}

/// Logistic noise from a uniform number: `ln(u + 1e-8) - ln(1 - u + 1e-8)`; 0 at 1/2, odd around it.
#[inline]
#[must_use]
pub fn noise(u: f32) -> f32 {
    m32::ln(u + NOISE_EPS) - m32::ln((1.0 - u) + NOISE_EPS)
}

impl BinaryConcrete {
    /// `alpha` from the logarithm of the odds and [`noise`].
    #[inline]
    #[must_use]
    pub fn sample(self, ln_odds: f32, noise: f32) -> f32 {
        m32::logistic((ln_odds + noise) / self.temperature)
    }

    /// Derivative of [`BinaryConcrete::sample`] with respect to `ln_odds`: `alpha (1 - alpha) / kappa`.
    #[inline]
    #[must_use]
    pub fn sample_derivative(self, ln_odds: f32, noise: f32) -> f32 {
        let x = (ln_odds + noise) / self.temperature;
        // logistic(-x), not 1 - logistic(x): that has no digits left where alpha is nearly 1.
        m32::logistic(x) * m32::logistic(-x) / self.temperature
    }

    /// Opacities from raw outputs.
    ///
    /// # Shapes and units
    /// * `h` `[n]` raw; `u` `[n]` uniform in `[0, 1]`, or none: every one 1/2, as in evaluation
    /// * `alpha` `[n]` out, written, `[0, 1]`
    ///
    /// # Errors
    /// [`LossError::Shape`] where lengths disagree, [`LossError::Parameter`] unless the temperature is finite and above 0.
    pub fn forward(self, h: &[f32], u: Option<&[f32]>, alpha: &mut [f32]) -> Result<(), LossError> {
        self.check(h, u)?;
        same("alpha", h.len(), alpha.len())?;
        for (i, (alpha, &h)) in alpha.iter_mut().zip(h).enumerate() {
            *alpha = self.sample(ln_odds(h), noise_of(u, i));
        }
        Ok(())
    }

    /// Backward twin of [`BinaryConcrete::forward`]: adds into `h_bar` `[n]`. The random numbers are constants.
    ///
    /// # Errors
    /// As [`BinaryConcrete::forward`].
    pub fn backward(self, h: &[f32], u: Option<&[f32]>, alpha_bar: &[f32], h_bar: &mut [f32]) -> Result<(), LossError> {
        self.check(h, u)?;
        same("alpha_bar", h.len(), alpha_bar.len())?;
        same("h_bar", h.len(), h_bar.len())?;
        for (i, ((h_bar, &h), &bar)) in h_bar.iter_mut().zip(h).zip(alpha_bar).enumerate() {
            *h_bar += bar * self.sample_derivative(ln_odds(h), noise_of(u, i)) * ln_odds_derivative(h);
        }
        Ok(())
    }

    fn check(self, h: &[f32], u: Option<&[f32]>) -> Result<(), LossError> {
        if !(self.temperature > 0.0 && self.temperature.is_finite()) {
            let (what, value) = ("`temperature` of Binary Concrete", self.temperature);
            return Err(LossError::Parameter { what, value, range: "a finite number above 0" });
        }
        u.map_or(Ok(()), |u| same("u", h.len(), u.len()))
    }
}

#[inline(always)]
fn noise_of(u: Option<&[f32]>, i: usize) -> f32 {
    u.map_or(0.0, |u| noise(u[i]))
}
