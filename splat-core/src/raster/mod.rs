//! Rasteriser: projected Gaussians to pixels, tile by tile, and its backward pass.

mod backward;
mod blocks;
mod forward;
mod median;
mod picture;
mod transmittance;

pub use picture::{DrawStats, Raster};

use crate::RasterSettings;
use crate::project::ProjectedGaussian;
use crate::project::ProjectedGradient;
use crate::tiles::TILE;

/// Pixels of a tile.
pub(crate) const PIXELS: usize = TILE * TILE;

/// A tile of the picture and the Gaussians that touch it.
#[derive(Clone, Copy)]
struct Tile<'a, const K: usize> {
    /// Indices into `gaussians`, front to back.
    entries: &'a [u32],
    gaussians: &'a [ProjectedGaussian],
    features: &'a [[f32; K]],
    settings: &'a RasterSettings,
    /// Upper left corner, pixels.
    corner: [f32; 2],
    /// Columns and rows of the tile that are in the picture.
    size: [usize; 2],
}
