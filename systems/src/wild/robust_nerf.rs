//! RobustNeRF: what does not fit is left out.
//!
//! Sabour, Vora, Duckworth, Krasin, Fleet, Tagliasacchi, "RobustNeRF: Ignoring Distractors with Robust Losses", 2023,
//! section 4.
//!
//! Training by iteratively reweighted least squares: the loss of a ray is `w |C - Y|^2`, its weight found from the residuals
//! of the batch before anything is learnt from it. With `kernel = "trimmed"` weights are 0 or 1: rays below the batch's
//! median residual are inliers, smoothed over neighbours, and patches that are mostly inliers count as a whole, as
//! distractors hang together and fine texture does not. The other kernels weigh each ray by its own residual.

use super::config::{KernelKind, WildConfig};
use super::light::Light;
use super::squared;
use crate::data::{Batch, Dataset, Patches, Shape};
use crate::method::{Codes, Drawing, Method, Outcome, Pixel, PixelBar, ViewSeen};
use crate::system::{SystemError, Tensor, TensorMap, f32_tensor, take_f32};
use losses::kernel::Kernel;
use losses::trimmed::TrimmedMask;

/// Patches of a batch at least: one photo alone says little about the others.
const LEAST_PATCHES: usize = 16;

/// The method.
pub(super) struct RobustNerf {
    light: Option<Light>,
    kernel: Option<Kernel>,
    mask: TrimmedMask,
    /// Threshold in units of the residual that `mask.quantile` of the rays do not exceed.
    scale: f32,
    /// Residual below which a ray of the last batch was an inlier.
    threshold: f32,
    /// Weight of each pixel of the batch.
    weights: Vec<f32>,
    residuals: Vec<f32>,
    voters: Vec<f32>,
    scratch: Vec<f32>,
}

/// `|C - Y|`.
fn residual(pixel: &Pixel, truth: [f32; 3]) -> f32 {
    (0..3).map(|c| (pixel.rgb[c] - truth[c]).powi(2)).sum::<f32>().sqrt()
}

impl RobustNerf {
    pub(super) fn new(config: &WildConfig, light: Option<Light>) -> Result<Self, SystemError> {
        let c = config.kernel_scale;
        let kernel = match config.kernel {
            KernelKind::Trimmed => None,
            KernelKind::L1 => Some(Kernel::L1),
            KernelKind::Charbonnier => Some(Kernel::Charbonnier { c }),
            KernelKind::Cauchy => Some(Kernel::Cauchy { c }),
            KernelKind::GemanMcClure => Some(Kernel::GemanMcClure { c }),
            KernelKind::Welsch => Some(Kernel::Welsch { c }),
        };
        let mask = TrimmedMask {
            quantile: config.trim_quantile,
            diffuse: config.trim_diffuse,
            vote: config.trim_vote,
            patch: config.patch,
            inner: config.patch_inner,
            ..TrimmedMask::default()
        };
        let bad = |e: losses::LossError| SystemError::Config {
            field: "kernel_scale, trim_quantile, trim_diffuse, trim_vote, patch, patch_inner",
            value: String::new(),
            problem: e.to_string(),
        };
        kernel.map_or(Ok(()), Kernel::check).map_err(bad)?;
        mask.check().map_err(bad)?;
        let [weights, residuals, voters, scratch] = [const { Vec::new() }; 4];
        let scale = config.trim_scale;
        Ok(Self { light, kernel, mask, scale, threshold: f32::INFINITY, weights, residuals, voters, scratch })
    }
}

