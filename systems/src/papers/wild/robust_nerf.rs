//! RobustNeRF: outliers are left out.
//!
//! Sabour, Vora, Duckworth, Krasin, Fleet, Tagliasacchi, "RobustNeRF: Ignoring Distractors with Robust Losses", 2023,
//! section 4.
//!
//! Training by iteratively reweighted least squares: the loss of a ray is `w |C - Y|^2`, its weight found from residuals and
//! held fixed while it is learnt from. Trimming makes weights 0 or 1: residuals below a threshold are inliers, smoothed over
//! neighbours, and patches that are mostly inliers count as a whole, as distractors are connected and fine texture is not.
//!
//! * `judging = "batch"`, as published: batches are made of patches, each rendered before it is learnt from.
//! * `judging = "photos"`: all photos are compared with the renders of the field, at ever longer intervals
//!   (`outliers`), and batches stay random pixels. Why: `docs/decisions/0014-robust-nerf-by-photos.md`.
//! * `judging = "never"`: each ray is weighted by its own residual alone.
//!
//! The error of what is not left out is that of `kernel`; squared as published.

use super::nerf_w::{CHARBONNIER, SQUARED};
use super::planning::{Build, Planning};
use crate::claims::Claim;
use crate::limits::{at_least_1, positive, refuse};
use crate::occluders::OccluderModel;
use crate::occluders::outliers::{Expecting, OutlierConfig, PhotoOutliers, SMALL_PHOTO, mask_of};
use crate::occluders::pixel_error::{KernelConfig, kernel_loss, residual};
use crate::occluders::survey::{is_doubled, survey_stride, survey_stride_before_cloud};
use crate::photo_model::{Drawing, PhotoAndRender, Pixel, PixelBar};
use crate::static_maps::StaticMaps;
use engine::data::{Batch, Dataset, Patches, Shape};
use engine::system::{SystemError, Tensor, TensorMap, f32_tensor, take_f32};
use losses::heuristics::Extent;
use losses::kernel::Kernel;
use losses::trimmed::TrimmedMask;
use serde::{Deserialize, Serialize};

/// What differs from the paper.
pub(crate) const CLAIM: Claim = Claim {
    name: "robust-nerf",
    paper: "Sabour et al., 2023",
    what: "What most photos do not show is masked; a robust loss for the rest",
    take: "occluders that differ from photo to photo, one appearance",
    differs: "Masks are found on whole photos from time to time, not in each batch, by a rule of our own, and what is kept \
              has the Charbonnier loss (0.05) instead of the squared error, on ngp's field. `--field mlp` has published networks, \
              batches of patches and the squared error. Below 320 pixels patches are half as large.",
    mark: "own masks, Charbonnier",
};

/// Patches of a batch at least: one photo alone says little about the others.
const LEAST_PATCHES: usize = 16;

/// Before a cloud: the first masks are found after one of so many parts of the field's steps, the last, three doublings later, at its end.
const PARTS: u64 = 8;

/// How outlier rays are detected.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Judging {
    /// From time to time, in all photos beside their renders: batches are random pixels.
    #[default]
    Photos,
    /// In every batch, of patches, before it is learnt from: as published.
    Batch,
    /// They are not.
    Never,
}

/// Settings of the detection.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RobustConfig {
    /// `photos`, `batch` or `never`.
    pub judging: Judging,
    /// By photos: steps before the first detection; the next follows after twice as many, and so on.
    pub judge_first: u64,
    /// By batch: the largest residual of an inlier, in units of the residual that the share `trim_quantile` does not exceed.
    pub trim_scale: f32,
}

impl RobustConfig {
    /// As published (section 4.2).
    pub const PUBLISHED: Self = Self { judging: Judging::Batch, judge_first: 1000, trim_scale: 1.0 };

    /// On the hash grid (`docs/decisions/0014-robust-nerf-by-photos.md`).
    pub const HASH_GRID: Self = Self { judging: Judging::Photos, judge_first: 50, trim_scale: 2.0 };

    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub fn check(&self) -> Result<(), SystemError> {
        at_least_1("judge_first", self.judge_first)?;
        positive("trim_scale", self.trim_scale)
    }
}

