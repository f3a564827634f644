//! The seam between a radiance field and a model of the photos: codes for each photo, a transient part, and the loss of a pixel.
//!
//! A field (`ngp`, or the published networks) renders rays and learns from the gradient of their pixels. A [`PhotoModel`]
//! (an appearance model and an occluder model) knows nothing of samples. A step calls it in this order:
//!
//! 1. [`PhotoModel::drawing`]: how pixels are drawn; [`PhotoModel::begin`]: the batch is drawn;
//! 2. where [`PhotoModel::judges_batch`]: the field renders the batch, and [`PhotoModel::judge`] sees all of it;
//! 3. [`PhotoModel::loss`]: once for each pixel, from many threads, as the field renders it for its gradient;
//! 4. where [`PhotoModel::second_render`] asks for it: patches rendered with codes of other photos, and
//!    [`PhotoModel::judge_second_render`] (`ngp` alone does this);
//! 5. [`PhotoModel::learn`]: the outcome, for the photo model's own parameters.
//!
//! Before some of the steps ([`PhotoModel::survey`]) it sees all training photos beside their renders: a survey.
//!
//! A field without a photo model does none of this and pays for none of it.

use crate::static_maps::StaticMaps;
use engine::data::{Batch, Dataset, Patches};
use engine::system::{Appearance, SystemError, Tensor, TensorMap};
use float_core::Simd;

/// A code for each training view, `[views][dims]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Codes<'a> {
    /// Length of a code.
    pub dims: usize,
    /// The codes, one after the other.
    pub rows: &'a [f32],
}

impl<'a> Codes<'a> {
    /// The code of a view.
    ///
    /// # Panics
    /// When there is no such view: a code is never wrapped around.
    #[must_use]
    pub fn of(self, view: usize) -> &'a [f32] {
        &self.rows[view * self.dims..][..self.dims]
    }

    /// The code of an appearance.
    ///
    /// # Panics
    /// As [`Codes::of`].
    #[must_use]
    pub fn code_of(self, appearance: &Appearance) -> Vec<f32> {
        match appearance {
            Appearance::Mean => self.mean(),
            Appearance::View(view) => self.of(*view).to_vec(),
            Appearance::Code(code) => code.to_vec(),
        }
    }

    /// Number of codes.
    #[must_use]
    pub fn len(self) -> usize {
        self.rows.len().checked_div(self.dims).unwrap_or(0)
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(self) -> bool {
        self.rows.is_empty()
    }

    /// The mean of all codes.
    #[must_use]
    pub fn mean(self) -> Vec<f32> {
        let n = self.len().max(1) as f32;
        (0..self.dims).map(|k| self.rows.iter().skip(k).step_by(self.dims).sum::<f32>() / n).collect()
    }
}

/// How the pixels of a batch are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Drawing {
    /// Each at random.
    Pixels,
    /// In patches, at least this many: one photo alone says little about the others.
    Patches(Patches, usize),
}

/// A pixel as the field renders it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pixel {
    /// Colour of static and transient part together, on the background of the batch.
    pub rgb: [f32; 3],
    /// Weight of all static samples: how much of what is behind them they hide.
    pub opacity: f32,
    /// Weighted sum of the transient samples' uncertainties, `>= 0`; 0 without a transient part.
    pub beta: f32,
    /// Weight of the transient samples.
    pub transient: f32,
    /// Mean density of the transient samples, one over the length of the smallest step.
    pub sigma_t: f32,
}

/// The derivative of a pixel's loss with respect to each of its numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PixelBar {
    /// With respect to the colour.
    pub rgb: [f32; 3],
    /// With respect to the uncertainty.
    pub beta: f32,
    /// With respect to the mean transient density.
    pub sigma_t: f32,
}

impl PixelBar {
    /// A derivative with respect to the colour alone.
    #[must_use]
    pub fn colour(rgb: [f32; 3]) -> Self {
        Self { rgb, ..Self::default() }
    }
}

