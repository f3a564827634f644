//! NeRF-HuGS: find the static parts of each photo first, then train on nothing else.
//!
//! Chen, Qin, Liu, Lu, Wang, Chen, Tong, Chen, "NeRF-HuGS: Improved Neural Radiance Fields in Non-static Scenes Using
//! Heuristics-Guided Segmentation", 2024, section 4.
//!
//! A short training with a robust loss; then every training photo is compared with what the field renders there. Features
//! that many photos share are static (structure from motion knows them), and so is what is rendered no worse than most
//! photos are at the same place ([`super::photo_judge`]; published: no worse than the mean of the photo). Both vote on the
//! segments of the photo, given as files, or else its superpixels; the field then goes on with what was found to be static,
//! and looks again, or starts anew, as published. Segments from files have outlines as sharp as the photo. Where the field goes
//! on, it leaves out what errs, too, whatever segment it is in: no segmenter gives the shadow to the stranger.

use super::config::{Restart, SegmentKind, WildConfig};
use super::light::Light;
use super::photo_judge::{Backdrop, Judged, PhotoJudge, light_of};
use super::static_maps::{StaticMap, StaticMaps};
use super::{is_doubled, robust};
use crate::method::{Codes, Drawing, Method, Outcome, Pixel, PixelBar, Relit, SecondLight, ViewSeen};
use engine::data::{Batch, Dataset};
use engine::system::{SystemError, Tensor, TensorMap};
use losses::heuristics::points::{disc_radius, discs, min_track, segments_at, union};
use losses::heuristics::superpixels::Superpixels;
use losses::heuristics::{Extent, Segments, VoteScratch, vote};
use losses::kernel::Kernel;
use losses::trimmed::TrimmedMask;
use scene_io::{Frame, Scene};

/// Least score and stability of a segment around a feature point, where the segmenter gave them.
const LEAST_SCORE: f32 = 0.8;
const LEAST_STABILITY: f32 = 0.92;

/// Pixels of the segments of all photos together, at most: a few bytes each while photos are judged.
const OUTLINE_PIXELS: f64 = 32e6;

/// A photo of a survey: what features say to be static and its segments, in squares of `stride` pixels.
struct Clue {
    extent: Extent,
    stride: usize,
    from_file: bool,
    h_sfm: Vec<u8>,
    pieces: Pieces,
}

/// Segments of a photo.
enum Pieces {
    Pixels,
    Labels(Vec<u16>),
    Stack(Vec<Vec<u8>>),
}

/// The method.
pub(super) struct Hugs {
    light: Option<Light>,
    frames: Vec<Frame>,
    warmup: u64,
    /// Before masks are found, and after.
    charbonnier: Kernel,
    kernel: Kernel,
    rule: TrimmedMask,
    /// A stranger's residual is so many times what is expected.
    scale: f32,
    /// Share of a segment that has to be static, and of one from a file.
    share: f32,
    file_share: f32,
    segments: SegmentKind,
    superpixels: Superpixels,
    /// Photos a feature has to be seen in.
    min_track: u32,
    judge: PhotoJudge,
    /// The photos of a survey.
    clues: Vec<Clue>,
    /// What was found to be static.
    maps: StaticMaps,
    /// What is rendered no worse than most photos are at the same place.
    unerring: StaticMaps,
    /// The field begins anew once they are found.
    restart: Restart,
    /// Pixels of a photo along a side of what is compared, and of the outlines of segments from files.
    stride: u32,
    fine: usize,
    votes: VoteScratch,
}

fn refused(e: &losses::LossError) -> SystemError {
    SystemError::Config { field: "track_share, segment_share", value: String::new(), problem: e.to_string() }
}

