//! NeRF-HuGS: find the static parts of each photo first, then train on nothing else.
//!
//! Chen, Qin, Liu, Lu, Wang, Chen, Tong, Chen, "NeRF-HuGS: Improved Neural Radiance Fields in Non-static Scenes Using
//! Heuristics-Guided Segmentation", 2024, section 4.
//!
//! A short training with a robust loss; then every training photo is compared with its render:
//!
//! ```text
//! M = vote(H_CR or H_SfM)
//! ```
//!
//! * `H_SfM`: features that many photos share are static, as structure from motion knows (`shared_features`);
//! * `H_CR`: so is what is rendered no worse than most photos are at the same place (`outliers`; published:
//!   no worse than the mean of the photo);
//! * `vote`: on the segments of the photo, from files or else its superpixels (`Pieces`).
//!
//! The field then goes on with what was found to be static, and compares again, or starts anew, as published. Segments from
//! files have outlines as sharp as the photo. Where the field goes on, it leaves out what errs, too, whatever segment it is in:
//! no segmenter counts a shadow to its occluder.

mod segments;

use super::nerf_w::{CHARBONNIER, SQUARED};
use super::planning::{Build, Planning};
use super::robust_nerf::trimming;
use crate::claims::Claim;
use crate::limits::{above_0, at_least_1, within};
use crate::occluders::OccluderModel;
use crate::occluders::outliers::{Expecting, OutlierConfig, PhotoOutliers, StaticParts};
use crate::occluders::pixel_error::{KernelConfig, kernel_loss};
use crate::occluders::survey::{is_doubled, survey_stride};
use crate::photo_model::{PhotoAndRender, Pixel, PixelBar};
use crate::static_maps::{StaticMap, StaticMaps};
use engine::data::{Batch, Dataset};
use engine::system::{SystemError, Tensor, TensorMap};
use losses::heuristics::points::min_track;
use losses::heuristics::superpixels::Superpixels;
use losses::heuristics::{Extent, VoteScratch};
use losses::kernel::Kernel;
use losses::trimmed::TrimmedMask;
use scene_io::{Frame, Scene};
use segments::{Pieces, refused, shared_features};
use serde::{Deserialize, Serialize};

/// What differs from the paper.
pub(crate) const CLAIM: Claim = Claim {
    name: "hugs",
    paper: "Chen et al., 2024",
    what: "Occluders: masks of whole photos, then segments vote",
    take: "as `robust-nerf`, where another program has made segments",
    differs: "Not HuGS: training masks come from our own rule of robust-nerf on whole photos, then segments vote. The \
              published residual heuristic, combined with point tracks, is not used: what tracks or segments mark as static is \
              still left out where that rule leaves it out.",
    mark: "not HuGS: own masks",
};

/// Pixels of the segments of all photos together, at most: a few bytes each while photos are compared.
const OUTLINE_PIXELS: f64 = 32e6;

/// What votes on masks as a whole.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SegmentKind {
    /// Segments in files beside the photos; superpixels of photos that have none.
    #[default]
    Files,
    /// Superpixels, whatever files there are.
    Superpixels,
    /// Each pixel alone.
    Pixels,
}

/// What becomes of the field once masks are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Restart {
    /// It goes on.
    #[default]
    On,
    /// Another takes its place, as published.
    Anew,
}

/// Settings of the masks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MaskConfig {
    /// Steps of the training that comes before the masks.
    pub warmup_steps: u64,
    /// The field goes `on` with the masks, or begins `anew`.
    pub restart: Restart,
    /// Share of the photos that a static feature is found in.
    pub track_share: f32,
    /// `files`, `superpixels` or `pixels`; photos without a file have superpixels.
    pub segments: SegmentKind,
    /// Superpixels of a photo.
    pub superpixels: usize,
    /// Share of a superpixel that has to be static.
    pub segment_share: f32,
    /// Share of a segment from a file that has to be static.
    pub file_share: f32,
}

impl MaskConfig {
    /// As published (section 4), with a shorter training before the masks.
    pub const PUBLISHED: Self = Self {
        warmup_steps: 1000,
        restart: Restart::Anew,
        track_share: 0.1,
        segments: SegmentKind::Files,
        superpixels: 400,
        segment_share: 0.5,
        file_share: 0.5,
    };

