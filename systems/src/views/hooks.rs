//! Where a system may put in parts of its own between a cloud and its picture: appearance, and time.

use super::cloud_parameters::CloudParameters;
use super::drawing::VisibleCloud;
use super::weights::{StepPhoto, Weights};
use crate::photo_model::PhotoAndRender;
use crate::static_maps::StaticMaps;
use engine::data::Dataset;
use engine::system::{Appearance, SystemError, Tensor, TensorMap};
use float_core::Simd;
use splat_core::View;

/// Parameters of a part, besides those of the clouds.
pub(crate) trait Learns: Send + Sync {
    /// A step of its optimiser, that of the schedule and counted from 0, with the gradients since the last one. Returns how many
    /// entries were not finite.
    fn step(&mut self, simd: Simd, step: u64) -> usize;

    /// What its next step depends on.
    fn state(&self) -> Vec<Tensor<'_>>;

    /// Drop the gradient that is kept for the next step.
    fn forget(&mut self);

    /// What [`state`](Self::state) wrote.
    ///
    /// # Errors
    /// [`SystemError::State`] naming the array that is missing or does not fit. Nothing has changed then.
    fn load(&mut self, state: &TensorMap) -> Result<(), SystemError>;

    /// Number of its parameters.
    fn parameter_count(&self) -> usize;
}

/// Gradients that an appearance gives back.
pub(crate) struct ColourBars<'a> {
    /// `[visible]`, with respect to the composited colours; becomes that with respect to those of the spherical harmonics.
    pub(crate) rgb: &'a mut [[f32; 3]],
    /// `[visible]`, with respect to the coefficients of degree 0, where the appearance reads these themselves; to be added to.
    pub(crate) base: &'a mut [[f32; 3]],
    /// `[rows][n]`, with respect to the extra rows of the cloud; to be added to.
    pub(crate) extra: &'a mut [f32],
}

/// A photo as it is encoded.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SeenPhoto<'a> {
    /// Columns and rows.
    pub(crate) size: [usize; 2],
    /// `[3][rows][columns]`, sRGB, on a background.
    pub(crate) colour: &'a [f32],
    /// `[rows][columns]`, 0 for pixels that say nothing; `None`: all count.
    pub(crate) weights: Option<&'a [f32]>,
    /// The camera that took it, of the clouds' frame; `None`: it is not known.
    pub(crate) view: Option<&'a View>,
    /// How far away is what it shows, where the appearance asked for that: [`ColourAppearance::depth_side`].
    pub(crate) depth: Option<SeenDepth<'a>>,
}

/// Depths of a whole photo, in a picture of any size.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SeenDepth<'a> {
    /// Columns and rows.
    pub(crate) size: [usize; 2],
    /// `[rows][columns]`, `z` along the camera's axis, internal units; 0 where the cloud shows nothing, or the photo does not count.
    pub(crate) z: &'a [f32],
}

/// Appearance: the colours of Gaussians in the appearance of a photo, and gradients back.
pub(crate) trait ColourAppearance: Learns {
    /// The code of an appearance.
    fn code(&self, appearance: &Appearance) -> Vec<f32>;

    /// Whether it is shown the photos of steps: [`look_at`](Self::look_at).
    fn looks(&self) -> bool {
        false
    }

    /// The side of the square that depths of photos are drawn in for it, in a step of the schedule; `None`: it needs none.
    fn depth_side(&self, _step: u64) -> Option<usize> {
        None
    }

