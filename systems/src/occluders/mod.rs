//! Occluder models: what is done about things that stand before the scene in single photos.
//!
//! Here lie the trait and what several models are made of; each paper's own model lies in its file (`papers::wild`).
//!
//! * `none`: no occluders, every pixel shows the scene;
//! * `pixel_error`: the loss of a pixel's error, squared or robust; `likelihood`: its likelihood under an uncertainty;
//! * `pixel_network`: a small network over the pixels of photos; `photo_features`: what a large one made of the photos, from files;
//! * `survey`: when all photos are compared with the field, and at what scale; `outliers`: the static maps found by that, from
//!   `expected_error`; `scene_guard`: what is part of the scene, however badly it is rendered.

pub(crate) mod expected_error;
pub(crate) mod likelihood;
pub(crate) mod none;
pub(crate) mod outliers;
pub(crate) mod photo_features;
pub(crate) mod pixel_error;
pub(crate) mod pixel_network;
pub(crate) mod scene_guard;
pub(crate) mod survey;

pub use outliers::OutlierConfig;
pub use pixel_error::{KernelConfig, KernelKind};

use crate::photo_model::{Codes, Drawing, Outcome, PhotoAndRender, Pixel, PixelBar};
use crate::static_maps::StaticMaps;
use engine::data::{Batch, Dataset};
use engine::system::{SystemError, Tensor, TensorMap};

/// An occluder model. A step calls its functions in the order in which they stand here, [`OccluderModel::loss`] from many threads.
pub(crate) trait OccluderModel: Send + Sync {
    /// Codes of a transient part of the field, `[views][dims]`; `None`: there is no such part.
    fn transient_codes(&self) -> Option<Codes<'_>> {
        None
    }

    /// The field, and its schedules with it, begin anew before this step. A function of the settings alone.
    fn begins_anew(&self) -> Option<u64> {
        None
    }

    /// Before this step all training views are to be rendered: the mean of the photo over squares of this many pixels a side, and
    /// the ray through the middle of each. `None`: they are not.
    fn survey(&self, step: u64) -> Option<u32> {
        let _ = step;
        None
    }

    /// One of the views of a survey, in their order.
    ///
    /// # Errors
    /// [`SystemError::Scene`] when a prior of the photo cannot be read.
    fn survey_view(&mut self, data: &Dataset, seen: &PhotoAndRender<'_>) -> Result<(), SystemError> {
        let _ = (data, seen);
        Ok(())
    }

    /// All views of a survey have been given.
    fn surveyed(&mut self) {}

    /// How pixels are drawn; `None` where any way will do.
    fn drawing(&self) -> Option<Drawing> {
        None
    }

    /// The batch of a step is drawn. Pixels given weight 0 here are not rendered and cost nothing.
    ///
    /// # Errors
    /// [`SystemError`] when something that is read before the first step cannot be read.
    fn begin(&mut self, batch: &mut Batch, step: u64) -> Result<(), SystemError> {
        let _ = (batch, step);
        Ok(())
    }

    /// Whether [`OccluderModel::judge`] needs the whole batch, rendered, before any of it is learnt from.
    fn judges_batch(&self) -> bool {
        false
    }

    /// The whole batch, rendered, before any of it is learnt from.
    fn judge(&mut self, batch: &Batch, pixels: &[Pixel], truth: &[[f32; 3]]) {
        let _ = (batch, pixels, truth);
    }

    /// The loss of pixel `i` of the batch, and its derivative.
    fn loss(&self, i: usize, pixel: &Pixel, truth: [f32; 3]) -> (f32, PixelBar);

    /// The loss of pixel `i` of the coarse render, and its derivative, for fields that render twice along each ray.
    fn coarse_loss(&self, i: usize, rgb: [f32; 3], truth: [f32; 3]) -> (f32, [f32; 3]);

    /// Learn from a step. Returns how many gradient entries were not finite.
    fn learn(&mut self, outcome: &Outcome<'_>) -> usize {
        let _ = outcome;
        0
    }

    /// Which pixels of a training view show the static scene: 1 static, 0 transient. `None` where the model does not say.
    fn visibility(&self, seen: &PhotoAndRender<'_>) -> Option<Vec<f32>>;

    /// Which parts of all photos are static, as found by now; `None` where nothing of that is kept, or found yet.
    fn static_maps(&self) -> Option<&StaticMaps> {
        None
    }

    /// How far a training view's pixels may be from the scene, `> 0`, colour units. `None` where the model does not say.
    fn uncertainty(&self, seen: &PhotoAndRender<'_>) -> Option<Vec<f32>> {
        let _ = seen;
        None
    }

    /// Add the arrays that the next step depends on.
    fn push_state<'a>(&'a self, out: &mut Vec<Tensor<'a>>);

    /// Put back what [`OccluderModel::push_state`] gave.
    ///
    /// # Errors
    /// [`SystemError::State`] naming the array that is missing or has another shape.
    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError>;

    /// Trainable parameters.
    fn parameter_count(&self) -> usize {
        0
    }

    /// Bytes held.
    fn memory_bytes(&self) -> usize;
}
