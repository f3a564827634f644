//! Mean absolute difference and structural dissimilarity.

use super::{PictureTerm, TargetPicture};
use crate::views::planes::{COLOUR, PlaneBars, RenderedPicture};
use engine::system::SystemError;
use float_core::Simd;
use losses::LossError;
use losses::dssim::{Dssim, Pair, Target};
use serde::{Deserialize, Serialize};

/// Settings of [`L1Dssim`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct L1DssimConfig {
    /// Share of `1 - SSIM` in the loss.
    pub(crate) dssim: f32,
}

impl L1DssimConfig {
    /// # Errors
    /// [`SystemError::Config`] for a share that is none.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        if (0.0..=1.0).contains(&self.dssim) {
            return Ok(());
        }
        let value = self.dssim.to_string();
        Err(SystemError::Config { field: "dssim", value, problem: "must be 0 to 1".into() })
    }
}

/// Which colours are to have the structure of the photo.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Structure {
    /// Those of the picture.
    #[default]
    Picture,
    /// Those before the appearance: structure is learnt by the cloud, not by codes (Kulhanek et al., "WildGaussians", 2024, equation 8).
    Plain,
}

/// `(1 - lambda) mean |x - y| + lambda mean (1 - SSIM)` of rendered colours `x` and the photo's `y`, each pixel times its weight.
///
/// # Source
/// Kerbl et al., "3D Gaussian splatting for real-time radiance field rendering", 2023, equation 7.
#[derive(Debug)]
pub(crate) struct L1Dssim {
    lambda: f32,
    structure: Structure,
    buffers: Dssim,
}

impl L1Dssim {
    pub(crate) fn new(simd: Simd, config: &L1DssimConfig) -> Self {
        Self { lambda: config.dssim, structure: Structure::Picture, buffers: Dssim::new(simd) }
    }

    /// The same, with the structure of other colours.
    pub(crate) fn with_structure(self, structure: Structure) -> Self {
        Self { structure, ..self }
    }
}

impl PictureTerm for L1Dssim {
    fn add(
        &mut self,
        picture: &RenderedPicture<'_>,
        target: &TargetPicture<'_>,
        bars: &mut PlaneBars,
        loss: &mut f64,
    ) -> Result<(), LossError> {
        let pair = Pair {
            channels: COLOUR,
            height: picture.size[1],
            width: picture.size[0],
            x: picture.colour,
            target: Target::Planes(target.colour),
            weights: target.weights,
        };
        match picture.plain.filter(|_| self.structure == Structure::Plain) {
            None => *loss += self.buffers.l1_dssim_backward(&pair, self.lambda, 1.0, bars.colour())?.loss,
            Some(plain) => {
                let share = f64::from(self.lambda);
                *loss += (1.0 - share) * self.buffers.l1_dssim_backward(&pair, 0.0, 1.0 - share, bars.colour())?.l1;
                let pair = Pair { x: plain, ..pair };
                *loss += share * self.buffers.dssim_backward(&pair, share, bars.plain())?;
            }
        }
        Ok(())
    }

    fn reads_plain(&self) -> bool {
        self.structure == Structure::Plain
    }
}