/// The outcome of a step, for the photo model's own parameters. Derivatives are those of the mean over the pixels that count.
#[derive(Clone, Copy, Debug)]
pub struct Outcome<'a> {
    /// Number of the step.
    pub step: u64,
    /// Learning rate of the field's networks.
    pub lr: f64,
    /// For the photo model's kernels.
    pub simd: Simd,
    /// The batch.
    pub batch: &'a Batch,
    /// One over the pixels of the batch that count: the factor between the loss of a pixel and its part in the mean.
    pub share: f32,
    /// Each pixel as it was rendered.
    pub pixels: &'a [Pixel],
    /// What it should be, on the same background.
    pub truth: &'a [[f32; 3]],
    /// `[pixels][dims]`, derivatives of the appearance codes; empty without.
    pub appearance_bar: &'a [f32],
    /// `[pixels][dims]`, derivatives of the transient codes; empty without.
    pub transient_bar: &'a [f32],
}

/// The photo of a training view beside its render, all pixels.
#[derive(Clone, Copy, Debug)]
pub struct PhotoAndRender<'a> {
    /// The view.
    pub view: usize,
    /// Columns and rows.
    pub size: [usize; 2],
    /// Pixels of the photo along each side of one of these.
    pub stride: usize,
    /// Row by row.
    pub pixels: &'a [Pixel],
    /// The photo, on the same background.
    pub truth: &'a [[f32; 3]],
    /// Its opacity.
    pub alpha: &'a [f32],
    /// Where each pixel's ray ends in the field's own unit cube; NaN for a ray that ends nowhere.
    pub place: &'a [[f32; 3]],
}

/// A request for patches that are rendered a second time: with the appearance code of another photo.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SecondRender {
    /// Their form.
    pub patches: Patches,
    /// For each patch the view with whose code it is rendered the second time.
    pub views: Vec<u32>,
}

/// Patches rendered with the code of their own photo and with that of another: the static part alone, before a grey of one
/// half.
#[derive(Clone, Copy, Debug)]
pub struct RenderedTwice<'a> {
    /// The request.
    pub request: &'a SecondRender,
    /// The patches, one after the other, with their own views.
    pub batch: &'a Batch,
    /// Colours with the code of their own view.
    pub own: &'a [[f32; 3]],
    /// Colours with the code of the other view.
    pub other: &'a [[f32; 3]],
}

/// What a field knows of its photos: how their appearance differs, and what hides the scene in them.
pub trait PhotoModel: Send + Sync {
    /// Name on the command line.
    fn name(&self) -> &'static str;

