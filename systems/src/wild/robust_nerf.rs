//! RobustNeRF: what does not fit is left out.
//!
//! Sabour, Vora, Duckworth, Krasin, Fleet, Tagliasacchi, "RobustNeRF: Ignoring Distractors with Robust Losses", 2023,
//! section 4.
//!
//! Training by iteratively reweighted least squares: the loss of a ray is `w |C - Y|^2`, its weight found from residuals and
//! held fixed while it is learnt from. Trimming makes weights 0 or 1: residuals below a threshold are inliers, smoothed over
//! neighbours, and patches that are mostly inliers count as a whole, as distractors hang together and fine texture does not.
//!
//! * `judging = "batch"`, as published: batches are made of patches, each rendered before it is learnt from.
//! * `judging = "photos"`: all photos are compared with what the field renders there, more and more seldom
//!   ([`super::photo_judge`]), and batches stay random pixels. Why: `docs/decisions/0014-robust-nerf-by-photos.md`.
//! * `judging = "never"`: each ray is weighed by its own residual alone.
//!
//! What is not left out costs what `kernel` says; squared as published.

use super::config::{Judging, WildConfig};
use super::light::Light;
use super::photo_judge::{Backdrop, PhotoJudge, light_of, mask_of};
use super::static_maps::StaticMaps;
use super::{is_doubled, residual, robust, survey_stride};
use crate::method::{Codes, Drawing, Method, Outcome, Pixel, PixelBar, Relit, SecondLight, ViewSeen};
use engine::data::{Batch, Dataset, Patches, Shape};
use engine::system::{SystemError, Tensor, TensorMap, f32_tensor, take_f32};
use losses::heuristics::Extent;
use losses::kernel::Kernel;
use losses::trimmed::TrimmedMask;

/// Patches of a batch at least: one photo alone says little about the others.
const LEAST_PATCHES: usize = 16;

/// The method.
pub(super) struct RobustNerf {
    light: Option<Light>,
    kernel: Kernel,
    mask: TrimmedMask,
    judging: Judging,
    /// By batch: the threshold in units of the residual that `mask.quantile` of the rays do not exceed.
    scale: f32,
    /// By batch: residual below which a ray was an inlier when last judged.
    threshold: f32,
    /// By photos: steps before the first judgement, and its threshold in units of what is expected.
    judge_first: u64,
    judge_scale: f32,
    stride: u32,
    judge: PhotoJudge,
    maps: StaticMaps,
    /// By batch: weight of each pixel.
    weights: Vec<f32>,
    residuals: Vec<f32>,
    voters: Vec<f32>,
    scratch: Vec<f32>,
}

impl RobustNerf {
    pub(super) fn new(
        config: &WildConfig,
        light: Option<Light>,
        data: &Dataset,
        backdrop: Backdrop,
    ) -> Result<Self, SystemError> {
        let kernel = config.robust_kernel();
        let mask = config.trimming();
        let smallest = data.views().iter().map(|v| v.camera.width.min(v.camera.height)).min().unwrap_or(u32::MAX);
        if config.draws_patches() && (smallest as usize) < config.patch {
            let problem = format!("a photo's shorter side is {smallest} pixels: patches must fit into it");
            return Err(SystemError::Config { field: "patch", value: config.patch.to_string(), problem });
        }
        let [weights, residuals, voters, scratch] = [const { Vec::new() }; 4];
        let judge = PhotoJudge::new(backdrop, light_of(light.as_ref()));
        Ok(Self {
            light,
            kernel,
            mask,
            scale: config.trim_scale,
            judging: config.judging,
            threshold: f32::INFINITY,
            judge_first: config.judge_first,
            judge_scale: config.judge_scale,
            stride: survey_stride(data),
            judge,
            maps: StaticMaps::default(),
            weights,
            residuals,
            voters,
            scratch,
        })
    }
}

