//! NeRF in the Wild, and its ablations NeRF-A (light alone) and NeRF-U (strangers alone).
//!
//! Martin-Brualla, Radwan, Sajjadi, Barron, Dosovitskiy, Duckworth, "NeRF in the Wild: Neural Radiance Fields for
//! Unconstrained Photo Collections", 2021, section 4.
//!
//! Each photo has an appearance code, on which colours depend, and a transient code: with it a second, transient field
//! explains what is in this photo alone, composited together with the static one, and says how uncertain its colours are.
//! The loss is the likelihood of the photo under that uncertainty:
//!
//! ```text
//! L = |C - Y|^2 / (2 beta^2) + ln beta + lambda_u mean(sigma_t)        beta = beta_min + sum(w_t beta_t)
//! ```
//!
//! A picture from elsewhere shows the static field alone, with a transmittance of its own.

use super::codes::CodeTable;
use super::config::{OccluderKind, WildConfig};
use super::light::Light;
use super::likelihood::{self, Unlikely};
use super::robust;
use crate::method::{Codes, Drawing, Method, Outcome, Pixel, PixelBar, Relit, SecondLight, ViewSeen};
use engine::data::{Batch, Dataset};
use engine::system::{SystemError, Tensor, TensorMap};
use losses::kernel::Kernel;
use losses::uncertainty::Likelihood;

/// The method.
pub(super) struct NerfW {
    light: Option<Light>,
    strangers: Option<Strangers>,
    /// What an error costs where there are no strangers.
    kernel: Kernel,
}

/// What the transient field of each photo depends on, and how it is held back.
struct Strangers {
    codes: CodeTable,
    lr: f64,
    likelihood: Likelihood,
    lambda_u: f32,
}

impl NerfW {
    pub(super) fn new(config: &WildConfig, light: Option<Light>, data: &Dataset, seed: u64) -> Self {
        let strangers = (config.occluders == OccluderKind::Transient).then(|| Strangers {
            codes: CodeTable::new("transient", data.len(), config.transient_dims, seed),
            lr: f64::from(config.transient_lr),
            likelihood: likelihood::likelihood(config),
            lambda_u: config.lambda_u,
        });
        Self { light, strangers, kernel: config.robust_kernel() }
    }
}

