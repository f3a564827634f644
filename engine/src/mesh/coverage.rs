//! How much of what the photos show the mesh has, where it should.

use super::depth::{DepthView, Place};
use super::raster::draw;
use crate::crop::CropBox;
use crate::surface::inside;
use rayon::prelude::*;
use scene_io::export::Mesh;

/// The mesh is where the pictures say if its depth is within this share of theirs.
const CLOSE: f32 = 0.02;

/// Pixels of the photos' views that show something opaque inside of the box.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Coverage {
    /// All of them.
    pub pixels: u64,
    /// Those whose rays hit the mesh within 2 % of the rendered depth.
    pub close: u64,
    /// Those whose rays hit no triangle at all.
    pub missed: u64,
}

impl Coverage {
    /// Compare `mesh` with what `views` show inside `crop`.
    ///
    /// # Panics
    /// If a triangle names a vertex that does not exist, or a view is smaller than its camera's.
    #[must_use]
    pub fn of(mesh: &Mesh, views: &[DepthView], crop: &CropBox) -> Self {
        let of_view = |view: &DepthView| {
            let drawn = draw(mesh, &view.camera);
            let mut sum = Self::default();
            for (i, z) in drawn.z.iter().enumerate().filter(|(i, _)| view.sure[*i]) {
                if view.point(i).is_some_and(|x| inside(&x.to_array(), crop)) {
                    sum.pixels += 1;
                    sum.close += u64::from((z - view.z[i]).abs() <= CLOSE * view.z[i]);
                    sum.missed += u64::from(z.is_infinite());
                }
            }
            sum
        };
        let photos: Vec<Self> = views.par_iter().filter(|v| v.place == Place::Photo).map(of_view).collect();
        photos.into_iter().fold(Self::default(), |a, b| Self {
            pixels: a.pixels + b.pixels,
            close: a.close + b.close,
            missed: a.missed + b.missed,
        })
    }

    /// Share of the pixels that are close, `0..=1`; `None` without pixels.
    #[must_use]
    pub fn share(&self) -> Option<f64> {
        (self.pixels > 0).then(|| self.close as f64 / self.pixels as f64)
    }
}
