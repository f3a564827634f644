//! Masks, found by comparing all photos with their renders from time to time: those of fields ([`crate::occluders::outliers`]).

use crate::limits::at_least_1;
use crate::occluders::outliers::{Backdrop, Brightness, Expecting, OutlierConfig, PhotoOutliers};
use crate::occluders::survey::{is_doubled, survey_stride};
use crate::photo_model::PhotoAndRender;
use crate::static_maps::{StaticMap, StaticMaps};
use crate::views::{StepPhoto, SurveyJudge, Weights, nearest, source};
use engine::data::Dataset;
use engine::system::{SystemError, Tensor, TensorMap};
use glam::DVec2;
use losses::heuristics::Extent;
use render_core::camera::Camera;
use serde::{Deserialize, Serialize};

/// Name of the maps in checkpoints.
const SEEN: &str = "masks.photos";

/// When masks are found.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct MaskSettings {
    /// Steps before masks are found first; the next are after twice as many, and so on.
    pub(crate) judge_first: u64,
    /// Most steps between one search for masks and the next.
    pub(crate) judge_every: u64,
}

impl MaskSettings {
    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        at_least_1("judge_first", self.judge_first)?;
        at_least_1("judge_every", self.judge_every)
    }
}

/// What shows the scene in each photo.
pub(crate) struct PhotoMasks {
    settings: MaskSettings,
    outliers: OutlierConfig,
    judge: PhotoOutliers,
    stride: u32,
    /// The photos' cameras: photos of lenses that bend light are drawn onto a plane for training.
    cameras: Vec<Camera>,
    /// Of photos as they are.
    seen: StaticMaps,
    /// Of each photo whose lens bends light, on the plane of its camera without a lens.
    flat: Vec<Option<StaticMap>>,
}

impl PhotoMasks {
    /// No masks yet.
    pub(crate) fn new(
        settings: MaskSettings,
        outliers: OutlierConfig,
        backdrop: Backdrop,
        brightness: Brightness,
        data: &Dataset,
    ) -> Self {
        Self {
            settings,
            outliers,
            judge: PhotoOutliers::new(backdrop, brightness, Expecting::Unmasked),
            stride: survey_stride(data),
            cameras: data.views().iter().map(|view| view.camera).collect(),
            seen: StaticMaps::default(),
            flat: Vec::new(),
        }
    }

    /// The maps of `seen` as training sees its photos.
    fn flatten(&self) -> Vec<Option<StaticMap>> {
        let bent = |(view, camera): (usize, &Camera)| {
            self.seen.of(view).filter(|_| !camera.lens.is_pinhole()).map(|map| on_plane(map, camera))
        };
        self.cameras.iter().enumerate().map(bent).collect()
    }

    /// The map of a photo as training sees it.
    fn of_step(&self, view: usize) -> Option<&StaticMap> {
        self.flat.get(view).and_then(Option::as_ref).or_else(|| self.seen.of(view))
    }
}

/// The map of a photo on the plane of its camera without a lens.
fn on_plane(map: &StaticMap, camera: &Camera) -> StaticMap {
    let seen = camera.prepare();
    let bits = (0..map.bits.len())
        .map(|i| {
            let middle = |k: usize| (k as f64 + 0.5) * map.stride as f64;
            let at = DVec2::new(middle(i % map.width), middle(i / map.width));
            // What the photo does not show has no colour there either.
            let inside = |p: &DVec2| p.x >= 0.0 && p.y >= 0.0;
            source(&seen, camera, at).filter(inside).map_or(1, |p| map.at(p.x as usize, p.y as usize))
        })
        .collect();
    StaticMap { bits, ..*map }
}

impl SurveyJudge for PhotoMasks {
    fn survey(&self, step: u64) -> Option<u32> {
        let MaskSettings { judge_first, judge_every } = self.settings;
        let is_due = step > judge_first && step.is_multiple_of(judge_every);
        (is_doubled(step, judge_first) || is_due).then_some(self.stride)
    }

    fn see(&mut self, data: &Dataset, seen: &PhotoAndRender<'_>) {
        self.judge.add(data, seen, &self.seen);
    }

    fn settle(&mut self) {
        let photos = self.judge.static_parts(&self.outliers.trimming(), self.outliers.judge_scale);
        self.seen.set_all(photos.into_iter().map(|photo| photo.whole).collect());
        self.flat = self.flatten();
    }

    fn begin_with(&mut self, maps: &StaticMaps) {
        self.seen = maps.clone();
        self.flat = self.flatten();
    }

    fn weigh(&self, photo: &StepPhoto<'_>, weights: &mut Weights) {
        let Some((map, camera)) = self.of_step(photo.view).zip(self.cameras.get(photo.view)) else { return };
        let size = [photo.image.width as usize, photo.image.height as usize];
        let of = [camera.width as usize, camera.height as usize];
        weights.multiply(size[0] * size[1], |i| {
            // The pixel of the photo at its full size.
            let at = nearest([i % size[0], i / size[0]], size, of);
            f32::from(map.at(at % of[0].max(1), at / of[0].max(1)))
        });
    }

