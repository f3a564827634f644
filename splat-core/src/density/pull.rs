//! How hard pictures pull at each Gaussian.

use alloc::vec::Vec;

use float_core::m32;

use super::{Fresh, Rows};
use crate::{Footprint, SplatError};

/// Gradients of the loss with respect to centres on pictures, gathered over views.
///
/// # Source
/// Kerbl et al., "3D Gaussian splatting", 2023, section 5.2.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pull {
    sum: Vec<f32>,
    views: Vec<f32>,
    radius: Vec<f32>,
}

impl Pull {
    /// Of `n` Gaussians that no view has shown yet.
    ///
    /// # Panics
    /// If there is no memory for `n` Gaussians.
    #[must_use]
    pub fn new(n: usize) -> Self {
        let zeros = || alloc::vec![0.0; n];
        Self { sum: zeros(), views: zeros(), radius: zeros() }
    }

    /// Add a view of `size` (columns, rows): `uv_bar(k)` is the gradient with respect to the centre of `footprints[k]`, per pixel
    /// of distance, summed over the picture ([`Record::uv`](crate::Record)), or the sum of its absolute values for that variant.
    ///
    /// What is added is `|(W/2 u_bar, H/2 v_bar)|`: the gradient per half picture, so that thresholds mean the same to pictures of
    /// all sizes as far as pixels agree. One that is not finite counts for nothing, not even as a view.
    ///
    /// # Errors
    /// [`SplatError::Shape`] where a footprint belongs to none of the Gaussians. Those before it have been added then.
    pub fn add(
        &mut self,
        footprints: &[Footprint],
        size: [usize; 2],
        uv_bar: impl Fn(usize) -> [f32; 2],
    ) -> Result<(), SplatError> {
        let half = size.map(|n| 0.5 * n as f32);
        for (k, f) in footprints.iter().enumerate() {
            let i = f.index as usize;
            if i >= self.sum.len() {
                return Err(SplatError::Shape { what: "pull", want: i + 1, got: self.sum.len() });
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

    /// What a checkpoint keeps: sums, views, radii.
    #[must_use]
    pub fn parts(&self) -> [&[f32]; 3] {
        [&self.sum, &self.views, &self.radius]
    }

    /// Continue from [`parts`](Self::parts).
    ///
    /// # Errors
    /// [`SplatError::Shape`] where their lengths differ.
    pub fn restore([sum, views, radius]: [Vec<f32>; 3]) -> Result<Self, SplatError> {
        for (what, part) in [("views", &views), ("radius", &radius)] {
            if part.len() != sum.len() {
                return Err(SplatError::Shape { what, want: sum.len(), got: part.len() });
            }
        }
        Ok(Self { sum, views, radius })
    }

    /// `[n]` average over the views that showed each; 0 where there was none.
    #[must_use]
    pub fn mean(&self) -> Vec<f32> {
        self.sum.iter().zip(&self.views).map(|(sum, views)| sum / views.max(1.0)).collect()
    }

    /// `[n]` views that showed each.
    #[must_use]
    pub fn views(&self) -> &[f32] {
        &self.views
    }

    /// `[n]` largest half width or height on any picture, pixels.
    #[must_use]
    pub fn radius(&self) -> &[f32] {
        &self.radius
    }

    /// Follow a change of rows; fresh ones start at 0.
    ///
    /// # Errors
    /// [`SplatError::Shape`].
    pub fn follow(&self, rows: &Rows) -> Result<Self, SplatError> {
        let follow = |x| rows.apply("pull", x, 1, Fresh::Is(0.0));
        Ok(Self { sum: follow(&self.sum)?, views: follow(&self.views)?, radius: follow(&self.radius)? })
    }
}
