//! Statistics of view-space positional gradients.

use alloc::vec::Vec;

use float_core::m32;

use super::{Fresh, Rows};
use crate::{ProjectedGaussian, SplatError};

/// View-space positional gradients of each Gaussian, averaged over views: the criterion of densification.
///
/// The caller chooses the gradient: plain ([`ProjectedGradient::uv`](crate::ProjectedGradient::uv)) as in 3DGS, or absolute
/// ([`Raster::backward_absolute`](crate::Raster::backward_absolute)) as in AbsGS, where opposite gradients of different pixels do not
/// cancel. Thresholds ([`Adc::gradient_threshold`](super::Adc::gradient_threshold)) differ.
///
/// # Source
/// Kerbl et al., "3D Gaussian splatting", 2023, section 5.2; Ye et al., "AbsGS: recovering fine
/// details for 3D Gaussian splatting", 2024; Yu et al., "Gaussian Opacity Fields", 2024.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ViewSpaceGradients {
    /// Sum of the gradients' norms.
    sum: Vec<f32>,
    /// Number of views.
    views: Vec<f32>,
    /// Largest half extent, pixels.
    radius: Vec<f32>,
}

impl ViewSpaceGradients {
    /// For `n` Gaussians that no view has shown yet.
    ///
    /// # Panics
    /// If there is no memory for `n` Gaussians.
    #[must_use]
    pub fn new(n: usize) -> Self {
        let zeros = || alloc::vec![0.0; n];
        Self { sum: zeros(), views: zeros(), radius: zeros() }
    }

    /// Add a view of `size` (columns, rows). `uv_bar(k)` is the gradient with respect to the centre of `gaussians[k]`, per pixel.
    ///
    /// The value added is `|(W/2 u_bar, H/2 v_bar)|`, the gradient in normalised device coordinates, so that one threshold serves
    /// pictures of different sizes. A gradient that is not finite is ignored, and so is its view.
    ///
    /// # Errors
    /// [`SplatError::Shape`] if an index of `gaussians` is out of range. Those before it have been added then.
    pub fn add(
        &mut self,
        gaussians: &[ProjectedGaussian],
        size: [usize; 2],
        uv_bar: impl Fn(usize) -> [f32; 2],
    ) -> Result<(), SplatError> {
        let half = size.map(|n| 0.5 * n as f32);
        for (k, f) in gaussians.iter().enumerate() {
            let i = f.index as usize;
            if i >= self.sum.len() {
                return Err(SplatError::Shape { what: "view_space_gradients", want: i + 1, got: self.sum.len() });
            }
            let [u, v] = uv_bar(k);
            let norm = m32::hypot(half[0] * u, half[1] * v);
            if norm.is_finite() {
                self.sum[i] += norm;
                self.views[i] += 1.0;
                self.radius[i] = self.radius[i].max(f.half[0].max(f.half[1]));
            }
        }
        Ok(())
    }

    /// The state to save in a checkpoint: sums, views, radii, `[n]` each.
    #[must_use]
    pub fn parts(&self) -> [&[f32]; 3] {
        [&self.sum, &self.views, &self.radius]
    }

    /// Restore from [`parts`](Self::parts).
    ///
    /// # Errors
    /// [`SplatError::Shape`] if their lengths differ.
    pub fn restore(parts: [Vec<f32>; 3]) -> Result<Self, SplatError> {
        let [sum, views, radius] = parts;
        for (what, part) in [("views", &views), ("radius", &radius)] {
            if part.len() != sum.len() {
                return Err(SplatError::Shape { what, want: sum.len(), got: part.len() });
            }
        }
        Ok(Self { sum, views, radius })
    }

    /// `[n]` mean over the views in which each was visible; 0 if there were none.
    #[must_use]
    pub fn mean(&self) -> Vec<f32> {
        self.sum.iter().zip(&self.views).map(|(sum, views)| sum / views.max(1.0)).collect()
    }

    /// `[n]` number of views in which each was visible.
    #[must_use]
    pub fn views(&self) -> &[f32] {
        &self.views
    }

    /// `[n]` largest half width or half height on any picture, pixels.
    #[must_use]
    pub fn radius(&self) -> &[f32] {
        &self.radius
    }

    /// The statistics after a change of rows; fresh rows start at 0.
    ///
    /// # Errors
    /// [`SplatError::Shape`].
    pub fn follow(&self, rows: &Rows) -> Result<Self, SplatError> {
        let follow = |x| rows.apply("view_space_gradients", x, 1, Fresh::Is(0.0));
        Ok(Self { sum: follow(&self.sum)?, views: follow(&self.views)?, radius: follow(&self.radius)? })
    }
}