    fn static_pixels(&self, view: usize, [width, height]: [usize; 2]) -> Option<Vec<f32>> {
        self.seen.pixels(view, Extent { width, height })
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        let mut out = Vec::new();
        self.seen.push_state(SEEN, &mut out);
        out
    }

    fn load(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        self.seen.load_state(SEEN, state)?;
        self.flat = self.flatten();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::made;
    use engine::system::u64_tensor;
    use render_core::camera::Lens;
    use scene_io::Image;

    /// A judge of photos of [`made::SIDE`] pixels a side, through a lens that bends so much.
    fn judge(bent: f64) -> PhotoMasks {
        let mut frames = made::frames(4, |_, _, _| [90, 90, 90, 255]);
        frames.iter_mut().filter(|_| bent != 0.0).for_each(|frame| {
            frame.camera.lens = Lens::opencv5([bent, 0.0, 0.0, 0.0, 0.0]);
        });
        let (_, data) = made::scene(frames, Vec::new());
        let (settings, outliers) =
            (MaskSettings { judge_first: 4, judge_every: 12 }, OutlierConfig::of_photos(made::SIDE));
        PhotoMasks::new(settings, outliers, Backdrop::default(), Brightness::Same, &data)
    }

    fn state(words: Vec<u64>) -> TensorMap {
        let tensors =
            [u64_tensor(format!("{SEEN}.words"), vec![words.len() as u64]), u64_tensor(format!("{SEEN}.maps"), words)];
        tensors.into_iter().map(|t| (t.name.clone(), t)).collect()
    }

    fn weights(judge: &PhotoMasks, side: u32) -> Vec<f32> {
        let image = Image::rgb(side, side, vec![0; (3 * side * side) as usize]).unwrap();
        let mut weights = Weights::default();
        weights.begin();
        judge.weigh(&StepPhoto { view: 0, image: &image }, &mut weights);
        weights.get().map_or_else(Vec::new, <[f32]>::to_vec)
    }

    #[test]
    fn what_is_shown_as_a_mask_is_what_counts_in_training_at_any_size() {
        let side = made::SIDE as usize;
        // Squares of 5 pixels, which the side is no multiple of; every third is an occluder.
        let squares = side / 5;
        assert!(!side.is_multiple_of(5));
        let count = squares * squares;
        let mut words = vec![1, squares as u64, 5, count as u64];
        let bit = |i: usize| u64::from(!i.is_multiple_of(3));
        words.extend((0..count.div_ceil(64)).map(|w| (0..64).fold(0, |sum, k| sum | bit(64 * w + k) << k)));
        let mut judge = judge(0.0);
        assert!(judge.static_pixels(0, [side; 2]).is_none() && weights(&judge, made::SIDE).is_empty());
        judge.load(&state(words.clone())).unwrap();
        let shown = judge.static_pixels(0, [side; 2]).unwrap();
        assert_eq!(weights(&judge, made::SIDE), shown);
        assert!(shown.contains(&0.0) && shown.contains(&1.0));
        // At half the size each pixel is as the one in its middle.
        let half = weights(&judge, made::SIDE / 2);
        let middle = |i: usize| (2 * (i / (side / 2)) + 1) * side + 2 * (i % (side / 2)) + 1;
        assert!(half.iter().enumerate().all(|(i, w)| *w == shown[middle(i)]));
        // A lens that hardly bends changes hardly anything.
        let mut bent = self::judge(1e-6);
        bent.load(&state(words)).unwrap();
        let same = weights(&bent, made::SIDE).iter().zip(&shown).filter(|(a, b)| a == b).count();
        assert!(same > side * side * 9 / 10, "{same}");
    }

    #[test]
    fn a_map_of_a_strange_checkpoint_is_refused_or_says_nothing() {
        for words in [vec![1, 7, 3, 0], vec![1, 1, u64::MAX >> 1, 1, 1], vec![0]] {
            for lens in [0.0, 0.1] {
                let mut judge = judge(lens);
                if judge.load(&state(words.clone())).is_ok() {
                    assert!(weights(&judge, made::SIDE).iter().all(|w| *w == 0.0 || *w == 1.0), "{words:?}");
                }
            }
        }
    }

    #[test]
    fn surveys_are_rarer_and_rarer_up_to_a_number_of_steps() {
        let judge = judge(0.0);
        let steps: Vec<u64> = (0..50).filter(|step| judge.survey(*step).is_some()).collect();
        assert_eq!(steps, [4, 8, 12, 16, 24, 32, 36, 48]);
        for bad in [MaskSettings { judge_first: 0, judge_every: 1 }, MaskSettings { judge_first: 1, judge_every: 0 }] {
            assert!(bad.check().is_err(), "{bad:?}");
        }
    }
}