impl Hugs {
    pub(super) fn new(
        config: &WildConfig,
        light: Option<Light>,
        scene: &Scene,
        data: &Dataset,
        backdrop: Backdrop,
    ) -> Result<Self, SystemError> {
        let min_track = min_track(config.track_share, data.len()).map_err(|e| refused(&e))?;
        let judge = PhotoJudge::new(backdrop, light_of(light.as_ref()));
        Ok(Self {
            light,
            frames: scene.frames.clone(),
            warmup: config.warmup_steps,
            charbonnier: Kernel::CHARBONNIER_360,
            kernel: config.robust_kernel(),
            rule: config.trimming(),
            scale: config.judge_scale,
            share: config.segment_share,
            file_share: config.file_share,
            segments: config.segments,
            superpixels: Superpixels { count: config.superpixels, ..Superpixels::default() },
            min_track: min_track as u32,
            judge,
            clues: Vec::new(),
            maps: StaticMaps::default(),
            unerring: StaticMaps::default(),
            restart: config.restart,
            stride: super::survey_stride(data),
            fine: (data.pixel_count() as f64 / OUTLINE_PIXELS).sqrt().ceil().max(1.0) as usize,
            votes: VoteScratch::default(),
        })
    }

    /// Heuristic of structure from motion: segments around features that many photos share.
    fn shared_features(
        &self,
        frame: &Frame,
        extent: Extent,
        segments: Option<&scene_io::Segments>,
    ) -> Result<Vec<u8>, SystemError> {
        let (width, height) = (extent.width as u32, extent.height as u32);
        let scale = [width as f32 / frame.camera.width as f32, height as f32 / frame.camera.height as f32];
        let points: Vec<[f32; 2]> = frame
            .tracks
            .iter()
            .filter(|track| track.length >= self.min_track)
            .map(|track| [track.pixel[0] * scale[0], track.pixel[1] * scale[1]])
            .collect();
        let mut out = vec![0; extent.pixels()];
        let bytes = |mask: &scene_io::BitMask| mask.resized(width, height).iter().map(u8::from).collect::<Vec<u8>>();
        let made = if let Some(prompted) = frame.read_prompted()? {
            let sure = |s: &scene_io::PromptedSegment| {
                s.score.is_none_or(|s| s > LEAST_SCORE) && s.stability.is_none_or(|s| s >= LEAST_STABILITY)
            };
            let stack: Vec<Vec<u8>> = prompted.iter().filter(|s| sure(s)).map(|s| bytes(&s.mask)).collect();
            union(extent, &stack.iter().map(|m| &m[..]).collect::<Vec<_>>(), &mut out)
        } else {
            match segments {
                Some(scene_io::Segments::Labels(map)) => segments_at(extent, &map.labels, &points, &mut out),
                Some(scene_io::Segments::Stack(masks)) => {
                    let at = |p: &[f32; 2]| [p[0] as u32, p[1] as u32];
                    let inside = |m: &&scene_io::BitMask| {
                        points.iter().map(at).any(|[x, y]| x < m.width() && y < m.height() && m.get(x, y))
                    };
                    let stack: Vec<Vec<u8>> = masks.iter().filter(inside).map(bytes).collect();
                    union(extent, &stack.iter().map(|m| &m[..]).collect::<Vec<_>>(), &mut out)
                }
                None => discs(extent, &points, disc_radius(extent), &mut out),
            }
        };
        made.map_err(|e| refused(&e))?;
        Ok(out)
    }
}

