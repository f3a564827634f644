//! No occluders: every pixel shows the scene.

use super::OccluderModel;
use super::pixel_error::kernel_loss;
use crate::photo_model::{PhotoAndRender, Pixel, PixelBar};
use engine::system::{SystemError, Tensor, TensorMap};
use losses::kernel::Kernel;

/// The loss of all pixels.
pub(crate) struct NoOccluders {
    /// Of the render.
    pub(crate) kernel: Kernel,
    /// Of the coarse render.
    pub(crate) coarse: Kernel,
}

impl OccluderModel for NoOccluders {
    fn loss(&self, _i: usize, pixel: &Pixel, truth: [f32; 3]) -> (f32, PixelBar) {
        kernel_loss(self.kernel, pixel.rgb, truth, 1.0)
    }

    fn coarse_loss(&self, _i: usize, rgb: [f32; 3], truth: [f32; 3]) -> (f32, [f32; 3]) {
        let (loss, bar) = kernel_loss(self.coarse, rgb, truth, 1.0);
        (loss, bar.rgb)
    }

    fn visibility(&self, _seen: &PhotoAndRender<'_>) -> Option<Vec<f32>> {
        None
    }

    fn push_state<'a>(&'a self, _out: &mut Vec<Tensor<'a>>) {}

    fn load_state(&mut self, _state: &TensorMap) -> Result<(), SystemError> {
        Ok(())
    }

    fn memory_bytes(&self) -> usize {
        0
    }
}
