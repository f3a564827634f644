//! Surveys. Before some steps a field renders all training views, and its photo model compares each photo with its render: what
//! differs in one photo alone is an occluder. Written once for all fields.

use crate::photo_model::{PhotoAndRender, PhotoModel, Pixel};
use engine::data::{Batch, Dataset};
use engine::system::SystemError;

/// A training view, rendered with its own appearance and its transient part, beside its photo.
pub(crate) struct RenderedView {
    pub(crate) size: [usize; 2],
    pub(crate) stride: u32,
    pub(crate) pixels: Vec<Pixel>,
    pub(crate) truth: Vec<[f32; 3]>,
    pub(crate) alpha: Vec<f32>,
    pub(crate) place: Vec<[f32; 3]>,
}

impl RenderedView {
    /// `rendered` are the pixels of the view in `batch` and where their rays end; `truth` is the photo behind the same
    /// background. Pixels that a mask ignores say nothing: they are as rendered, and transparent.
    pub(crate) fn new(
        size: [usize; 2],
        stride: u32,
        batch: Batch,
        mut truth: Vec<[f32; 3]>,
        rendered: impl Iterator<Item = (Pixel, [f32; 3])>,
    ) -> Self {
        let (pixels, place): (Vec<Pixel>, Vec<_>) = rendered.unzip();
        let mut alpha = batch.alpha;
        for (i, _) in batch.weight.iter().enumerate().filter(|(_, w)| **w == 0.0) {
            (truth[i], alpha[i]) = (pixels[i].rgb, 0.0);
        }
        Self { size, stride, pixels, truth, alpha, place }
    }

    /// What the photo model sees of it, the view of this number.
    pub(crate) fn beside_photo(&self, view: usize) -> PhotoAndRender<'_> {
        let (size, stride) = (self.size, self.stride as usize);
        PhotoAndRender {
            view,
            size,
            stride,
            pixels: &self.pixels,
            truth: &self.truth,
            alpha: &self.alpha,
            place: &self.place,
        }
    }
}

/// A field that renders its training views for its photo model.
pub(crate) trait Surveys {
    fn photo_model(&self) -> Option<&dyn PhotoModel>;

    fn photo_model_mut(&mut self) -> Option<&mut Box<dyn PhotoModel>>;

    /// Render a training view, one ray for each square of `stride` pixels a side; nothing of it is random.
    fn render_training_view(&self, data: &Dataset, view: usize, stride: u32) -> Result<RenderedView, SystemError>;

    /// A new field for the same photo model, with other initial parameters: the same would repeat its mistakes.
    fn begin_anew(&mut self, data: &Dataset) -> Result<(), SystemError>;

    /// What happens before step `step`: a survey, or the field begins anew. Returns the step as the field's schedules count it.
    fn between_steps(&mut self, data: &Dataset, step: u64) -> Result<u64, SystemError> {
        let Some(photo_model) = self.photo_model() else { return Ok(step) };
        let anew = photo_model.begins_anew();
        if let Some(stride) = photo_model.survey(step) {
            self.survey(data, stride)?;
        }
        if anew == Some(step) {
            self.begin_anew(data)?;
        }
        Ok(match anew {
            Some(first) if step >= first => step - first,
            _ => step,
        })
    }

    /// Render every training view for the photo model.
    fn survey(&mut self, data: &Dataset, stride: u32) -> Result<(), SystemError> {
        for view in 0..data.len() {
            // What the field renders does not depend on what the photo model learns here.
            let rendered = self.render_training_view(data, view, stride)?;
            if let Some(photo_model) = self.photo_model_mut() {
                photo_model.survey_view(data, &rendered.beside_photo(view))?;
            }
        }
        if let Some(photo_model) = self.photo_model_mut() {
            photo_model.surveyed();
        }
        Ok(())
    }

    /// See [`engine::system::System::visibility`].
    fn visibility_of(&self, data: &Dataset, view: usize) -> Result<Option<Vec<f32>>, SystemError> {
        let Some(photo_model) = self.photo_model() else { return Ok(None) };
        Ok(photo_model.visibility(&self.render_training_view(data, view, 1)?.beside_photo(view)))
    }

    /// See [`engine::system::System::look`].
    fn rehearse_survey(&self, data: &Dataset, view: usize, stride: u32) -> Result<bool, SystemError> {
        let Some(photo_model) = self.photo_model() else { return Ok(false) };
        let rendered = self.render_training_view(data, view, stride)?;
        let seen = rendered.beside_photo(view);
        drop((photo_model.visibility(&seen), photo_model.uncertainty(&seen)));
        Ok(true)
    }

    /// See [`engine::system::System::uncertainty`].
    fn uncertainty_of(&self, data: &Dataset, view: usize) -> Result<Option<Vec<f32>>, SystemError> {
        let Some(photo_model) = self.photo_model() else { return Ok(None) };
        Ok(photo_model.uncertainty(&self.render_training_view(data, view, 1)?.beside_photo(view)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ignored_pixels_say_nothing() {
        let ray = render_core::ray::Ray { o: glam::DVec3::ZERO, d: glam::DVec3::Z };
        let mut batch = Batch::of_rays(&[ray; 2], &[[0.0; 3]; 2]);
        batch.weight[1] = 0.0;
        let pixel = Pixel { rgb: [0.25; 3], ..Pixel::default() };
        let rendered = RenderedView::new([2, 1], 1, batch, vec![[0.75; 3]; 2], [(pixel, [0.5; 3]); 2].into_iter());
        let seen = rendered.beside_photo(0);
        assert_eq!((seen.truth, seen.alpha), (&[[0.75; 3], [0.25; 3]][..], &[1.0, 0.0][..]));
        assert_eq!((seen.pixels.len(), seen.place.len()), (2, 2));
    }
}
