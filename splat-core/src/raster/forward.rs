//! Composites one tile front to back: `C += alpha T c`.

use float_core::{Task, Vector};

use super::transmittance::{TileGaussian, Transmittance};
use super::{PIXELS, Tile};
use crate::tiles::TILE;

/// Composites a tile. `out` `[K + 1][PIXELS]`: features, then transmittance.
pub(super) struct Forward<'a, const K: usize> {
    pub(super) tile: Tile<'a, K>,
    pub(super) out: &'a mut [f32],
}

impl<const K: usize> Task for Forward<'_, K> {
    /// Number of the tile's Gaussians that were visited before all its pixels had ended.
    type Output = u32;

    #[inline(always)]
    fn run<V: Vector>(self) -> u32 {
        let Self { tile, out } = self;
        let (value, trans) = out.split_at_mut(K * PIXELS);
        value.fill(0.0);
        let mut transmittance = Transmittance::<V>::new(&tile);
        let mut visited = 0;
        for &entry in tile.entries {
            let gaussian = TileGaussian::<V, K>::new(&tile, entry);
            for y in gaussian.rows.clone() {
                if !transmittance.is_live(y) {
                    continue;
                }
                for x in (0..TILE).step_by(V::LANES) {
                    let Some(contribution) = transmittance.composite(&gaussian, y, x) else { continue };
                    for (k, &feature) in gaussian.feature.iter().enumerate() {
                        let sum = &mut value[k * PIXELS + y * TILE + x..];
                        contribution.w.mul_add(feature, V::load(sum)).store(sum);
                    }
                }
                transmittance.end_row(y);
            }
            visited += 1;
            if transmittance.is_over() {
                break;
            }
        }
        trans.copy_from_slice(&transmittance.trans);
        visited
    }
}
