//! Terms of the loss that read whole rays, beside the error of pixels: how weight is spread, where rays end, how dense the
//! samples are and of which colour.
//!
//! Each is a `RayTerm`. The driver renders a tile of rays, hands it to the terms one after the other, and takes the gradients
//! that they add back through compositing and networks.

mod depth;
mod distortion;
mod entropy;
mod moving;
mod point_colour;
mod ray_term;
mod sparsity;
#[cfg(test)]
mod tests;

pub(crate) use distortion::Distortion;
pub(crate) use entropy::BackgroundEntropy;
pub(crate) use moving::MovingShare;
pub(crate) use point_colour::PointColour;
pub(crate) use ray_term::{RayBars, RayTerm, TileRays};
pub(crate) use sparsity::Sparsity;

use engine::system::SystemError;
use render_core::ray_distance::RayDistance;
use serde::{Deserialize, Serialize};

/// Factors of the terms; 0: the term is not there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TermConfig {
    /// Factor of the distortion loss, which draws the weight of a ray together; 0: none.
    pub distortion: f32,
    /// Factor of the prior `ln(1 + 2 sigma^2)` on static densities, mean over the samples of a ray; 0: none.
    pub sparsity: f32,
    /// Factor of the entropy of what reaches the background, mean over rays: each ends on something or nothing; 0: none.
    pub background_entropy: f32,
    /// Factor of the squared errors of the colours of single samples, by weight; mean over rays; 0: none.
    pub point_colour: f32,
}

impl TermConfig {
    /// Check the ranges.
    ///
    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        for (field, value) in [
            ("sparsity", self.sparsity),
            ("distortion", self.distortion),
            ("background_entropy", self.background_entropy),
            ("point_colour", self.point_colour),
        ] {
            if !(0.0..=10.0).contains(&value) {
                return Err(SystemError::Config {
                    field,
                    value: value.to_string(),
                    problem: "must be in 0..=10".into(),
                });
            }
        }
        Ok(())
    }

    /// The terms whose factors are not 0; the distortion loss measures lengths in `distance`.
    pub(crate) fn terms(&self, distance: RayDistance) -> Vec<Box<dyn RayTerm>> {
        let mut terms: Vec<Box<dyn RayTerm>> = Vec::new();
        if self.distortion > 0.0 {
            terms.push(Box::new(Distortion { factor: self.distortion, distance }));
        }
        if self.background_entropy > 0.0 {
            terms.push(Box::new(BackgroundEntropy { factor: self.background_entropy }));
        }
        if self.point_colour > 0.0 {
            terms.push(Box::new(PointColour { factor: self.point_colour }));
        }
        if self.sparsity > 0.0 {
            terms.push(Box::new(Sparsity { factor: self.sparsity }));
        }
        terms
    }
}
