//! Where a system may put in parts of its own between a cloud and its picture: appearance, and time.

use super::cloud_parameters::CloudParameters;
use super::drawing::DrawnCloud;
use engine::system::{Appearance, SystemError, Tensor, TensorMap};
use float_core::Simd;
use splat_core::ProjectedGaussian;

/// Parameters of a part, besides those of the clouds.
pub(crate) trait Learns: Send + Sync {
    /// A step of its optimiser, that of the schedule and counted from 0, with the gradients since the last one. Returns how many
    /// entries were not finite.
    fn step(&mut self, simd: Simd, step: u64) -> usize;

    /// What its next step depends on.
    fn state(&self) -> Vec<Tensor<'_>>;

    /// Drop the gradient that is kept for the next step.
    fn forget(&mut self);

    /// What [`state`](Self::state) wrote.
    ///
    /// # Errors
    /// [`SystemError::State`] naming the array that is missing or does not fit. Nothing has changed then.
    fn load(&mut self, state: &TensorMap) -> Result<(), SystemError>;

    /// Number of its parameters.
    fn parameter_count(&self) -> usize;
}

/// Appearance: the colours of Gaussians in the appearance of a photo, and gradients back.
pub(crate) trait ColourAppearance: Learns {
    /// Turn the colours of a cloud's visible Gaussians `[visible]`, as spherical harmonics give them, into those that are composited.
    fn forward(
        &self,
        appearance: &Appearance,
        cloud: &DrawnCloud<'_>,
        visible: &[ProjectedGaussian],
        rgb: &mut [[f32; 3]],
    );

    /// Backward twin of [`forward`](Self::forward), of the same `rgb` as it was given. `bar` `[visible]` is the gradient with respect to
    /// the composited colours, and becomes that with respect to `rgb`. The gradient with respect to the extra rows of the cloud is
    /// added to `extra_bar` `[rows][n]`, that with respect to its own parameters is held for the next step.
    fn backward(
        &mut self,
        appearance: &Appearance,
        cloud: &DrawnCloud<'_>,
        visible: &[ProjectedGaussian],
        rgb: &[[f32; 3]],
        bar: &mut [[f32; 3]],
        extra_bar: &mut [f32],
    );
}

/// Colours are turned into those of an appearance.
#[derive(Clone, Copy)]
pub(crate) struct OfAppearance<'a> {
    pub(crate) part: &'a dyn ColourAppearance,
    pub(crate) appearance: &'a Appearance,
}

/// Time: the clouds as they are at a time, and gradients back.
pub(crate) trait CloudMotion: Learns {
    /// Cloud number `index` at `time` (`0..=1`). It has the rows of the `canonical` one.
    fn cloud_at(&self, time: f64, index: usize, canonical: &CloudParameters) -> CloudParameters;

    /// Backward twin of [`cloud_at`](Self::cloud_at). `bar` is the gradient with respect to the cloud at `time`, and becomes that with
    /// respect to the canonical one. The gradient with respect to its own parameters is held for the next step.
    fn pull_back(&mut self, time: f64, index: usize, canonical: &CloudParameters, bar: &mut CloudParameters);
}
