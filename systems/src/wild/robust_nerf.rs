//! RobustNeRF: what does not fit is left out.
//!
//! Sabour, Vora, Duckworth, Krasin, Fleet, Tagliasacchi, "RobustNeRF: Ignoring Distractors with Robust Losses", 2023,
//! section 4.
//!
//! Training by iteratively reweighted least squares: the loss of a ray is `w |C - Y|^2`, its weight found from residuals and
//! held fixed while it is learnt from. With `kernel = "trimmed"` weights are 0 or 1: rays with a residual below a quantile of
//! all are inliers, smoothed over neighbours, and patches that are mostly inliers count as a whole, as distractors hang
//! together and fine texture does not. The other kernels weigh each ray by its own residual.
//!
//! * `judging = "batch"`, as published: batches are made of patches, each rendered before it is learnt from.
//! * `judging = "photos"`: from time to time all photos are compared with what the field renders there, square by square, and
//!   batches stay random pixels. The residual of a square is that of means over its neighbourhood: texture that is not learnt
//!   yet errs both ways and averages out, a stranger does not. Why: `docs/decisions/0014-robust-nerf-by-photos.md`.

use super::config::{Judging, KernelKind, WildConfig};
use super::light::Light;
use super::static_maps::{StaticMap, StaticMaps};
use super::{squared, survey_stride};
use crate::data::{Batch, Dataset, Patches, Shape};
use crate::method::{Codes, Drawing, Method, Outcome, Pixel, PixelBar, ViewSeen};
use crate::system::{SystemError, Tensor, TensorMap, f32_tensor, take_f32};
use losses::heuristics::{Extent, erode};
use losses::kernel::Kernel;
use losses::trimmed::TrimmedMask;

/// Patches of a batch at least: one photo alone says little about the others.
const LEAST_PATCHES: usize = 16;
/// Squares along a side of the neighbourhood whose mean is judged.
pub(super) const NEIGHBOURHOOD: usize = 3;
/// Static squares beside a stranger are left out too: his outline does not follow the squares.
const MARGIN: usize = 3;

/// The method.
pub(super) struct RobustNerf {
    light: Option<Light>,
    kernel: Option<Kernel>,
    mask: TrimmedMask,
    /// Threshold in units of the residual that `mask.quantile` of the rays do not exceed.
    scale: f32,
    judging: Judging,
    judge_every: u64,
    stride: u32,
    /// Residual below which a ray was an inlier when last judged.
    threshold: f32,
    maps: StaticMaps,
    /// Residuals of the photos of a survey.
    surveyed: Vec<Surveyed>,
    /// Weight of each pixel of the batch.
    weights: Vec<f32>,
    residuals: Vec<f32>,
    voters: Vec<f32>,
    scratch: Vec<f32>,
}

/// A photo of a survey.
struct Surveyed {
    size: [usize; 2],
    stride: usize,
    residuals: Vec<f32>,
}

/// `|C - Y|`.
fn residual(pixel: &Pixel, truth: [f32; 3]) -> f32 {
    (0..3).map(|c| (pixel.rgb[c] - truth[c]).powi(2)).sum::<f32>().sqrt()
}

/// `|mean(C - Y)|` over a square neighbourhood of each pixel, cut off at the borders.
pub(super) fn mean_residuals(seen: &ViewSeen<'_>, side: usize) -> Vec<f32> {
    let [width, height] = seen.size;
    // Sums over all pixels above and to the left.
    let mut sums = vec![[0.0_f64; 3]; (width + 1) * (height + 1)];
    for y in 0..height {
        let mut row = [0.0; 3];
        for x in 0..width {
            let (i, at) = (y * width + x, (y + 1) * (width + 1) + x + 1);
            for c in 0..3 {
                row[c] += f64::from(seen.pixels[i].rgb[c] - seen.truth[i][c]);
                sums[at][c] = sums[at - width - 1][c] + row[c];
            }
        }
    }
    let reach = side / 2;
    (0..width * height)
        .map(|i| {
            let (x, y) = (i % width, i / width);
            let (x0, x1) = (x.saturating_sub(reach), (x + reach + 1).min(width));
            let (y0, y1) = (y.saturating_sub(reach), (y + reach + 1).min(height));
            let at = |x: usize, y: usize, c: usize| sums[y * (width + 1) + x][c];
            let count = ((x1 - x0) * (y1 - y0)) as f64;
            let mean = |c| (at(x1, y1, c) - at(x0, y1, c) - at(x1, y0, c) + at(x0, y0, c)) / count;
            (0..3).map(|c| mean(c).powi(2)).sum::<f64>().sqrt() as f32
        })
        .collect()
}

impl RobustNerf {
    pub(super) fn new(config: &WildConfig, light: Option<Light>, data: &Dataset) -> Result<Self, SystemError> {
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
        let smallest = data.views().iter().map(|v| v.camera.width.min(v.camera.height)).min().unwrap_or(u32::MAX);
        if config.draws_patches() && (smallest as usize) < config.patch {
            let problem = format!("a photo's shorter side is {smallest} pixels: patches must fit into it");
            return Err(SystemError::Config { field: "patch", value: config.patch.to_string(), problem });
        }
        let [weights, residuals, voters, scratch] = [const { Vec::new() }; 4];
        Ok(Self {
            light,
            kernel,
            mask,
            scale: config.trim_scale,
            judging: config.judging,
            judge_every: config.judge_every,
            stride: survey_stride(data),
            threshold: f32::INFINITY,
            maps: StaticMaps::default(),
            surveyed: Vec::new(),
            weights,
            residuals,
            voters,
            scratch,
        })
    }

