//! Where a system may put one cloud in front of another: drawn one by one, and put together pixel by pixel.

use super::cloud_parameters::CloudParameters;
use super::pass::PicturePass;
use float_core::Simd;
use splat_core::Gaussians;

/// What a cloud in front shows of a pixel, composited over nothing.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FrontSeen {
    pub(crate) colour: [f32; 3],
    pub(crate) masks: [f32; 3],
    pub(crate) transmittance: f32,
}

/// Two clouds that are drawn one by one and put together: the second in front of the first.
pub(crate) trait CloudLayers: Send + Sync {
    /// The pictures of steps.
    fn pass(&self, simd: Simd) -> Box<dyn PicturePass>;

    /// The masks of Gaussian `i` of `n` in front, by the extra rows `[rows][n]`.
    fn masks(&self, extra: &[f32], n: usize, i: usize) -> [f32; 3];

    /// The colour of a pixel, and the share that the front has of it.
    fn pixel(&self, front: &FrontSeen, behind: [f32; 3]) -> ([f32; 3], f32);

    /// The cloud in front as nearly as a cloud without masks shows it.
    fn front_alone(&self, front: &CloudParameters) -> Gaussians;
}

/// Whether pictures show the cloud in front.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Front {
    Shown,
    /// They show what is behind it alone.
    Hidden,
}

/// Two clouds that are put together.
pub(crate) struct ViewLayers {
    pub(crate) part: Box<dyn CloudLayers>,
    /// Whether pictures show the one in front, where nothing is asked.
    pub(crate) front: Front,
}
