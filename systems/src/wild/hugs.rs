//! NeRF-HuGS: find the static parts of each photo first, then train on nothing else.
//!
//! Chen, Qin, Liu, Lu, Wang, Chen, Tong, Chen, "NeRF-HuGS: Improved Neural Radiance Fields in Non-static Scenes Using
//! Heuristics-Guided Segmentation", 2024, section 4.
//!
//! A short training with a robust loss; then every training photo is compared with what the field renders there. Features
//! that many photos share are static (structure from motion knows them), and so is what is rendered well. Both vote on the
//! segments of the photo, given as files, or else its superpixels; the field then starts anew on what was found to be
//! static.

use super::config::{SegmentKind, WildConfig};
use super::light::Light;
use super::squared;
use crate::data::{Batch, Dataset};
use crate::method::{Codes, Method, Outcome, Pixel, PixelBar, ViewSeen};
use crate::system::{SystemError, Tensor, TensorMap, take_u64, u64_tensor};
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
    /// Columns, rows and static pixels of each training view; empty until they are found.
    masks: Vec<Vec<u8>>,
    /// Weight of each pixel of the batch.
    weights: Vec<f32>,
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
            masks: Vec::new(),
            weights: Vec::new(),
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

    fn begin(&mut self, data: &Dataset, batch: &Batch, _step: u64) -> Result<(), SystemError> {
        self.weights.clear();
        if !self.masks.is_empty() {
            self.weights.extend(batch.view.iter().zip(&batch.pixel).map(|(&view, &[x, y])| {
                let width = data.view(view as usize).camera.width as usize;
                f32::from(self.masks[view as usize][usize::from(y) * width + usize::from(x)])
            }));
        }
        self.light.as_mut().map_or(Ok(()), |light| light.begin(data, batch))
    }

    fn loss(&self, i: usize, pixel: &Pixel, truth: [f32; 3]) -> (f32, PixelBar) {
        if let Some(&weight) = self.weights.get(i) {
            return squared(pixel.rgb, truth, weight);
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

    fn survey_before(&self) -> Option<u64> {
        Some(self.warmup)
    }

    fn survey(&mut self, data: &Dataset, seen: &ViewSeen<'_>) -> Result<(), SystemError> {
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
        self.masks.resize(data.len(), Vec::new());
        self.masks[seen.view] = mask.iter().map(|&m| u8::from(m > 0)).collect();
        Ok(())
    }

    fn visibility(&self, seen: &ViewSeen<'_>) -> Option<Vec<f32>> {
        Some(self.masks.get(seen.view)?.iter().map(|&m| f32::from(m)).collect())
    }

    fn encode(&self, photo: &scene_io::Image) -> Option<Vec<f32>> {
        self.light.as_ref()?.encode(photo)
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        // Lengths, then 64 pixels to a word.
        let mut words = vec![self.masks.len() as u64];
        words.extend(self.masks.iter().map(|mask| mask.len() as u64));
        for mask in &self.masks {
            words.extend(mask.chunks(64).map(|bits| bits.iter().rev().fold(0, |word, &b| word << 1 | u64::from(b))));
        }
        let mut out = vec![u64_tensor("hugs.masks.words", vec![words.len() as u64]), u64_tensor("hugs.masks", words)];
        self.light.iter().for_each(|light| light.push_state(&mut out));
        out
    }

    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        let words = take_u64(state, "hugs.masks.words", 1)?[0] as usize;
        let words = take_u64(state, "hugs.masks", words)?;
        self.masks = unpack(&words).ok_or_else(|| SystemError::State {
            name: "hugs.masks".into(),
            problem: "its lengths do not fit its content".into(),
        })?;
        self.light.as_mut().map_or(Ok(()), |light| light.load_state(state))
    }

    fn parameter_count(&self) -> usize {
        self.light.as_ref().map_or(0, Light::len)
    }

    fn memory_bytes(&self) -> usize {
        self.light.as_ref().map_or(0, Light::bytes) + self.masks.iter().map(Vec::len).sum::<usize>()
    }
}

/// Masks from the words of [`Hugs::state`].
fn unpack(words: &[u64]) -> Option<Vec<Vec<u8>>> {
    let (&count, rest) = words.split_first()?;
    let (lengths, mut rest) = rest.split_at_checked(usize::try_from(count).ok()?)?;
    let mut masks = Vec::with_capacity(lengths.len());
    for &pixels in lengths {
        let pixels = usize::try_from(pixels).ok()?;
        let (bits, after) = rest.split_at_checked(pixels.div_ceil(64))?;
        masks.push((0..pixels).map(|i| (bits[i / 64] >> (i % 64) & 1) as u8).collect());
        rest = after;
    }
    rest.is_empty().then_some(masks)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn damaged_masks_are_refused() {
        let words = [2, 65, 1, 0b101, 1, 1];
        let masks = unpack(&words).unwrap();
        assert_eq!((masks[0].len(), masks[0][0], masks[0][1], masks[0][64]), (65, 1, 0, 1));
        assert_eq!(masks[1], [1]);
        for damaged in [&words[..5], &words[..1], &[], &[u64::MAX][..], &[1, u64::MAX], &[0, 7]] {
            assert!(unpack(damaged).is_none(), "{damaged:?}");
        }
    }
}