/// Settings of the masks, with patches of half the size for small photos.
pub(super) fn trimming(planning: &mut Planning<'_>) -> Result<OutlierConfig, SystemError> {
    let longest = planning.data.longest_side().unwrap_or(0);
    let planned = OutlierConfig::of_photos(longest);
    if longest < SMALL_PHOTO && !planning.is_set("patch") && !planning.is_set("patch_inner") {
        planning.lines.push(format!(
            "patches: {0}x{0}, inner {1}x{1}: half as large as elsewhere (photos of {longest} pixels, below {SMALL_PHOTO})",
            planned.patch, planned.patch_inner
        ));
    }
    let settings: OutlierConfig = planning.settings.of(&planned)?;
    settings.check()?;
    Ok(settings)
}

/// Outliers are left out.
pub(super) fn occluders<'a>(planning: &mut Planning<'a>) -> Result<Build<'a, dyn OccluderModel>, SystemError> {
    let settings: RobustConfig =
        planning.settings.of(&planning.by_field(RobustConfig::HASH_GRID, RobustConfig::PUBLISHED))?;
    settings.check()?;
    let trimming = trimming(planning)?;
    let error: KernelConfig = planning.settings.of(&planning.by_field(CHARBONNIER, SQUARED))?;
    error.check()?;
    let judge = PhotoOutliers::new(planning.backdrop, planning.brightness(), Expecting::All);
    let data = planning.data;
    Ok(Box::new(move || Ok(Box::new(RobustNerf::new(&settings, &trimming, error.kernel(), judge, data)?))))
}

/// The occluder model of a field on the hash grid that is trained for `steps` steps, before a cloud: masks of whole photos, and a robust
/// loss. The last masks are found right before the end of these steps.
pub(crate) fn masking(
    steps: u64,
    trimming: &OutlierConfig,
    judge: PhotoOutliers,
    data: &Dataset,
) -> Result<Box<dyn OccluderModel>, SystemError> {
    let judge_first = (steps.saturating_sub(1) / PARTS).max(1);
    let settings = RobustConfig { judge_first, ..RobustConfig::HASH_GRID };
    let model = RobustNerf::new(&settings, trimming, CHARBONNIER.kernel(), judge, data)?;
    Ok(Box::new(RobustNerf { stride: survey_stride_before_cloud(data), ..model }))
}

/// The weights of rays, and the loss with them.
struct RobustNerf {
    kernel: Kernel,
    mask: TrimmedMask,
    judging: Judging,
    /// By batch: the threshold in units of the residual that `mask.quantile` of the rays do not exceed.
    scale: f32,
    /// By batch: residual below which a ray was an inlier in the last batch.
    threshold: f32,
    /// By photos: steps before the first detection, and its threshold in units of the expected error.
    judge_first: u64,
    judge_scale: f32,
    stride: u32,
    judge: PhotoOutliers,
    maps: StaticMaps,
    /// By batch: weight of each pixel.
    weights: Vec<f32>,
    residuals: Vec<f32>,
    voters: Vec<f32>,
    scratch: Vec<f32>,
}