    /// On the hash grid, which goes on: what is left out for good has to be certain.
    pub const HASH_GRID: Self =
        Self { warmup_steps: 100, restart: Restart::On, segment_share: 0.25, file_share: 0.8, ..Self::PUBLISHED };

    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub fn check(&self) -> Result<(), SystemError> {
        at_least_1("warmup_steps", self.warmup_steps)?;
        within("track_share", self.track_share, 0.0..=1.0)?;
        above_0("segment_share", self.segment_share, 1.0)?;
        above_0("file_share", self.file_share, 1.0)?;
        within("superpixels", self.superpixels, 1..=65535)
    }
}

/// Masks after a short training.
pub(super) fn occluders<'a>(planning: &mut Planning<'a>) -> Result<Build<'a, dyn OccluderModel>, SystemError> {
    let settings: MaskConfig = planning.settings.of(&planning.by_field(MaskConfig::HASH_GRID, MaskConfig::PUBLISHED))?;
    settings.check()?;
    let trimming = trimming(planning)?;
    let error: KernelConfig = planning.settings.of(&planning.by_field(CHARBONNIER, SQUARED))?;
    error.check()?;
    let judge = PhotoOutliers::new(planning.backdrop, planning.brightness(), Expecting::All);
    let (scene, data) = (planning.scene, planning.data);
    Ok(Box::new(move || Ok(Box::new(Hugs::new(&settings, &trimming, error.kernel(), judge, scene, data)?))))
}

/// A photo of a survey: its static features and its segments, in squares of `stride` pixels.
struct Clue {
    extent: Extent,
    stride: usize,
    from_file: bool,
    h_sfm: Vec<u8>,
    pieces: Pieces,
}

/// The masks, and the loss with them.
struct Hugs {
    settings: MaskConfig,
    frames: Vec<Frame>,
    /// Before masks are found, and after.
    charbonnier: Kernel,
    kernel: Kernel,
    rule: TrimmedMask,
    /// The residual of an occluder, in units of the expected error.
    scale: f32,
    superpixels: Superpixels,
    /// Photos a static feature has to be found in.
    min_track: u32,
    judge: PhotoOutliers,
    /// The photos of a survey.
    clues: Vec<Clue>,
    /// `M`, what was found to be static.
    maps: StaticMaps,
    /// `H_CR`, what is rendered no worse than most photos are at the same place.
    unerring: StaticMaps,
    /// Pixels of a photo along a side of a square that is compared, and of the outlines of segments from files.
    stride: u32,
    fine: usize,
    votes: VoteScratch,
}

impl Hugs {
    fn new(
        settings: &MaskConfig,
        trimming: &OutlierConfig,
        kernel: Kernel,
        judge: PhotoOutliers,
        scene: &Scene,
        data: &Dataset,
    ) -> Result<Self, SystemError> {
        let min_track = min_track(settings.track_share, data.len())
            .map_err(|e| refused("track_share", settings.track_share, &e))?;
        Ok(Self {
            frames: scene.frames.clone(),
            charbonnier: Kernel::CHARBONNIER_360,
            kernel,
            rule: trimming.trimming(),
            scale: trimming.judge_scale,
            superpixels: Superpixels::default().with_count(settings.superpixels),
            min_track: min_track as u32,
            judge,
            clues: Vec::new(),
            maps: StaticMaps::default(),
            unerring: StaticMaps::default(),
            stride: survey_stride(data),
            fine: (data.pixel_count() as f64 / OUTLINE_PIXELS).sqrt().ceil().max(1.0) as usize,
            votes: VoteScratch::default(),
            settings: settings.clone(),
        })
    }

    /// `M = vote(H_CR or H_SfM)`
    fn mask(&mut self, h_cr: &StaticParts, clue: Clue) -> StaticMap {
        let Clue { extent, stride, from_file, h_sfm, pieces } = clue;
        // A segmenter's outlines are sharp, and shadows have no vote on them. Superpixels follow shadows, too.
        let (h_cr, share) = match from_file {
            true => (&h_cr.seed, self.settings.file_share),
            false => (&h_cr.whole, self.settings.segment_share),
        };
        let mut bits = h_cr.in_squares(stride, extent);
        // What features know to be static is, whatever its error.
        bits.iter_mut().zip(h_sfm).for_each(|(bit, h)| *bit |= u8::from(h != 0));
        let bits = pieces.vote(extent, &bits, share, &mut self.votes);
        StaticMap { width: extent.width, stride, bits }
    }
}

impl OccluderModel for Hugs {
    fn begins_anew(&self) -> Option<u64> {
        (self.settings.restart == Restart::Anew).then_some(self.settings.warmup_steps)
    }

