//! The gradient of a photo's loss with respect to its camera. See [`CameraGradients`].

use super::driver::Views;
use super::photo::view;
use crate::gradients::{CameraGradients, PhotoGradient};
use engine::data::Dataset;
use engine::system::SystemError;
use render_core::camera::Camera;
use splat_core::CameraGradient;

/// The gradient with respect to the camera `full`, from that with respect to the same camera of smaller pictures in a frame whose unit is
/// `scale` units of the scene.
fn of_scene(internal: &CameraGradient, scale: f64, shown: &Camera, full: &Camera) -> CameraGradient {
    let mut out = *internal;
    // A translation of so many units of the scene is one of fewer units of the frame.
    out.xi[3..].iter_mut().for_each(|v| *v /= scale);
    let shrunk = [shown.fx / full.fx, shown.fy / full.fy];
    for (axis, shrunk) in shrunk.into_iter().enumerate() {
        out.f[axis] *= shrunk;
        out.c[axis] *= shrunk;
    }
    out
}

impl CameraGradients for Views {
    fn camera_gradient(&mut self, data: &Dataset, index: usize, step: u64) -> Result<PhotoGradient, SystemError> {
        if index >= data.len() {
            let problem = format!("there are {} photos", data.len());
            return Err(SystemError::Config { field: "view", value: index.to_string(), problem });
        }
        let shown = self.show_one(data, step, |_| index)?;
        let seen = view(&shown.camera, &self.parts.frame);
        let mut camera = CameraGradient::default();
        let outcome = self.compare(step, &seen, &shown, Some(&mut camera));
        // What the appearance would have learnt is not for the next step.
        if let Some(part) = &mut self.parts.appearance {
            part.forget();
        }
        let loss = outcome?.loss;
        let camera = of_scene(&camera, self.parts.frame.scale, &shown.camera, &data.view(index).camera);
        Ok(PhotoGradient { loss, camera })
    }
}
