//! The settings of the rasteriser: which Gaussians contribute to a pixel, and how much.

use crate::SplatError;

/// What happens to a Gaussian's opacity when [`RasterSettings::blur`] widens it on the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Widening {
    /// Opacity stays: Gaussians smaller than a pixel look brighter the farther away they are (3DGS).
    #[default]
    Keeps,
    /// Opacity falls by the ratio of the areas before and after (gsplat's "antialiased" mode, Mip-Splatting's 2D filter).
    Dims,
}

/// Settings of projection and compositing.
///
/// A Gaussian contributes to a pixel where `q < 2 ln(opacity / alpha_min)`, with `q` the squared Mahalanobis distance. This is the
/// usual rule `alpha >= 1/255`, written so that it does not depend on how the exponential is computed.
///
/// ```
/// use splat_core::{RasterSettings, Widening};
/// let settings = RasterSettings::DEFAULT.with_near(0.2).with_widening(Widening::Dims);
/// assert_eq!(settings.blur, 0.3);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct RasterSettings {
    /// Gaussians at this depth `z` or nearer are not drawn, world units.
    pub near: f32,
    /// Variance added along both axes of the picture, px².
    pub blur: f32,
    /// What the blur does to opacity.
    pub widening: Widening,
    /// Contributions with a smaller alpha are left out.
    pub alpha_min: f32,
    /// Alpha is clamped to this.
    pub alpha_max: f32,
    /// A pixel ends *before* the Gaussian that would bring its transmittance to this or below (3DGS).
    pub transmittance_min: f32,
    /// Early termination: a pixel ends *after* the Gaussian that brings its transmittance to this or below. The error is at most
    /// this times the largest feature (or background) behind. 0 disables it.
    pub transmittance_stop: f32,
}

impl RasterSettings {
    /// The constants of 3DGS: blur 0.3 px², alpha from 1/255 to 0.99, transmittance not below 1e-4, no early termination. `near` is
    /// 0.01: choose it for the scene's unit.
    pub const DEFAULT: Self = Self {
        near: 0.01,
        blur: 0.3,
        widening: Widening::Keeps,
        alpha_min: 1.0 / 255.0,
        alpha_max: 0.99,
        transmittance_min: 1e-4,
        transmittance_stop: 0.0,
    };

    float_core::setters! {
        with_near near: f32;
        with_blur blur: f32;
        with_widening widening: Widening;
        with_alpha_min alpha_min: f32;
        with_alpha_max alpha_max: f32;
        with_transmittance_min transmittance_min: f32;
        with_transmittance_stop transmittance_stop: f32;
    }

    /// Whether every setting lies in its range.
    ///
    /// # Errors
    /// [`SplatError::Value`] naming the first setting outside its range.
    pub fn check(&self) -> Result<(), SplatError> {
        let (min, stop) = (self.transmittance_min, self.transmittance_stop);
        let checks = [
            ("near", self.near, self.near > 0.0 && self.near.is_finite(), "a positive distance"),
            ("blur", self.blur, self.blur > 0.0 && self.blur.is_finite(), "a positive variance"),
            ("alpha_min", self.alpha_min, self.alpha_min > 0.0 && self.alpha_min < 1.0, "a number between 0 and 1"),
            ("alpha_max", self.alpha_max, self.alpha_max > 0.0 && self.alpha_max < 1.0, "a number between 0 and 1"),
            ("transmittance_min", min, (0.0..1.0).contains(&min), "at least 0, below 1"),
            ("transmittance_stop", stop, (0.0..1.0).contains(&stop), "at least 0, below 1"),
        ];
        match checks.into_iter().find(|(_, _, fine, _)| !fine) {
            Some((what, got, _, accepts)) => Err(SplatError::Value { what, got: f64::from(got), accepts }),
            None => Ok(()),
        }
    }
}

impl Default for RasterSettings {
    fn default() -> Self {
        Self::DEFAULT
    }
}
