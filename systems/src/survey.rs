//! Surveys: all training views as a field renders them, for its method to judge the photos by. Written once for all fields.

use crate::method::{Method, Pixel, ViewSeen};
use engine::data::{Batch, Dataset};
use engine::system::SystemError;

/// A training view, rendered in its own light with all that stood in it.
pub(crate) struct Shown {
    pub(crate) size: [usize; 2],
    pub(crate) stride: u32,
    pub(crate) pixels: Vec<Pixel>,
    pub(crate) truth: Vec<[f32; 3]>,
    pub(crate) alpha: Vec<f32>,
    pub(crate) place: Vec<[f32; 3]>,
}

impl Shown {
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

    pub(crate) fn seen(&self, view: usize) -> ViewSeen<'_> {
        let (size, stride) = (self.size, self.stride as usize);
        ViewSeen {
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

/// A field whose method may see the training views.
pub(crate) trait Surveys {
    fn method(&self) -> Option<&dyn Method>;

    fn method_mut(&mut self) -> Option<&mut Box<dyn Method>>;

    /// Render a training view, one ray for each square of `stride` pixels a side; nothing of it is random.
    fn show(&self, data: &Dataset, view: usize, stride: u32) -> Result<Shown, SystemError>;

    /// A new field for the same method, of other numbers than the first: the same would repeat its mistakes.
    fn begin_anew(&mut self, data: &Dataset) -> Result<(), SystemError>;

    /// What happens before step `step`: the method looks at all training views, or the field begins anew. Returns the step as
    /// the field's schedules count it.
    fn between_steps(&mut self, data: &Dataset, step: u64) -> Result<u64, SystemError> {
        let Some(method) = self.method() else { return Ok(step) };
        let anew = method.begins_anew();
        if let Some(stride) = method.survey(step) {
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

    /// Show the method every training view.
    fn survey(&mut self, data: &Dataset, stride: u32) -> Result<(), SystemError> {
        for view in 0..data.len() {
            // What the field renders does not depend on what the method learns here.
            let shown = self.show(data, view, stride)?;
            if let Some(method) = self.method_mut() {
                method.look(data, &shown.seen(view))?;
            }
        }
        if let Some(method) = self.method_mut() {
            method.surveyed();
        }
        Ok(())
    }

    /// See [`engine::system::System::visibility`].
    fn visibility_of(&self, data: &Dataset, view: usize) -> Result<Option<Vec<f32>>, SystemError> {
        let Some(method) = self.method() else { return Ok(None) };
        Ok(method.visibility(&self.show(data, view, 1)?.seen(view)))
    }

    /// See [`engine::system::System::look`].
    fn look_once(&self, data: &Dataset, view: usize, stride: u32) -> Result<bool, SystemError> {
        let Some(method) = self.method() else { return Ok(false) };
        let shown = self.show(data, view, stride)?;
        drop((method.visibility(&shown.seen(view)), method.uncertainty(&shown.seen(view))));
        Ok(true)
    }

    /// See [`engine::system::System::uncertainty`].
    fn uncertainty_of(&self, data: &Dataset, view: usize) -> Result<Option<Vec<f32>>, SystemError> {
        let Some(method) = self.method() else { return Ok(None) };
        Ok(method.uncertainty(&self.show(data, view, 1)?.seen(view)))
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
        let shown = Shown::new([2, 1], 1, batch, vec![[0.75; 3]; 2], [(pixel, [0.5; 3]); 2].into_iter());
        let seen = shown.seen(0);
        assert_eq!((seen.truth, seen.alpha), (&[[0.75; 3], [0.25; 3]][..], &[1.0, 0.0][..]));
        assert_eq!((seen.pixels.len(), seen.place.len()), (2, 2));
    }
}
