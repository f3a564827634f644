//! NeRF-HuGS: find the static parts of each photo first, then train on nothing else.
//!
//! Chen, Qin, Liu, Lu, Wang, Chen, Tong, Chen, "NeRF-HuGS: Improved Neural Radiance Fields in Non-static Scenes Using
//! Heuristics-Guided Segmentation", 2024, section 4.
//!
//! A short training with a robust loss; then every training photo is compared with what the field renders there. Features
//! that many photos share are static (structure from motion knows them), and so is what is rendered well. Both vote on the
//! segments of the photo, given as files, or else its superpixels; the field then starts anew on what was found to be
//! static.

use super::config::{Restart, SegmentKind, WildConfig};
use super::light::Light;
use super::squared;
use super::static_maps::{StaticMap, StaticMaps};
use crate::data::{Batch, Dataset};
use crate::method::{Codes, Drawing, Method, Outcome, Pixel, PixelBar, ViewSeen};
use crate::system::{SystemError, Tensor, TensorMap};
use losses::heuristics::points::{disc_radius, discs, min_track, segments_at, union};
use losses::heuristics::superpixels::Superpixels;
use losses::heuristics::{Extent, Scratch, Segments, StaticMask};
use losses::kernel::Kernel;
use scene_io::{Frame, Scene};

/// Least score and stability of a segment around a feature point, where the segmenter gave them.
const LEAST_SCORE: f32 = 0.8;
const LEAST_STABILITY: f32 = 0.92;

/// The method.
pub(super) struct Hugs {
    light: Option<Light>,
    frames: Vec<Frame>,
    warmup: u64,
    charbonnier: Kernel,
    rule: StaticMask,
    segments: SegmentKind,
    superpixels: Superpixels,
    /// Photos a feature has to be seen in.
    min_track: u32,
    /// What was found to be static.
    maps: StaticMaps,
    /// The field begins anew once they are found.
    restart: Restart,
    /// Pixels of a photo along a side of what is compared.
    stride: u32,
    scratch: Scratch,
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
    ) -> Result<Self, SystemError> {
        let min_track = min_track(config.track_share, data.len()).map_err(|e| refused(&e))?;
        Ok(Self {
            light,
            frames: scene.frames.clone(),
            warmup: config.warmup_steps,
            charbonnier: Kernel::CHARBONNIER_360,
            rule: StaticMask { share: config.segment_share, ..StaticMask::default() },
            segments: config.segments,
            superpixels: Superpixels { count: config.superpixels, ..Superpixels::default() },
            min_track: min_track as u32,
            maps: StaticMaps::default(),
            restart: config.restart,
            stride: super::survey_stride(data),
            scratch: Scratch::default(),
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

    fn drawing(&self) -> Drawing {
        self.light.as_ref().map_or(Drawing::Pixels, Light::drawing)
    }

    fn begin(&mut self, data: &Dataset, batch: &mut Batch, _step: u64) -> Result<(), SystemError> {
        self.maps.leave_out(batch);
        self.light.as_mut().map_or(Ok(()), |light| light.begin(data, batch))
    }

    fn loss(&self, _i: usize, pixel: &Pixel, truth: [f32; 3]) -> (f32, PixelBar) {
        if !self.maps.is_empty() {
            return squared(pixel.rgb, truth, 1.0);
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

    fn learn(&mut self, outcome: &Outcome<'_>) -> usize {
        self.light.as_mut().map_or(0, |light| light.learn(outcome))
    }

    fn survey(&self, step: u64) -> Option<u32> {
        (step == self.warmup).then_some(self.stride)
    }

    fn begins_anew(&self) -> Option<u64> {
        (self.restart == Restart::Anew).then_some(self.warmup)
    }

    fn look(&mut self, data: &Dataset, seen: &ViewSeen<'_>) -> Result<(), SystemError> {
        let [width, height] = seen.size;
        let extent = Extent { width, height };
        let frame = self.frames[data.view(seen.view).frame].clone();
        let segments = match self.segments {
            SegmentKind::Files => frame.read_segments()?.map(|s| s.resized(width as u32, height as u32)),
            SegmentKind::Superpixels | SegmentKind::Pixels => None,
        };
        let h_sfm = self.shared_features(&frame, extent, segments.as_ref())?;
        let error =
            |(pixel, truth): (&Pixel, &[f32; 3])| (0..3).map(|c| (pixel.rgb[c] - truth[c]).abs()).sum::<f32>() / 3.0;
        let residuals: Vec<f32> = seen.pixels.iter().zip(seen.truth).map(error).collect();
        let mut mask = vec![0; extent.pixels()];
        let stack: Vec<Vec<u8>> = match &segments {
            Some(scene_io::Segments::Stack(masks)) => masks.iter().map(|m| m.iter().map(u8::from).collect()).collect(),
            _ => Vec::new(),
        };
        let stack: Vec<&[u8]> = stack.iter().map(|m| &m[..]).collect();
        let mut pieces = Vec::new();
        let vote = match &segments {
            None if self.segments == SegmentKind::Pixels => Segments::Pixels,
            None => {
                pieces.resize(extent.pixels(), 0);
                self.superpixels.run(extent, seen.truth, &mut pieces).map_err(|e| refused(&e))?;
                Segments::Labels(&pieces)
            }
            Some(scene_io::Segments::Labels(map)) => Segments::Labels(&map.labels),
            Some(scene_io::Segments::Stack(_)) => Segments::Stack(&stack),
        };
        self.rule.run(extent, &h_sfm, &residuals, vote, &mut self.scratch, &mut mask).map_err(|e| refused(&e))?;
        let bits = mask.iter().map(|&m| u8::from(m > 0)).collect();
        self.maps.set(data.len(), seen.view, StaticMap { width, stride: seen.stride, bits });
        Ok(())
    }

    fn visibility(&self, seen: &ViewSeen<'_>) -> Option<Vec<f32>> {
        self.maps.pixels(seen.view, seen.size)
    }

    fn encode(&self, photo: &scene_io::Image) -> Option<Vec<f32>> {
        self.light.as_ref()?.encode(photo)
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        let mut out = Vec::new();
        self.maps.push_state(&mut out);
        self.light.iter().for_each(|light| light.push_state(&mut out));
        out
    }

    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        self.maps.load_state(state)?;
        self.light.as_mut().map_or(Ok(()), |light| light.load_state(state))
    }

    fn parameter_count(&self) -> usize {
        self.light.as_ref().map_or(0, Light::len)
    }

    fn memory_bytes(&self) -> usize {
        self.light.as_ref().map_or(0, Light::bytes) + self.maps.bytes()
    }
}
