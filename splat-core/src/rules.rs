//! The few rules that decide who contributes to a pixel: said once, kept by every path.

use crate::SplatError;

/// What becomes of opacity where a footprint is widened to a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Widening {
    /// It stays: what is smaller than a pixel grows brighter with distance (3DGS).
    #[default]
    Keeps,
    /// It falls with the area gained (gsplat's antialiased mode, Mip-Splatting's 2D filter).
    Dims,
}

/// Constants of projection and compositing.
///
/// A Gaussian contributes to a pixel where `q < 2 ln(opacity / alpha_min)`, `q` the squared Mahalanobis distance: the usual
/// `alpha < 1/255` rule, independent of how the exponential is computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rules {
    /// Gaussians at this depth or nearer are left out, world units.
    pub near: f32,
    /// Added to the variance along both axes of the picture, pixels squared.
    pub blur: f32,
    /// What becomes of opacity then.
    pub widening: Widening,
    /// A pixel has no contribution fainter than this.
    pub alpha_min: f32,
    /// No contribution is denser than this.
    pub alpha_max: f32,
    /// A pixel is finished before the contribution that would leave no more than this of its light.
    pub stop: f32,
    /// A pixel is finished after the contribution that leaves no more than this of its light: what is behind changes it by no more than
    /// this share of the largest feature there, or of the background. 0: none is.
    pub enough: f32,
}

impl Rules {
    /// Those of 3DGS: a blur of 0.3 px², contributions from 1/255 to 0.99, the end at 1e-4. `near` depends on the scene's unit.
    pub const DEFAULT: Self = Self {
        near: 0.01,
        blur: 0.3,
        widening: Widening::Keeps,
        alpha_min: 1.0 / 255.0,
        alpha_max: 0.99,
        stop: 1e-4,
        enough: 0.0,
    };

    /// # Errors
    /// [`SplatError::Value`] naming the first constant outside its range.
    pub fn check(&self) -> Result<(), SplatError> {
        let checks = [
            ("near", self.near, self.near > 0.0 && self.near.is_finite(), "a positive distance"),
            ("blur", self.blur, self.blur > 0.0 && self.blur.is_finite(), "a positive variance"),
            ("alpha_min", self.alpha_min, self.alpha_min > 0.0 && self.alpha_min < 1.0, "a number between 0 and 1"),
            ("alpha_max", self.alpha_max, self.alpha_max > 0.0 && self.alpha_max < 1.0, "a number between 0 and 1"),
            ("stop", self.stop, (0.0..1.0).contains(&self.stop), "at least 0, below 1"),
            ("enough", self.enough, (0.0..1.0).contains(&self.enough), "at least 0, below 1"),
        ];
        match checks.into_iter().find(|(_, _, fine, _)| !fine) {
            Some((what, got, _, accepts)) => Err(SplatError::Value { what, got: f64::from(got), accepts }),
            None => Ok(()),
        }
    }
}
