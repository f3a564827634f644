//! Terms of the loss that read a whole picture: its colours, its depth, how much of the background shows.
//!
//! Each is a [`PictureTerm`]. The driver renders the picture of a photo, hands it to the terms one after the other, and takes the
//! gradients that they add back to the Gaussians.

#[cfg_attr(not(test), allow(dead_code, reason = "no published system is made of it yet"))]
mod depth;
mod depth_shape;
mod l1_dssim;
#[cfg(test)]
mod tests;

#[cfg(test)]
pub(crate) use depth::{DepthMap, DepthTerm};
pub(crate) use depth_shape::{DepthShapeTerm, Nearness};
pub(crate) use l1_dssim::{L1Dssim, L1DssimConfig, Structure};

use super::planes::{PlaneBars, RenderedPicture};
use losses::LossError;

/// What a picture is compared with.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TargetPicture<'a> {
    /// Index of the photo's view in the dataset.
    pub(crate) view: usize,
    /// `[3][pixels]`, the photo on the step's background.
    pub(crate) colour: &'a [f32],
    /// `[pixels]`, how much each pixel counts, 0 or more; `None`: 1 each.
    pub(crate) weights: Option<&'a [f32]>,
}

/// A term of the loss of a picture.
pub(crate) trait PictureTerm: Send + Sync {
    /// Add what the picture costs to `loss`, and its derivatives to `bars`.
    ///
    /// # Errors
    /// [`LossError`] for planes that do not fit each other.
    fn add(
        &mut self,
        picture: &RenderedPicture<'_>,
        target: &TargetPicture<'_>,
        bars: &mut PlaneBars,
        loss: &mut f64,
    ) -> Result<(), LossError>;

    /// Whether it reads the depth of a picture.
    fn reads_depth(&self) -> bool {
        false
    }

    /// Whether it reads the colours before the appearance.
    fn reads_plain(&self) -> bool {
        false
    }

    /// Bytes of what it knows of photos.
    fn bytes(&self) -> usize {
        0
    }
}
