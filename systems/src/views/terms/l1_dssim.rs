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

/// `(1 - lambda) mean |x - y| + lambda mean (1 - SSIM)` of rendered colours `x` and the photo's `y`, each pixel times its weight.
///
/// # Source
/// Kerbl et al., "3D Gaussian splatting for real-time radiance field rendering", 2023, equation 7.
#[derive(Debug)]
pub(crate) struct L1Dssim {
    lambda: f32,
    buffers: Dssim,
}

impl L1Dssim {
    pub(crate) fn new(simd: Simd, config: &L1DssimConfig) -> Self {
        Self { lambda: config.dssim, buffers: Dssim::new(simd) }
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
        *loss += self.buffers.l1_dssim_backward(&pair, self.lambda, 1.0, bars.colour())?.loss;
        Ok(())
    }
}