impl Method for Hugs {
    fn name(&self) -> &'static str {
        "hugs"
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
        self.maps.leave_out(batch);
        self.unerring.leave_out(batch);
        self.light.as_mut().map_or(Ok(()), |light| light.begin(data, batch, step))
    }

    fn loss(&self, _i: usize, pixel: &Pixel, truth: [f32; 3]) -> (f32, PixelBar) {
        if !self.maps.is_empty() {
            return robust(self.kernel, pixel.rgb, truth, 1.0);
        }
        let kernel = self.charbonnier;
        let value = |c: usize| kernel.value(pixel.rgb[c], truth[c]);
        let slope = |c: usize| kernel.derivative(pixel.rgb[c], truth[c]) / 3.0;
        ((value(0) + value(1) + value(2)) / 3.0, PixelBar::colour([0, 1, 2].map(slope)))
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

    fn survey(&self, step: u64) -> Option<u32> {
        let again = self.restart == Restart::On && is_doubled(step, self.warmup);
        (step == self.warmup || again).then_some(self.stride)
    }

    fn begins_anew(&self) -> Option<u64> {
        (self.restart == Restart::Anew).then_some(self.warmup)
    }

    fn look(&mut self, data: &Dataset, seen: &ViewSeen<'_>) -> Result<(), SystemError> {
        let [width, height] = seen.size;
        let (mut extent, mut stride) = (Extent { width, height }, seen.stride);
        let view = data.view(seen.view);
        let frame = self.frames[view.frame].clone();
        let mut segments = None;
        if self.segments == SegmentKind::Files
            && let Some(files) = frame.read_segments()?
        {
            stride = self.fine.min(stride);
            let [width, height] = [view.camera.width, view.camera.height].map(|side| (side as usize / stride).max(1));
            extent = Extent { width, height };
            segments = Some(files.resized(width as u32, height as u32));
        }
        let h_sfm = self.shared_features(&frame, extent, segments.as_ref())?;
        let from_file = segments.is_some();
        let pieces = match segments {
            None if self.segments == SegmentKind::Pixels => Pieces::Pixels,
            None => {
                let mut labels = vec![0; extent.pixels()];
                self.superpixels.run(extent, seen.truth, &mut labels).map_err(|e| refused(&e))?;
                Pieces::Labels(labels)
            }
            Some(scene_io::Segments::Labels(map)) => Pieces::Labels(map.labels),
            Some(scene_io::Segments::Stack(masks)) => {
                Pieces::Stack(masks.iter().map(|m| m.iter().map(u8::from).collect()).collect())
            }
        };
        self.judge.look(data, seen);
        self.clues.push(Clue { extent, stride, from_file, h_sfm, pieces });
        Ok(())
    }

    fn surveyed(&mut self) {
        let (photos, clues) = (self.judge.judge(&self.rule, self.scale), std::mem::take(&mut self.clues));
        let fits = "a clue for each square, and the settings are checked before";
        let mut unerring = Vec::new();
        let maps: Vec<StaticMap> = photos
            .into_iter()
            .zip(clues)
            .map(|(Judged { seed, whole }, Clue { extent, stride, from_file, h_sfm, pieces })| {
                // A segmenter's outlines are sharp, and shadows have no vote on them. Superpixels follow shadows, too.
                let (clue, share) = if from_file { (&seed, self.file_share) } else { (&whole, self.share) };
                let mut bits = clue.in_squares(stride, extent);
                unerring.push(whole);
                // What features know to be static is, whatever its error.
                bits.iter_mut().zip(h_sfm).for_each(|(bit, h)| *bit |= u8::from(h != 0));
                let stack: Vec<&[u8]>;
                let segments = match &pieces {
                    Pieces::Pixels => Segments::Pixels,
                    Pieces::Labels(labels) => Segments::Labels(labels),
                    Pieces::Stack(masks) => {
                        stack = masks.iter().map(|m| &m[..]).collect();
                        Segments::Stack(&stack)
                    }
                };
                let mut voted = vec![0; extent.pixels()];
                vote(extent, segments, &bits, share, &mut self.votes, &mut voted).expect(fits);
                StaticMap { width: extent.width, stride, bits: voted }
            })
            .collect();
        self.maps.set_all(maps);
        if self.restart == Restart::On {
            self.unerring.set_all(unerring);
        }
    }

    fn visibility(&self, seen: &ViewSeen<'_>) -> Option<Vec<f32>> {
        self.maps.pixels(seen.view, seen.size)
    }

    fn encode(&self, photo: &scene_io::Image) -> Option<Vec<f32>> {
        self.light.as_ref()?.encode(photo)
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        let mut out = Vec::new();
        self.maps.push_state("static", &mut out);
        self.unerring.push_state("unerring", &mut out);
        self.light.iter().for_each(|light| light.push_state(&mut out));
        out
    }

    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        self.maps.load_state("static", state)?;
        self.unerring.load_state("unerring", state)?;
        self.light.as_mut().map_or(Ok(()), |light| light.load_state(state))
    }

    fn parameter_count(&self) -> usize {
        self.light.as_ref().map_or(0, Light::len)
    }

    fn memory_bytes(&self) -> usize {
        self.light.as_ref().map_or(0, Light::bytes) + self.maps.bytes() + self.unerring.bytes()
    }
}
