//! Rendered depth is held to depth that was measured or estimated.

use super::{PictureTerm, TargetPicture};
use crate::views::planes::{PlaneBars, RenderedPicture};
use crate::views::weights::nearest;
use losses::LossError;

/// Depths of a photo: `z` along the camera's axis, internal units.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct DepthMap {
    /// Columns and rows; any, of the whole picture.
    pub(crate) size: [usize; 2],
    /// `[rows][columns]`; not positive or not finite where nothing is known.
    pub(crate) z: Vec<f32>,
}

impl DepthMap {
    /// Depth at pixel `at` of a picture of `size`: that of the entry at its centre. `None` where nothing is known.
    fn at(&self, at: [usize; 2], size: [usize; 2]) -> Option<f32> {
        self.z.get(nearest(at, size, self.size)).copied().filter(|z| *z > 0.0 && z.is_finite())
    }
}

/// `factor * mean w |z - m|` with `z = D / (1 - T)` the mean depth of what a pixel shows: `D` the composited depth, `T` the
/// transmittance. `w` is the pixel's weight; 0 where no depth `m` is known and where the pixel shows nothing. The mean is over all
/// pixels, as that of colours is.
///
/// # Source
/// As in EndoNeRF (Wang et al., 2022, section 2.3) for rays; per unit of opacity, so that a thin pixel is not drawn nearer.
#[derive(Clone, Debug)]
pub(crate) struct DepthTerm {
    /// Factor of the loss.
    pub(crate) factor: f32,
    /// Of each view of the dataset; `None` where there is none.
    pub(crate) maps: Vec<Option<DepthMap>>,
}

impl DepthTerm {
    /// A pixel shows something from this opacity on.
    const SHOWS: f32 = 0.05;
}

impl PictureTerm for DepthTerm {
    fn add(
        &mut self,
        picture: &RenderedPicture<'_>,
        target: &TargetPicture<'_>,
        bars: &mut PlaneBars,
        loss: &mut f64,
    ) -> Result<(), LossError> {
        let (Some(depth), Some(Some(map))) = (picture.depth, self.maps.get(target.view)) else { return Ok(()) };
        let (width, pixels) = (picture.size[0], depth.len());
        let share = self.factor / pixels.max(1) as f32;
        let mut transmittance_bar = vec![0.0; pixels];
        let depth_bar = bars.depth();
        for i in 0..pixels {
            let opacity = 1.0 - picture.transmittance[i];
            let weight = target.weights.map_or(1.0, |weights| weights[i]);
            if opacity < Self::SHOWS || weight == 0.0 {
                continue;
            }
            let Some(measured) = map.at([i % width, i / width], picture.size) else { continue };
            let z = depth[i] / opacity;
            *loss += f64::from(share * weight * (z - measured).abs());
            // 0 where they agree.
            let sign = if z == measured { 0.0 } else { (z - measured).signum() };
            let z_bar = share * weight * sign;
            depth_bar[i] += z_bar / opacity;
            transmittance_bar[i] = z_bar * z / opacity;
        }
        for (sum, bar) in bars.transmittance().iter_mut().zip(transmittance_bar) {
            *sum += bar;
        }
        Ok(())
    }

    fn reads_depth(&self) -> bool {
        true
    }
}