    /// Codes that the colour of the static part depends on; `None`: all photos have the same appearance.
    fn appearance(&self) -> Option<Codes<'_>> {
        None
    }

    /// Those that the field learns with, where they are others.
    fn learning_appearance(&self) -> Option<Codes<'_>> {
        self.appearance()
    }

    /// Codes of the transient part; `None`: there is no such part.
    fn transient(&self) -> Option<Codes<'_>> {
        None
    }

    /// How pixels are drawn.
    fn drawing(&self) -> Drawing {
        Drawing::Pixels
    }

    /// The batch of a step is drawn. Pixels given weight 0 here are not rendered and cost nothing.
    ///
    /// # Errors
    /// [`SystemError::Scene`] when a photo cannot be read.
    fn begin(&mut self, data: &Dataset, batch: &mut Batch, step: u64) -> Result<(), SystemError> {
        let _ = (data, batch, step);
        Ok(())
    }

    /// Whether the whole batch is rendered for [`PhotoModel::judge`] in this step before any of it is learnt from.
    fn judges_batch(&self, _step: u64) -> bool {
        false
    }

    /// The whole batch, rendered, before any of it is learnt from.
    fn judge(&mut self, batch: &Batch, step: u64, pixels: &[Pixel], truth: &[[f32; 3]]) {
        let _ = (batch, step, pixels, truth);
    }

    /// The loss of pixel `i` of the batch, and its derivative. Times the pixel's weight it is summed.
    fn loss(&self, i: usize, pixel: &Pixel, truth: [f32; 3]) -> (f32, PixelBar);

    /// The loss of pixel `i` of the coarse render, and its derivative, for fields that render twice along each ray; summed as
    /// [`PhotoModel::loss`] is. The coarse render only places the samples of the fine one, and has no transient part: the default
    /// is the mean squared error over channels. A photo model whose masks leave pixels out of the loss leaves them out here too,
    /// without a derivative of the mask.
    fn coarse_loss(&self, i: usize, rgb: [f32; 3], truth: [f32; 3]) -> (f32, [f32; 3]) {
        let _ = i;
        let e = [0, 1, 2].map(|c| rgb[c] - truth[c]);
        (e.iter().map(|e| e * e).sum::<f32>() / 3.0, e.map(|e| 2.0 * e / 3.0))
    }

    /// Patches to be rendered with the codes of other photos in this step, besides the batch. `None`: there are none.
    fn second_render(&self, _step: u64) -> Option<SecondRender> {
        None
    }

    /// Those patches. Returns the derivatives of the loss on them with respect to [`RenderedTwice::other`], one for each pixel: only
    /// the network that knows colours learns from them, neither density, nor what both are computed from, nor the codes.
    fn judge_second_render(&mut self, rendered: &RenderedTwice<'_>) -> Vec<[f32; 3]> {
        vec![[0.0; 3]; rendered.other.len()]
    }

    /// Learn from a step. Returns how many gradient entries were not finite.
    fn learn(&mut self, outcome: &Outcome<'_>) -> usize {
        let _ = outcome;
        0
    }

    /// Whether there is a survey before this step ([`crate::photo_model`]): all training views are rendered, the mean of the photo
    /// over squares of this many pixels a side beside the ray through the middle of each. `None`: there is none.
    fn survey(&self, _step: u64) -> Option<u32> {
        None
    }

    /// One of the views of a survey.
    ///
    /// # Errors
    /// [`SystemError::Scene`] when a prior of the photo cannot be read.
    fn survey_view(&mut self, data: &Dataset, seen: &PhotoAndRender<'_>) -> Result<(), SystemError> {
        let _ = (data, seen);
        Ok(())
    }

    /// The survey is over: all views have been rendered.
    fn surveyed(&mut self) {}

    /// The field, and its schedules with it, begin anew before this step. A function of the photo model's settings alone.
    fn begins_anew(&self) -> Option<u64> {
        None
    }

    /// Which pixels of a training view show the static scene: 1 static, 0 transient. `None` where the photo model does not say.
    fn visibility(&self, seen: &PhotoAndRender<'_>) -> Option<Vec<f32>> {
        let _ = seen;
        None
    }

    /// Which parts of all photos are static, as found by now; `None` where nothing of that is kept, or found yet.
    fn static_maps(&self) -> Option<&StaticMaps> {
        None
    }

    /// How far a training view's pixels may be from the scene, `> 0`, colour units. `None` where the photo model does not say.
    fn uncertainty(&self, seen: &PhotoAndRender<'_>) -> Option<Vec<f32>> {
        let _ = seen;
        None
    }

    /// The appearance code of a photo that was not trained on, from its pixels; `None` where codes are fitted instead.
    fn encode(&self, photo: &scene_io::Image) -> Option<Vec<f32>> {
        let _ = photo;
        None
    }

    /// Everything the next step depends on.
    fn state(&self) -> Vec<Tensor<'_>> {
        Vec::new()
    }

    /// Put back what [`PhotoModel::state`] gave.
    ///
    /// # Errors
    /// [`SystemError::State`] naming the array that is missing or has another shape.
    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        let _ = state;
        Ok(())
    }

    /// Trainable parameters.
    fn parameter_count(&self) -> usize {
        0
    }

    /// Bytes held.
    fn memory_bytes(&self) -> usize {
        0
    }
}

/// Mean weight of the transient part over the pixels that count; 0 for none.
pub(crate) fn mean_transient(pixels: &[Pixel], batch: &Batch) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (pixel, &weight) in pixels.iter().zip(&batch.weight) {
        sum += f64::from(weight * pixel.transient);
        count += f64::from(weight);
    }
    if count > 0.0 { sum / count } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use render_core::ray::Ray;

    #[test]
    fn pixels_that_do_not_count_are_not_counted() {
        let mut batch = Batch::of_rays(&[Ray { o: DVec3::ZERO, d: DVec3::Z }; 3], &[[0.0; 3]; 3]);
        let pixels = [0.1, 0.9, 0.4].map(|transient| Pixel { transient, ..Pixel::default() });
        batch.weight = vec![1.0, 0.0, 3.0];
        assert!((mean_transient(&pixels, &batch) - 1.3 / 4.0).abs() < 1e-6);
        batch.weight = vec![0.0; 3];
        assert_eq!(mean_transient(&pixels, &batch), 0.0);
        assert_eq!(mean_transient(&[], &batch), 0.0);
    }
}
