//! Ellipses to pixels, tile by tile, and back.

mod backward;
mod forward;
mod light;
mod middle;
mod picture;

pub use picture::{Drawn, Raster};

use crate::Rules;
use crate::project::Footprint;
use crate::tiles::TILE;

/// Pixels of a tile.
pub(crate) const PIXELS: usize = TILE * TILE;

/// A tile and what lies over it.
#[derive(Clone, Copy)]
struct Tile<'a, const K: usize> {
    /// Front to back.
    entries: &'a [u32],
    footprints: &'a [Footprint],
    features: &'a [[f32; K]],
    rules: &'a Rules,
    /// Upper left corner, pixels.
    corner: [f32; 2],
    /// Rows of it that are in the picture.
    rows: usize,
}

/// Sums over the pixels of a tile: gradient with respect to the numbers of one ellipse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Record<const K: usize> {
    /// Of the centre.
    pub uv: [f32; 2],
    /// Of the conic.
    pub conic: [f32; 3],
    /// Of the opacity.
    pub opacity: f32,
    /// Of the features.
    pub features: [f32; K],
}

impl<const K: usize> Default for Record<K> {
    fn default() -> Self {
        Self { uv: [0.0; 2], conic: [0.0; 3], opacity: 0.0, features: [0.0; K] }
    }
}

impl<const K: usize> Record<K> {
    fn add(&mut self, more: &Self) {
        for (sum, x) in self.uv.iter_mut().zip(more.uv) {
            *sum += x;
        }
        for (sum, x) in self.conic.iter_mut().zip(more.conic) {
            *sum += x;
        }
        self.opacity += more.opacity;
        for (sum, x) in self.features.iter_mut().zip(more.features) {
            *sum += x;
        }
    }
}