impl Method for RobustNerf {
    fn name(&self) -> &'static str {
        "robust-nerf"
    }

    fn appearance(&self) -> Option<Codes<'_>> {
        self.light.as_ref().map(Light::codes)
    }

    fn drawing(&self) -> Drawing {
        match self.kernel {
            Some(_) => self.light.as_ref().map_or(Drawing::Pixels, Light::drawing),
            None => Drawing::Patches(Patches { shape: Shape::Window, side: self.mask.patch as u32 }, LEAST_PATCHES),
        }
    }

    fn begin(&mut self, data: &Dataset, batch: &Batch, _step: u64) -> Result<(), SystemError> {
        self.light.as_mut().map_or(Ok(()), |light| light.begin(data, batch))
    }

    fn looks_ahead(&self, _step: u64) -> bool {
        self.kernel.is_none()
    }

    fn judge(&mut self, batch: &Batch, _step: u64, pixels: &[Pixel], truth: &[[f32; 3]]) {
        self.residuals.clear();
        self.residuals.extend(pixels.iter().zip(truth).map(|(pixel, &truth)| residual(pixel, truth)));
        // Where a photo is transparent nothing stands: such pixels fit from the start and say nothing about the others.
        let votes = |i: &usize| batch.weight[*i] > 0.0 && batch.alpha[*i] > 0.0;
        self.voters.clear();
        self.voters.extend((0..batch.len()).filter(votes).map(|i| self.residuals[i]));
        self.threshold = self.scale * self.mask.threshold(&self.voters, &mut self.scratch);
        self.weights.resize(batch.len(), 0.0);
        let fits = "patches are whole, and the settings are checked before";
        self.mask.weights(&self.residuals, self.threshold, &mut self.scratch, &mut self.weights).expect(fits);
    }

    fn loss(&self, i: usize, pixel: &Pixel, truth: [f32; 3]) -> (f32, PixelBar) {
        let Some(kernel) = self.kernel else { return squared(pixel.rgb, truth, self.weights[i]) };
        let e = residual(pixel, truth);
        let w = kernel.weight(e, 0.0);
        // The derivative of kernel(|C - Y|): its weight times the error.
        (kernel.value(e, 0.0), PixelBar::colour([0, 1, 2].map(|c| w * (pixel.rgb[c] - truth[c]))))
    }

    fn coarse_loss(&self, i: usize, rgb: [f32; 3], truth: [f32; 3]) -> (f32, [f32; 3]) {
        let pixel = Pixel { rgb, ..Pixel::default() };
        let (loss, bar) = self.loss(i, &pixel, truth);
        (loss, bar.rgb)
    }

    fn learn(&mut self, outcome: &Outcome<'_>) -> usize {
        self.light.as_mut().map_or(0, |light| light.learn(outcome))
    }

    fn visibility(&self, seen: &ViewSeen<'_>) -> Option<Vec<f32>> {
        if self.kernel.is_some() {
            return None;
        }
        let [width, height] = seen.size;
        let side = self.mask.patch;
        let mut out = vec![1.0; width * height];
        // Whole patches; the last of a row or column reaches over what the one before it covers.
        let starts = |size: usize| (0..size.div_ceil(side)).map(move |k| (k * side).min(size.saturating_sub(side)));
        let (mut scratch, mut weights) = (Vec::new(), vec![0.0; side * side]);
        for y in starts(height) {
            for x in starts(width) {
                let at = |k: usize| (y + k / side).min(height - 1) * width + (x + k % side).min(width - 1);
                let residuals: Vec<f32> =
                    (0..side * side).map(|k| residual(&seen.pixels[at(k)], seen.truth[at(k)])).collect();
                self.mask.weights(&residuals, self.threshold, &mut scratch, &mut weights).ok()?;
                (0..side * side).for_each(|k| out[at(k)] = weights[k]);
            }
        }
        Some(out)
    }

    fn encode(&self, photo: &scene_io::Image) -> Option<Vec<f32>> {
        self.light.as_ref()?.encode(photo)
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        let mut out = vec![f32_tensor("robust.threshold", std::slice::from_ref(&self.threshold))];
        self.light.iter().for_each(|light| light.push_state(&mut out));
        out
    }

    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        self.threshold = take_f32(state, "robust.threshold", 1)?[0];
        self.light.as_mut().map_or(Ok(()), |light| light.load_state(state))
    }

    fn parameter_count(&self) -> usize {
        self.light.as_ref().map_or(0, Light::len)
    }

    fn memory_bytes(&self) -> usize {
        self.light.as_ref().map_or(0, Light::bytes) + 4 * (self.weights.capacity() + 3 * self.residuals.capacity())
    }
}
