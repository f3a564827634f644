//! The rays of a whole image, worked out once.

use alloc::vec::Vec;
use glam::{DVec2, DVec3};

use super::{parameters::Camera, prepared::Prepared};
use crate::pose::Pose;
use crate::ray::Ray;

/// Unit directions, camera axes, through the centre of every pixel of an image.
///
/// Undistorting costs much more than a look-up, and frames taken by one camera share the result: keep one table per
/// [`Camera::same_optics`] (in an `Arc`). 12 bytes a pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct RayTable {
    width: u32,
    height: u32,
    /// Rows top to bottom; zero where the lens has no ray.
    directions: Vec<[f32; 3]>,
}

impl RayTable {
    /// The table of a camera; its pose does not matter.
    ///
    /// # Panics
    /// If there is no memory for `width * height` directions.
    #[must_use]
    pub fn new(camera: &Camera) -> Self {
        let prepared = camera.prepare();
        let mut directions = alloc::vec![[0.0; 3]; camera.width as usize * camera.height as usize];
        if camera.width > 0 {
            #[cfg(feature = "rayon")]
            {
                use rayon::prelude::*;
                let rows = directions.par_chunks_exact_mut(camera.width as usize).enumerate();
                rows.for_each(|(j, row)| fill_row(&prepared, j, row));
            }
            #[cfg(not(feature = "rayon"))]
            for (j, row) in directions.chunks_exact_mut(camera.width as usize).enumerate() {
                fill_row(&prepared, j, row);
            }
        }
        Self { width: camera.width, height: camera.height, directions }
    }

    /// Columns and rows.
    #[must_use]
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Every direction, rows top to bottom; `[0, 0, 0]` where the lens has no ray.
    #[must_use]
    pub fn directions(&self) -> &[[f32; 3]] {
        &self.directions
    }

    /// Unit direction of pixel `(i, j)` (column, row); `None` where the lens has no ray, and outside of the image.
    #[must_use]
    pub fn direction(&self, i: u32, j: u32) -> Option<[f32; 3]> {
        if i >= self.width || j >= self.height {
            return None;
        }
        let d = self.directions[j as usize * self.width as usize + i as usize];
        (d != [0.0; 3]).then_some(d)
    }

    /// The ray of pixel `(i, j)` for a camera that stands at `pose`.
    #[must_use]
    pub fn ray(&self, pose: &Pose, i: u32, j: u32) -> Option<Ray> {
        let [x, y, z] = self.direction(i, j)?;
        // Normalised again: rounding to f32 leaves a length off by 1e-8.
        let d = DVec3::new(f64::from(x), f64::from(y), f64::from(z));
        Some(Ray { o: pose.c, d: (pose.r * d).normalize() })
    }

    /// How many pixels have a ray.
    #[must_use]
    pub fn valid(&self) -> usize {
        self.directions.iter().filter(|&&d| d != [0.0; 3]).count()
    }
}

fn fill_row(camera: &Prepared, j: usize, row: &mut [[f32; 3]]) {
    for (i, out) in row.iter_mut().enumerate() {
        if let Some(d) = camera.direction(DVec2::new(i as f64 + 0.5, j as f64 + 0.5)) {
            *out = d.as_vec3().to_array();
        }
    }
}