    fn trims(&self, judging: Judging) -> bool {
        self.kernel.is_none() && self.judging == judging
    }

    /// The mask of a whole picture: whole patches; the last of a row or column reaches over what the one before it covers.
    fn mask_of(&self, [width, height]: [usize; 2], residuals: &[f32]) -> Vec<u8> {
        let side = self.mask.patch;
        let mut out = vec![1; width * height];
        let starts = |size: usize| (0..size.div_ceil(side)).map(move |k| (k * side).min(size.saturating_sub(side)));
        let (mut scratch, mut weights, mut patch) = (Vec::new(), vec![0.0; side * side], vec![0.0; side * side]);
        for y in starts(height) {
            for x in starts(width) {
                let at = |k: usize| (y + k / side).min(height - 1) * width + (x + k % side).min(width - 1);
                patch.iter_mut().enumerate().for_each(|(k, e)| *e = residuals[at(k)]);
                let fits = "a patch is whole, and the settings are checked before";
                self.mask.weights(&patch, self.threshold, &mut scratch, &mut weights).expect(fits);
                (0..side * side).for_each(|k| out[at(k)] = u8::from(weights[k] > 0.0));
            }
        }
        out
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
        if self.trims(Judging::Batch) {
            Drawing::Patches(Patches { shape: Shape::Window, side: self.mask.patch as u32 }, LEAST_PATCHES)
        } else {
            self.light.as_ref().map_or(Drawing::Pixels, Light::drawing)
        }
    }

    fn begin(&mut self, data: &Dataset, batch: &Batch, _step: u64) -> Result<(), SystemError> {
        if self.trims(Judging::Photos) {
            self.maps.weigh(batch, &mut self.weights);
        }
        self.light.as_mut().map_or(Ok(()), |light| light.begin(data, batch))
    }

    fn looks_ahead(&self, _step: u64) -> bool {
        self.trims(Judging::Batch)
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

    fn survey(&self, step: u64) -> Option<u32> {
        (self.trims(Judging::Photos) && step > 0 && step.is_multiple_of(self.judge_every)).then_some(self.stride)
    }

    fn look(&mut self, _data: &Dataset, seen: &ViewSeen<'_>) -> Result<(), SystemError> {
        let residuals = mean_residuals(seen, NEIGHBOURHOOD);
        self.voters.extend(residuals.iter().zip(seen.alpha).filter(|(_, a)| **a > 0.0).map(|(e, _)| e));
        self.surveyed.push(Surveyed { size: seen.size, stride: seen.stride, residuals });
        Ok(())
    }

    fn surveyed(&mut self) {
        self.threshold = self.scale * self.mask.threshold(&self.voters, &mut self.scratch);
        self.voters.clear();
        let photos = std::mem::take(&mut self.surveyed);
        for (view, photo) in photos.iter().enumerate() {
            let [width, height] = photo.size;
            let mask = self.mask_of(photo.size, &photo.residuals);
            let mut bits = vec![0; mask.len()];
            let fits = "a mask for each square, and an odd margin";
            erode(Extent { width, height }, MARGIN, &mask, &mut Vec::new(), &mut bits).expect(fits);
            self.maps.set(photos.len(), view, StaticMap { width, stride: photo.stride, bits });
        }
    }

    fn loss(&self, i: usize, pixel: &Pixel, truth: [f32; 3]) -> (f32, PixelBar) {
        let Some(kernel) = self.kernel else { return squared(pixel.rgb, truth, self.weights[i]) };
        let e = residual(pixel, truth);
        let w = kernel.weight(e, 0.0);
        // The derivative of kernel(|C - Y|): its weight times the error.
        (kernel.value(e, 0.0), PixelBar::colour([0, 1, 2].map(|c| w * (pixel.rgb[c] - truth[c]))))
    }

    fn coarse_loss(&self, i: usize, rgb: [f32; 3], truth: [f32; 3]) -> (f32, [f32; 3]) {
        let (loss, bar) = self.loss(i, &Pixel { rgb, ..Pixel::default() }, truth);
        (loss, bar.rgb)
    }

    fn learn(&mut self, outcome: &Outcome<'_>) -> usize {
        self.light.as_mut().map_or(0, |light| light.learn(outcome))
    }

    fn visibility(&self, seen: &ViewSeen<'_>) -> Option<Vec<f32>> {
        if self.kernel.is_some() {
            return None;
        }
        let residuals = match self.judging {
            Judging::Photos => mean_residuals(seen, NEIGHBOURHOOD * self.stride as usize / seen.stride),
            Judging::Batch => seen.pixels.iter().zip(seen.truth).map(|(pixel, &t)| residual(pixel, t)).collect(),
        };
        Some(self.mask_of(seen.size, &residuals).into_iter().map(f32::from).collect())
    }

    fn encode(&self, photo: &scene_io::Image) -> Option<Vec<f32>> {
        self.light.as_ref()?.encode(photo)
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        let mut out = vec![f32_tensor("robust.threshold", std::slice::from_ref(&self.threshold))];
        self.maps.push_state(&mut out);
        self.light.iter().for_each(|light| light.push_state(&mut out));
        out
    }

    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        self.threshold = take_f32(state, "robust.threshold", 1)?[0];
        self.maps.load_state(state)?;
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