    fn survey(&self, step: u64) -> Option<u32> {
        let MaskConfig { warmup_steps, restart, .. } = self.settings;
        let again = restart == Restart::On && is_doubled(step, warmup_steps);
        (step == warmup_steps || again).then_some(self.stride)
    }

    fn survey_view(&mut self, data: &Dataset, seen: &PhotoAndRender<'_>) -> Result<(), SystemError> {
        let [width, height] = seen.size;
        let (mut extent, mut stride) = (Extent { width, height }, seen.stride);
        let view = data.view(seen.view);
        let frame = &self.frames[view.frame];
        let mut segments = None;
        if self.settings.segments == SegmentKind::Files
            && let Some(files) = frame.read_segments()?
        {
            stride = self.fine.min(stride);
            let [width, height] = [view.camera.width, view.camera.height].map(|side| (side as usize / stride).max(1));
            extent = Extent { width, height };
            segments = Some(files.resized(width as u32, height as u32));
        }
        let h_sfm = shared_features(frame, self.min_track, extent, segments.as_ref())?;
        let from_file = segments.is_some();
        let pieces = match segments {
            Some(segments) => Pieces::from_file(segments),
            None if self.settings.segments == SegmentKind::Pixels => Pieces::Pixels,
            None => Pieces::superpixels(self.superpixels, extent, seen.truth)?,
        };
        self.judge.add(data, seen, &self.maps);
        self.clues.push(Clue { extent, stride, from_file, h_sfm, pieces });
        Ok(())
    }

    fn surveyed(&mut self) {
        let (photos, clues) = (self.judge.static_parts(&self.rule, self.scale), std::mem::take(&mut self.clues));
        let maps = photos.iter().zip(clues).map(|(h_cr, clue)| self.mask(h_cr, clue)).collect();
        self.maps.set_all(maps);
        if self.settings.restart == Restart::On {
            self.unerring.set_all(photos.into_iter().map(|h_cr| h_cr.whole).collect());
        }
    }

    fn begin(&mut self, batch: &mut Batch, _step: u64) -> Result<(), SystemError> {
        self.maps.leave_out(batch);
        self.unerring.leave_out(batch);
        Ok(())
    }

    fn loss(&self, _i: usize, pixel: &Pixel, truth: [f32; 3]) -> (f32, PixelBar) {
        if !self.maps.is_empty() {
            return kernel_loss(self.kernel, pixel.rgb, truth, 1.0);
        }
        let kernel = self.charbonnier;
        let value = |c: usize| kernel.value(pixel.rgb[c], truth[c]);
        let derivative = |c: usize| kernel.derivative(pixel.rgb[c], truth[c]) / 3.0;
        ((value(0) + value(1) + value(2)) / 3.0, PixelBar::colour([0, 1, 2].map(derivative)))
    }

    fn coarse_loss(&self, i: usize, rgb: [f32; 3], truth: [f32; 3]) -> (f32, [f32; 3]) {
        let (loss, bar) = self.loss(i, &Pixel { rgb, ..Pixel::default() }, truth);
        (loss, bar.rgb)
    }

    fn visibility(&self, seen: &PhotoAndRender<'_>) -> Option<Vec<f32>> {
        let [width, height] = seen.size;
        self.maps.pixels(seen.view, Extent { width, height })
    }

    fn push_state<'a>(&'a self, out: &mut Vec<Tensor<'a>>) {
        self.maps.push_state("static", out);
        self.unerring.push_state("unerring", out);
    }

    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        self.maps.load_state("static", state)?;
        self.unerring.load_state("unerring", state)
    }

    fn memory_bytes(&self) -> usize {
        self.maps.bytes() + self.unerring.bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_that_would_end_a_training_are_refused_before_it() {
        let good = MaskConfig::HASH_GRID;
        good.check().unwrap();
        for (settings, want) in [
            (MaskConfig { track_share: 9.0, ..good.clone() }, "`track_share` = 9: must be in 0..=1"),
            (MaskConfig { segment_share: 0.0, ..good.clone() }, "`segment_share` = 0: must be above 0 and at most 1"),
            (MaskConfig { file_share: 1.5, ..good.clone() }, "`file_share` = 1.5: must be above 0 and at most 1"),
            (MaskConfig { warmup_steps: 0, ..good }, "`warmup_steps` = 0: must be at least 1"),
        ] {
            assert_eq!(settings.check().unwrap_err().to_string(), want);
        }
    }
}
