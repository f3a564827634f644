//! Ha-NeRF, and its ablations Ha-NeRF(A) (light alone) and Ha-NeRF(T) (strangers alone).
//!
//! Chen, Zhang, Li, Chen, Feng, Wang, Wang, "Hallucinated Neural Radiance Fields in the Wild", 2022, section 3.
//!
//! The light of a photo is what an encoder sees in it, so that a photo nobody trained on has a light, too. Strangers are
//! found in the plane of the photo: a network says how far each pixel is left out, which costs in turn:
//!
//! ```text
//! L = (1 - m) |C - Y|^2 + 2 lambda m^2        at best  m = min(1, |C - Y|^2 / (4 lambda))
//! ```
//!
//! `lambda` falls over the first steps: while the scene is not there yet nothing fits it, and all would be left out. On the fast
//! field what is not left out costs the scene a robust error (`kernel`), as the network needs its time to find strangers;
//! what the network learns from stays the square.
//!
//! Now and then a lattice of a photo's pixels is rendered in the light of another photo, in which the encoder should find that
//! light again (`consistency.rs`; on the fast field alone).
//!
//! The published networks learn from one lattice of one photo in a step, as published. The fast field learns from random pixels
//! of all photos and free codes, which the encoder learns to say (`encoder.rs`): docs/decisions/0015-ha-nerf-on-a-fast-field.md.

use super::config::{OccluderKind, WildConfig};
use super::light::Light;
use super::robust;
use super::visibility::Visibility;
use crate::method::{Codes, Drawing, Method, Outcome, Pixel, PixelBar, Relit, SecondLight, ViewSeen};
use engine::data::{Batch, Dataset};
use engine::system::{SystemError, Tensor, TensorMap};
use losses::kernel::Kernel;

/// The method.
pub(super) struct HaNerf {
    light: Option<Light>,
    visibility: Option<Visibility>,
    /// What an error costs the scene.
    kernel: Kernel,
}

impl HaNerf {
    pub(super) fn new(
        config: &WildConfig,
        light: Option<Light>,
        data: &Dataset,
        seed: u64,
    ) -> Result<Self, SystemError> {
        let visible = config.occluders == OccluderKind::Visibility;
        let visibility = visible.then(|| Visibility::new(config, data, seed)).transpose()?;
        let kernel = config.robust_kernel();
        Ok(Self { light, visibility, kernel })
    }
}

impl Method for HaNerf {
    fn name(&self) -> &'static str {
        match (&self.light, &self.visibility) {
            (Some(_), Some(_)) => "ha-nerf",
            (_, None) => "ha-nerf-a",
            (None, Some(_)) => "ha-nerf-t",
        }
    }

    fn appearance(&self) -> Option<Codes<'_>> {
        self.light.as_ref().map(Light::codes)
    }

    fn learning_appearance(&self) -> Option<Codes<'_>> {
        self.light.as_ref().map(Light::learning_codes)
    }

    fn drawing(&self) -> Drawing {
        self.light.as_ref().map_or(Drawing::Pixels, Light::drawing)
    }

    fn begin(&mut self, data: &Dataset, batch: &mut Batch, step: u64) -> Result<(), SystemError> {
        if let Some(visibility) = &mut self.visibility {
            visibility.begin(batch, step);
        }
        self.light.as_mut().map_or(Ok(()), |light| light.begin(data, batch, step))
    }

    fn loss(&self, i: usize, pixel: &Pixel, truth: [f32; 3]) -> (f32, PixelBar) {
        let (weight, size) = self.visibility.as_ref().map_or((1.0, 0.0), |visibility| visibility.weight(i));
        let (loss, bar) = robust(self.kernel, pixel.rgb, truth, weight);
        (loss + size, bar)
    }

    fn coarse_loss(&self, i: usize, rgb: [f32; 3], truth: [f32; 3]) -> (f32, [f32; 3]) {
        let (weight, _) = self.visibility.as_ref().map_or((1.0, 0.0), |visibility| visibility.weight(i));
        let (loss, bar) = robust(self.kernel, rgb, truth, weight);
        (loss, bar.rgb)
    }

    fn second_light(&self, step: u64) -> Option<SecondLight> {
        self.light.as_ref()?.second_light(step)
    }

    fn judge_second(&mut self, relit: &Relit<'_>) -> Vec<[f32; 3]> {
        self.light.as_mut().map_or_else(|| vec![[0.0; 3]; relit.other.len()], |light| light.judge_second(relit))
    }

    fn learn(&mut self, outcome: &Outcome<'_>) -> usize {
        let light = self.light.as_mut().map_or(0, |light| light.learn(outcome));
        light + self.visibility.as_mut().map_or(0, |visibility| visibility.learn(outcome))
    }

    fn visibility(&self, seen: &ViewSeen<'_>) -> Option<Vec<f32>> {
        let mut out = self.visibility.as_ref()?.of_view(seen);
        out.iter_mut().for_each(|m| *m = if *m < 0.5 { 1.0 } else { 0.0 });
        Some(out)
    }

    fn encode(&self, photo: &scene_io::Image) -> Option<Vec<f32>> {
        self.light.as_ref()?.encode(photo)
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        let mut out = Vec::new();
        self.light.iter().for_each(|light| light.push_state(&mut out));
        self.visibility.iter().for_each(|visibility| visibility.push_state(&mut out));
        out
    }

    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        self.light.as_mut().map_or(Ok(()), |light| light.load_state(state))?;
        self.visibility.as_mut().map_or(Ok(()), |visibility| visibility.load_state(state))
    }

    fn parameter_count(&self) -> usize {
        self.light.as_ref().map_or(0, Light::len) + self.visibility.as_ref().map_or(0, Visibility::len)
    }

    fn memory_bytes(&self) -> usize {
        self.light.as_ref().map_or(0, Light::bytes) + self.visibility.as_ref().map_or(0, Visibility::bytes)
    }
}
