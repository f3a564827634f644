//! What photos show besides the scene: photos beside their renders, and the masks that follow.

use super::driver::Views;
use super::hooks::Beside;
use crate::photo_model::Pixel;
use crate::survey::RenderedView;
use engine::data::{Batch, Dataset};
use engine::render::plain_query;
use engine::system::{Appearance, Layers, Query, SystemError};
use glam::DVec2;
use render_core::camera::Camera;
use std::time::Instant;

impl Views {
    /// Whether photos have codes of appearance.
    pub(crate) fn has_codes(&self) -> bool {
        self.parts.appearance.is_some()
    }

    /// What happens before a step: all photos are compared with their renders, now and then.
    pub(super) fn survey(&mut self, data: &Dataset, step: u64) -> Result<(), SystemError> {
        let Some(stride) = self.parts.surveys.as_ref().and_then(|part| part.survey(step)) else { return Ok(()) };
        let clock = Instant::now();
        for view in 0..data.len() {
            let rendered = self.render_training_view(data, view, stride)?;
            if let Some(part) = &mut self.parts.surveys {
                part.see(data, &rendered.beside_photo(view));
            }
        }
        if let Some(part) = &mut self.parts.surveys {
            part.settle();
        }
        self.count_survey(clock.elapsed().as_secs_f64());
        Ok(())
    }

    /// A training view beside its photo, a pixel for each square of `stride` pixels a side.
    fn render_training_view(&self, data: &Dataset, view: usize, stride: u32) -> Result<RenderedView, SystemError> {
        let mut batch = Batch::default();
        let camera = data.view(view).camera;
        // As `whole_view` has it.
        let stride = stride.clamp(1, camera.width.min(camera.height).max(1));
        let size = data.whole_view(view, stride, &mut batch)?;
        let camera = smaller(&camera, size, stride);
        let plain = plain_query(self.parts.background.colour(), 0.0);
        let query = Query { appearance: Appearance::View(view), time: self.parts.times.of(data, view), ..plain };
        let layers = self.picture(&self.clouds_at(query.time), &camera, &query);
        let mut truth = Vec::new();
        batch.over(std::iter::repeat(query.background), &mut truth);
        let pixels = (0..size[0] * size[1]).map(|i| {
            let pixel = Pixel { rgb: layers.rgb[i], opacity: layers.opacity[i], ..Pixel::default() };
            (pixel, self.place(&camera, &layers, i))
        });
        Ok(RenderedView::new(size, stride, batch, truth, pixels.collect::<Vec<_>>().into_iter()))
    }

    /// Where pixel `i` ends: in a unit cube that holds all of space, the cameras in its middle; NaN where it ends nowhere.
    fn place(&self, camera: &Camera, layers: &Layers, i: usize) -> [f32; 3] {
        /// Cells of the cube are smaller by this where cameras look than they would be if half of it were within their extent.
        const NEARER: f64 = 2.0;
        let width = camera.width as usize;
        let at = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        let far = f64::from(layers.median_depth[i]);
        match camera.ray(at).filter(|_| far.is_finite()) {
            None => [f32::NAN; 3],
            Some(ray) => {
                let x = NEARER * self.parts.frame.to_internal(ray.at(far));
                x.to_array().map(|x| (0.5 + 0.5 * x / (1.0 + x.abs())) as f32)
            }
        }
    }

    /// See [`engine::system::System::visibility`].
    pub(super) fn static_pixels(&self, data: &Dataset, view: usize) -> Result<Option<Vec<f32>>, SystemError> {
        let camera = data.view(view).camera;
        let size = [camera.width as usize, camera.height as usize];
        if let Some(part) = &self.parts.surveys {
            return Ok(part.static_pixels(view, size));
        }
        let Some(judge) = &self.parts.judge else { return Ok(None) };
        let rendered = self.render_training_view(data, view, 1)?;
        let (render, photo) =
            (planes(rendered.pixels.iter().map(|pixel| pixel.rgb)), planes(rendered.truth.iter().copied()));
        Ok(Some(judge.static_pixels(&Beside { view, size, render: &render, photo: &photo, before: None })))
    }

    /// See [`engine::system::System::prepass`].
    pub(super) fn rehearse_survey(&self, data: &Dataset, view: usize, stride: u32) -> Result<bool, SystemError> {
        if self.parts.surveys.is_some() {
            drop(self.render_training_view(data, view, stride)?);
            return Ok(true);
        }
        Ok(self.static_pixels(data, view)?.is_some())
    }
}

/// A camera whose pixels are squares of `stride` pixels of another's, `size` of them.
fn smaller(camera: &Camera, size: [usize; 2], stride: u32) -> Camera {
    let share = 1.0 / f64::from(stride.max(1));
    let [width, height] = size.map(|n| n as u32);
    let [fx, fy, cx, cy] = [camera.fx, camera.fy, camera.cx, camera.cy].map(|x| share * x);
    Camera { width, height, fx, fy, cx, cy, ..*camera }
}

/// `[3][pixels]`
fn planes(rgb: impl Iterator<Item = [f32; 3]> + Clone) -> Vec<f32> {
    (0..3).flat_map(|c| rgb.clone().map(move |rgb| rgb[c])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use render_core::camera::Pose;

    #[test]
    fn pixels_of_a_smaller_camera_are_squares_of_the_other() {
        let camera = Camera::pinhole(43, 20, 30.0, 31.0, 20.5, 9.0, Pose::IDENTITY);
        let small = smaller(&camera, [8, 4], 5);
        for at in [DVec3::new(0.1, -0.1, 1.0), DVec3::new(-0.5, 0.2, 1.0)] {
            let [a, b] = [&camera, &small].map(|camera| camera.prepare().project(at).unwrap());
            assert!((a / 5.0 - b).length() < 1e-9, "{a} {b}");
        }
        assert_eq!((small.width, small.height), (8, 4));
        assert_eq!(planes([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]].into_iter()), [1.0, 4.0, 2.0, 5.0, 3.0, 6.0]);
    }
}