impl RobustNerf {
    fn new(
        settings: &RobustConfig,
        trimming: &OutlierConfig,
        kernel: Kernel,
        judge: PhotoOutliers,
        data: &Dataset,
    ) -> Result<Self, SystemError> {
        let smallest = data.views().iter().map(|v| v.camera.width.min(v.camera.height)).min().unwrap_or(u32::MAX);
        if settings.judging == Judging::Batch && (smallest as usize) < trimming.patch {
            let problem = format!("a photo's shorter side is {smallest} pixels: patches must fit into it");
            return refuse("patch", trimming.patch, problem);
        }
        let [weights, residuals, voters, scratch] = [const { Vec::new() }; 4];
        Ok(Self {
            kernel,
            mask: trimming.trimming(),
            scale: settings.trim_scale,
            judging: settings.judging,
            threshold: f32::INFINITY,
            judge_first: settings.judge_first,
            judge_scale: trimming.judge_scale,
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

impl OccluderModel for RobustNerf {
    fn survey(&self, step: u64) -> Option<u32> {
        (self.judging == Judging::Photos && is_doubled(step, self.judge_first)).then_some(self.stride)
    }

    fn survey_view(&mut self, data: &Dataset, seen: &PhotoAndRender<'_>) -> Result<(), SystemError> {
        self.judge.add(data, seen, &self.maps);
        Ok(())
    }

    fn surveyed(&mut self) {
        let photos = self.judge.static_parts(&self.mask, self.judge_scale);
        self.maps.set_all(photos.into_iter().map(|photo| photo.whole).collect());
    }

    fn drawing(&self) -> Option<Drawing> {
        let patches = Patches { shape: Shape::Window, side: self.mask.patch as u32 };
        (self.judging == Judging::Batch).then_some(Drawing::Patches(patches, LEAST_PATCHES))
    }

    fn begin(&mut self, batch: &mut Batch, _step: u64) -> Result<(), SystemError> {
        self.maps.leave_out(batch);
        Ok(())
    }

    fn judges_batch(&self) -> bool {
        self.judging == Judging::Batch
    }

    /// Weights of a batch of patches: residuals `|C - Y|`, their quantile, then diffusion and vote ([`losses::trimmed`]).
    fn judge(&mut self, batch: &Batch, pixels: &[Pixel], truth: &[[f32; 3]]) {
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

    /// `w |C - Y|^2`, the square as `kernel` has it.
    fn loss(&self, i: usize, pixel: &Pixel, truth: [f32; 3]) -> (f32, PixelBar) {
        kernel_loss(self.kernel, pixel.rgb, truth, self.weights.get(i).copied().unwrap_or(1.0))
    }

    fn coarse_loss(&self, i: usize, rgb: [f32; 3], truth: [f32; 3]) -> (f32, [f32; 3]) {
        let (loss, bar) = self.loss(i, &Pixel { rgb, ..Pixel::default() }, truth);
        (loss, bar.rgb)
    }

    fn visibility(&self, seen: &PhotoAndRender<'_>) -> Option<Vec<f32>> {
        let [width, height] = seen.size;
        let extent = Extent { width, height };
        match self.judging {
            Judging::Never => None,
            Judging::Photos => self.maps.pixels(seen.view, extent),
            Judging::Batch => {
                let of = |(pixel, &truth): (&Pixel, &[f32; 3])| residual(pixel.rgb, truth);
                let residuals: Vec<f32> = seen.pixels.iter().zip(seen.truth).map(of).collect();
                let mask = mask_of(&self.mask, self.threshold, extent, &residuals);
                Some(mask.into_iter().map(f32::from).collect())
            }
        }
    }

    fn static_maps(&self) -> Option<&StaticMaps> {
        Some(&self.maps).filter(|maps| !maps.is_empty())
    }

    fn push_state<'a>(&'a self, out: &mut Vec<Tensor<'a>>) {
        out.push(f32_tensor("robust.threshold", std::slice::from_ref(&self.threshold)));
        self.maps.push_state("static", out);
    }

    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        self.threshold = take_f32(state, "robust.threshold", 1)?[0];
        self.maps.load_state("static", state)
    }

    fn memory_bytes(&self) -> usize {
        4 * (self.weights.capacity() + 3 * self.residuals.capacity()) + self.maps.bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_that_would_end_a_training_are_refused_before_it() {
        let good = RobustConfig::HASH_GRID;
        good.check().unwrap();
        let zero = RobustConfig { judge_first: 0, ..good.clone() };
        assert_eq!(zero.check().unwrap_err().to_string(), "`judge_first` = 0: must be at least 1");
        let negative = RobustConfig { trim_scale: -1.0, ..good };
        assert_eq!(negative.check().unwrap_err().to_string(), "`trim_scale` = -1: must be positive and finite");
    }
}