    /// Step `step` is about to compare the photo of a view: what comes before the next [`step`](Learns::step) or
    /// [`forget`](Learns::forget) in the appearance of that view is of the step.
    fn look_at(&mut self, _step: u64, _view: usize, _photo: &SeenPhoto<'_>) {}

    /// The code of a photo; `None` where it is to be found by trying.
    fn encode(&self, _photo: &SeenPhoto<'_>) -> Option<Vec<f32>> {
        None
    }

    /// Turn the colours of a cloud's visible Gaussians `[visible]`, as spherical harmonics give them, into those that are composited.
    fn forward(&self, appearance: &Appearance, seen: VisibleCloud<'_>, rgb: &mut [[f32; 3]]);

    /// Backward twin of [`forward`](Self::forward), of the same `rgb` as it was given. The gradient with respect to its own parameters
    /// is held for the next step.
    fn backward(&mut self, appearance: &Appearance, seen: VisibleCloud<'_>, rgb: &[[f32; 3]], bars: ColourBars<'_>);

    /// The gradient with respect to `code` alone, of the same `rgb` as [`forward`](Self::forward) was given with it; `bar` `[visible]`,
    /// with respect to the composited colours, may be written over.
    fn code_bar(&self, code: &[f32], seen: VisibleCloud<'_>, rgb: &[[f32; 3]], bar: &mut [[f32; 3]]) -> Vec<f32>;

    /// Number of those of its parameters that have a gradient for each [`super::memory::CHUNK`] of Gaussians while that is summed.
    fn shared_parameters(&self) -> usize {
        self.parameter_count()
    }

    /// Bytes that it holds besides its parameters, their gradients and moments, and what it holds of each Gaussian.
    fn bytes(&self) -> usize {
        0
    }
}

/// Colours are turned into those of an appearance.
#[derive(Clone, Copy)]
pub(crate) struct OfAppearance<'a> {
    pub(crate) part: &'a dyn ColourAppearance,
    pub(crate) appearance: &'a Appearance,
}

/// Time: the clouds as they are at a time, and gradients back.
pub(crate) trait CloudMotion: Learns {
    /// Cloud number `index` at `time` (`0..=1`). It has the rows of the `canonical` one.
    fn cloud_at(&self, time: f64, index: usize, canonical: &CloudParameters) -> CloudParameters;

    /// Backward twin of [`cloud_at`](Self::cloud_at). `bar` is the gradient with respect to the cloud at `time`, and becomes that with
    /// respect to the canonical one. The gradient with respect to its own parameters is held for the next step.
    fn pull_back(&mut self, time: f64, index: usize, canonical: &CloudParameters, bar: &mut CloudParameters);

    /// After a step: see which Gaussians of a cloud stand still from now on, when it is time for that.
    fn settle(&mut self, _index: usize, _canonical: &mut CloudParameters) {}

    /// How many Gaussians of a cloud stand still and are not asked where they are.
    fn at_rest(&self, _index: usize, _canonical: &CloudParameters) -> usize {
        0
    }
}

/// What a photo and its render are, pixel by pixel: planes `[3][rows][columns]`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Beside<'a> {
    /// Index of the view.
    pub(crate) view: usize,
    /// Columns and rows.
    pub(crate) size: [usize; 2],
    /// In the appearance of the photo.
    pub(crate) render: &'a [f32],
    pub(crate) photo: &'a [f32],
    /// How much each pixel counts before it is judged, where they do not all alike: those of 0 are as rendered.
    pub(crate) before: Option<&'a [f32]>,
}

/// Says which pixels of a photo show the scene, by its render: in each step that shows it.
pub(crate) trait RenderJudge: Send + Sync {
    /// How much each pixel counts in a step of the schedule, 0 to 1; `None`: all as before.
    fn weights(&mut self, step: u64, beside: &Beside<'_>) -> Option<Vec<f32>>;

    /// 1 for what shows the scene, 0 for what does not.
    fn static_pixels(&self, beside: &Beside<'_>) -> Vec<f32>;

    /// Learn from the picture that was last given to [`weights`](Self::weights), if that was since the last time. Returns how many
    /// entries of a gradient were not finite.
    fn learn(&mut self, simd: Simd) -> usize {
        let _ = simd;
        0
    }

    /// What its next step depends on.
    fn state(&self) -> Vec<Tensor<'_>> {
        Vec::new()
    }

    /// What [`state`](Self::state) wrote.
    ///
    /// # Errors
    /// [`SystemError::State`] naming the array that is missing or does not fit. Nothing has changed then.
    fn load(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        let _ = state;
        Ok(())
    }

    /// Number of its parameters.
    fn parameter_count(&self) -> usize {
        0
    }

    /// Bytes of what it knows of photos.
    fn bytes(&self) -> usize {
        0
    }
}

/// Says which pixels of all photos show the scene, by all renders: from time to time, before a step.
pub(crate) trait SurveyJudge: Send + Sync {
    /// Whether there is a survey before this step: the side of the squares, in pixels of the photos, that are one pixel of a render
    /// each. `None`: there is none.
    fn survey(&self, step: u64) -> Option<u32>;

    /// One of them, in their order.
    fn see(&mut self, data: &Dataset, seen: &PhotoAndRender<'_>);

    /// All have been seen.
    fn settle(&mut self);

    /// Before the first survey: what something else has found of all photos.
    fn begin_with(&mut self, maps: &StaticMaps);

    /// Multiply the weights of a photo's pixels.
    fn weigh(&self, photo: &StepPhoto<'_>, weights: &mut Weights);

    /// 1 for the pixels of view `view`, of `size`, that show the scene, 0 for others; `None` before the first survey.
    fn static_pixels(&self, view: usize, size: [usize; 2]) -> Option<Vec<f32>>;

    /// What its next step depends on.
    fn state(&self) -> Vec<Tensor<'_>>;

    /// What [`state`](Self::state) wrote.
    ///
    /// # Errors
    /// [`SystemError::State`] naming the array that is missing or does not fit. Nothing has changed then.
    fn load(&mut self, state: &TensorMap) -> Result<(), SystemError>;
}