impl Method for RobustNerf {
    fn name(&self) -> &'static str {
        "robust-nerf"
    }

    fn appearance(&self) -> Option<Codes<'_>> {
        self.light.as_ref().map(Light::codes)
    }

    fn learning_appearance(&self) -> Option<Codes<'_>> {
        self.light.as_ref().map(Light::learning_codes)
    }

    fn drawing(&self) -> Drawing {
        if self.judging == Judging::Batch {
            Drawing::Patches(Patches { shape: Shape::Window, side: self.mask.patch as u32 }, LEAST_PATCHES)
        } else {
            self.light.as_ref().map_or(Drawing::Pixels, Light::drawing)
        }
    }

    fn begin(&mut self, data: &Dataset, batch: &mut Batch, step: u64) -> Result<(), SystemError> {
        self.maps.leave_out(batch);
        self.light.as_mut().map_or(Ok(()), |light| light.begin(data, batch, step))
    }

    fn looks_ahead(&self, _step: u64) -> bool {
        self.judging == Judging::Batch
    }

    fn judge(&mut self, batch: &Batch, _step: u64, pixels: &[Pixel], truth: &[[f32; 3]]) {
        self.residuals.clear();
        self.residuals.extend(pixels.iter().zip(truth).map(|(pixel, &truth)| residual(pixel.rgb, truth)));
        // Where a photo is transparent nothing stands: such pixels fit from the start and say nothing about the others.
        let votes = |i: &usize| batch.weight[*i] > 0.0 && batch.alpha[*i] > 0.0;
        self.voters.clear();
        self.voters.extend((0..batch.len()).filter(votes).map(|i| self.residuals[i]));
        self.threshold = self.scale * self.mask.threshold(&self.voters, &mut self.scratch);
        self.weights.resize(batch.len(), 0.0);
        let fits = "patches are whole, and the settings are checked before";
        self.mask.weights(&self.residuals, self.threshold, &mut self.scratch, &mut self.weights).expect(fits);
    }

    fn survey(&self, step: u64) -> Option<u32> {
        (self.judging == Judging::Photos && is_doubled(step, self.judge_first)).then_some(self.stride)
    }

    fn look(&mut self, data: &Dataset, seen: &ViewSeen<'_>) -> Result<(), SystemError> {
        self.judge.look(data, seen);
        Ok(())
    }

    fn surveyed(&mut self) {
        let maps = self.judge.judge(&self.mask, self.judge_scale);
        self.maps.set_all(maps.into_iter().map(|judged| judged.whole).collect());
    }

    fn loss(&self, i: usize, pixel: &Pixel, truth: [f32; 3]) -> (f32, PixelBar) {
        robust(self.kernel, pixel.rgb, truth, self.weights.get(i).copied().unwrap_or(1.0))
    }

    fn coarse_loss(&self, i: usize, rgb: [f32; 3], truth: [f32; 3]) -> (f32, [f32; 3]) {
        let (loss, bar) = self.loss(i, &Pixel { rgb, ..Pixel::default() }, truth);
        (loss, bar.rgb)
    }

    fn second_light(&self, step: u64) -> Option<SecondLight> {
        self.light.as_ref()?.second_light(step)
    }

    fn judge_second(&mut self, relit: &Relit<'_>) -> Vec<[f32; 3]> {
        self.light.as_mut().map_or_else(|| vec![[0.0; 3]; relit.other.len()], |light| light.judge_second(relit))
    }

    fn learn(&mut self, outcome: &Outcome<'_>) -> usize {
        self.light.as_mut().map_or(0, |light| light.learn(outcome))
    }

    fn visibility(&self, seen: &ViewSeen<'_>) -> Option<Vec<f32>> {
        match self.judging {
            Judging::Never => None,
            Judging::Photos => self.maps.pixels(seen.view, seen.size),
            Judging::Batch => {
                let [width, height] = seen.size;
                let of = |(pixel, &truth): (&Pixel, &[f32; 3])| residual(pixel.rgb, truth);
                let residuals: Vec<f32> = seen.pixels.iter().zip(seen.truth).map(of).collect();
                let mask = mask_of(&self.mask, self.threshold, Extent { width, height }, &residuals);
                Some(mask.into_iter().map(f32::from).collect())
            }
        }
    }

    fn encode(&self, photo: &scene_io::Image) -> Option<Vec<f32>> {
        self.light.as_ref()?.encode(photo)
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        let mut out = vec![f32_tensor("robust.threshold", std::slice::from_ref(&self.threshold))];
        self.maps.push_state("static", &mut out);
        self.light.iter().for_each(|light| light.push_state(&mut out));
        out
    }

    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        self.threshold = take_f32(state, "robust.threshold", 1)?[0];
        self.maps.load_state("static", state)?;
        self.light.as_mut().map_or(Ok(()), |light| light.load_state(state))
    }

    fn parameter_count(&self) -> usize {
        self.light.as_ref().map_or(0, Light::len)
    }

    fn memory_bytes(&self) -> usize {
        let buffers = self.weights.capacity() + 3 * self.residuals.capacity();
        self.light.as_ref().map_or(0, Light::bytes) + 4 * buffers + self.maps.bytes()
    }
}
