//! Appearance models: what makes one photo brighter, darker or of another tint than the next.
//!
//! Colours of the field depend on a code of each photo, density does not.
//!
//! * `codes`: a free code for each training photo, or for each appearance that a dataset numbers;
//! * `encoder`: a network that makes the code of any photo, from `thumbnail`s by `photo_network`, held to what it sees in
//!   renders by `view_consistency`;
//! * [`config`]: the settings of these.

pub(crate) mod codes;
pub mod config;
pub(crate) mod encoder;
pub(crate) mod photo_network;
mod thumbnail;
mod view_consistency;

use crate::photo_model::{Codes, Drawing, Outcome, RenderedTwice, SecondRender};
use engine::data::{Batch, Dataset};
use engine::system::{SystemError, Tensor, TensorMap};

/// An appearance model. A step calls its functions in the order in which they stand here.
pub(crate) trait AppearanceModel: Send + Sync {
    /// The codes that photos are rendered with, `[views][dims]`.
    fn codes(&self) -> Codes<'_>;

    /// The codes that the field learns with, where they are others.
    fn learning_codes(&self) -> Codes<'_> {
        self.codes()
    }

    /// How pixels are drawn, where the occluder model does not say it.
    fn drawing(&self) -> Drawing {
        Drawing::Pixels
    }

    /// The batch of a step is drawn.
    ///
    /// # Errors
    /// [`SystemError::Scene`] when a photo cannot be read.
    fn begin(&mut self, data: &Dataset, batch: &Batch, step: u64) -> Result<(), SystemError> {
        let _ = (data, batch, step);
        Ok(())
    }

    /// Patches to be rendered with codes of other photos in this step, besides the batch.
    fn second_render(&self, step: u64) -> Option<SecondRender> {
        let _ = step;
        None
    }

    /// The derivatives of the loss on those patches with respect to [`RenderedTwice::other`], one for each pixel.
    fn judge_second_render(&mut self, rendered: &RenderedTwice<'_>) -> Vec<[f32; 3]> {
        vec![[0.0; 3]; rendered.other.len()]
    }

    /// Learn from a step. Returns how many gradient entries were not finite.
    fn learn(&mut self, outcome: &Outcome<'_>) -> usize;

    /// The code of a photo that was not trained on; `None` where codes are fitted instead.
    fn encode(&self, photo: &scene_io::Image) -> Option<Vec<f32>> {
        let _ = photo;
        None
    }

    /// Add the arrays that the next step depends on.
    fn push_state<'a>(&'a self, out: &mut Vec<Tensor<'a>>);

    /// Put back what [`AppearanceModel::push_state`] gave.
    ///
    /// # Errors
    /// [`SystemError::State`] naming the array that is missing or has another shape.
    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError>;

    /// Trainable parameters.
    fn parameter_count(&self) -> usize;

    /// Bytes held.
    fn memory_bytes(&self) -> usize;
}