impl Method for NerfW {
    fn name(&self) -> &'static str {
        match (&self.light, &self.strangers) {
            (Some(_), Some(_)) => "nerf-w",
            (_, None) => "nerf-a",
            (None, Some(_)) => "nerf-u",
        }
    }

    fn appearance(&self) -> Option<Codes<'_>> {
        self.light.as_ref().map(Light::codes)
    }

    fn learning_appearance(&self) -> Option<Codes<'_>> {
        self.light.as_ref().map(Light::learning_codes)
    }

    fn transient(&self) -> Option<Codes<'_>> {
        self.strangers.as_ref().map(|s| s.codes.codes())
    }

    fn drawing(&self) -> Drawing {
        self.light.as_ref().map_or(Drawing::Pixels, Light::drawing)
    }

    fn begin(&mut self, data: &Dataset, batch: &mut Batch, step: u64) -> Result<(), SystemError> {
        self.light.as_mut().map_or(Ok(()), |light| light.begin(data, batch, step))
    }

    fn loss(&self, _i: usize, pixel: &Pixel, truth: [f32; 3]) -> (f32, PixelBar) {
        let Some(Strangers { likelihood, lambda_u, .. }) = &self.strangers else {
            return robust(self.kernel, pixel.rgb, truth, 1.0);
        };
        let Unlikely { loss, rgb_bar, beta_bar } =
            likelihood::pixel(likelihood, pixel.rgb, truth, likelihood.beta_min + pixel.beta);
        let bar = PixelBar { rgb: rgb_bar, beta: beta_bar, sigma_t: *lambda_u };
        (loss + lambda_u * pixel.sigma_t, bar)
    }

    /// Half of the squared error, which is what the fine look costs where nothing is uncertain (equation 14); without a transient
    /// field as the fine look.
    fn coarse_loss(&self, _i: usize, rgb: [f32; 3], truth: [f32; 3]) -> (f32, [f32; 3]) {
        let e = [0, 1, 2].map(|c| rgb[c] - truth[c]);
        let factor = if self.strangers.is_some() { 0.5 } else { 1.0 };
        (factor * e.iter().map(|e| e * e).sum::<f32>() / 3.0, e.map(|e| factor * 2.0 * e / 3.0))
    }

    fn second_light(&self, step: u64) -> Option<SecondLight> {
        self.light.as_ref()?.second_light(step)
    }

    fn judge_second(&mut self, relit: &Relit<'_>) -> Vec<[f32; 3]> {
        self.light.as_mut().map_or_else(|| vec![[0.0; 3]; relit.other.len()], |light| light.judge_second(relit))
    }

    fn learn(&mut self, outcome: &Outcome<'_>) -> usize {
        let light = self.light.as_mut().map_or(0, |light| light.learn(outcome));
        let strangers = self
            .strangers
            .as_mut()
            .map_or(0, |s| s.codes.learn(outcome.simd, outcome.lr * s.lr, outcome.batch, outcome.transient_bar, 0.0));
        light + strangers
    }

    fn visibility(&self, seen: &ViewSeen<'_>) -> Option<Vec<f32>> {
        self.strangers.as_ref()?;
        Some(seen.pixels.iter().map(|pixel| if pixel.transient < 0.5 { 1.0 } else { 0.0 }).collect())
    }

    fn uncertainty(&self, seen: &ViewSeen<'_>) -> Option<Vec<f32>> {
        let beta_min = self.strangers.as_ref()?.likelihood.beta_min;
        Some(seen.pixels.iter().map(|pixel| beta_min + pixel.beta).collect())
    }

    fn encode(&self, photo: &scene_io::Image) -> Option<Vec<f32>> {
        self.light.as_ref()?.encode(photo)
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        let mut out = Vec::new();
        self.light.iter().for_each(|light| light.push_state(&mut out));
        self.strangers.iter().for_each(|s| s.codes.push_state(&mut out));
        out
    }

    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        self.light.as_mut().map_or(Ok(()), |light| light.load_state(state))?;
        self.strangers.as_mut().map_or(Ok(()), |s| s.codes.load_state(state))
    }

    fn parameter_count(&self) -> usize {
        self.light.as_ref().map_or(0, Light::len) + self.strangers.as_ref().map_or(0, |s| s.codes.len())
    }

    fn memory_bytes(&self) -> usize {
        self.light.as_ref().map_or(0, Light::bytes) + self.strangers.as_ref().map_or(0, |s| s.codes.bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::super::config::{AppearanceKind, FieldKind};
    use super::*;
    use crate::plan::made::{Points, capture};

    #[test]
    fn the_first_look_weighs_half_beside_a_likelihood_and_in_full_beside_squares() {
        let (_, data) = capture(Points::None);
        let (rgb, truth) = ([0.5, 0.75, 0.25], [0.25, 0.75, 0.75]);
        let squares = (0.0625 + 0.25) / 3.0;
        for (occluders, factor) in [(OccluderKind::Transient, 0.5), (OccluderKind::None, 1.0)] {
            let config = WildConfig::new(FieldKind::Mlp, AppearanceKind::None, occluders);
            let method = NerfW::new(&config, None, &data, 0);
            let (loss, bar) = method.coarse_loss(0, rgb, truth);
            assert!((loss - factor * squares).abs() < 1e-7, "{loss}");
            assert!((bar[2] + factor * 2.0 * 0.5 / 3.0).abs() < 1e-7 && bar[1] == 0.0, "{bar:?}");
            // The same as the fine look costs, but for a summand, where the uncertainty is 1 and nothing is transient.
            let fine = |rgb| method.loss(0, &Pixel { rgb, beta: 1.0 - config.beta_min, ..Pixel::default() }, truth).0;
            assert!((fine(rgb) - fine(truth) - loss).abs() < 1e-6, "{}", fine(rgb) - fine(truth));
        }
    }
}
