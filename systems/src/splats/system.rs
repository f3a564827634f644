//! A cloud as a [`System`]: drawn and measured like one that was trained here, and never trained.

use super::cloud::Cloud;
use crate::views::{RAY_RADIUS, one_pixel};
use engine::data::Dataset;
use engine::system::{Layers, Query, SkipRow, StepStats, System, SystemError, Tensor, TensorMap};
use render_core::camera::Camera;
use render_core::ray::Ray;
use splat_core::rest_len;

/// Numbers of a Gaussian besides its coefficients of higher degrees: centre, scales, rotation, opacity, colour.
const NUMBERS: usize = 14;

impl Cloud {
    /// A picture; that of nothing where a camera cannot see.
    fn picture(&self, camera: &Camera, query: &Query) -> Layers {
        let pixels = camera.width as usize * camera.height as usize;
        self.render(camera, query).map_or_else(|_| Layers::nothing(pixels, query), |view| view.layers)
    }
}

impl System for Cloud {
    fn name(&self) -> &'static str {
        "gaussians"
    }

    fn step(&mut self, _data: &Dataset, _step: u64) -> Result<StepStats, SystemError> {
        Err(SystemError::Config {
            field: "system",
            value: self.name().into(),
            problem: "a file of Gaussians is drawn as it is; `--system splat` trains some".into(),
        })
    }

    fn render_view(&self, camera: &Camera, query: &Query) -> Option<Layers> {
        Some(self.picture(camera, query))
    }

    fn render_before(&self, camera: &Camera, depth: f64, query: &Query) -> Option<Vec<f32>> {
        let before = self.part(|i| camera.pose.to_camera(self.place(i)).z < depth);
        Some(before.picture(camera, query).opacity)
    }

    fn render(&self, rays: &[Ray], query: &Query) -> Layers {
        self.render_cones(rays, &vec![RAY_RADIUS; rays.len()], query)
    }

    fn render_cones(&self, rays: &[Ray], radii: &[f32], query: &Query) -> Layers {
        let mut out = Layers::default();
        for (ray, &radius) in rays.iter().zip(radii) {
            out.extend(self.picture(&one_pixel(ray, radius), query));
        }
        out
    }

    fn density(&self, _points: &[[f64; 3]], _time: f64, out: &mut [f32]) {
        // Opacity on a picture, no density in space.
        out.fill(0.0);
    }

    fn colour(&self, _points: &[[f64; 3]], _d: &[[f32; 3]], _time: f64, out: &mut [[f32; 3]]) {
        out.fill([0.0; 3]);
    }

    fn bounds(&self) -> [[f64; 3]; 2] {
        let (middle, radius) = self.extent();
        [(middle - radius).to_array(), (middle + radius).to_array()]
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        Vec::new()
    }

    fn load_state(&mut self, _state: &TensorMap) -> Result<(), SystemError> {
        Ok(())
    }

    fn parameter_count(&self) -> usize {
        self.len() * (NUMBERS + 3 * rest_len(self.degree()))
    }

    fn memory_bytes(&self) -> usize {
        self.parameter_count() * size_of::<f32>()
    }

    fn skips(&self) -> Vec<SkipRow> {
        Vec::new()
    }

    fn timings(&self) -> Vec<(&'static str, f64)> {
        Vec::new()
    }
}
