//! Composites one tile front to back: `C += alpha T c`.

use float_core::{Task, Vector};

use super::blocks::{BLOCK, EachOf, touched};
use super::transmittance::{TileGaussian, Transmittance};
use super::{PIXELS, Tile};

/// So many Gaussians are tested before the first of them is composited: their tests do not wait for each other.
const AHEAD: usize = 32;

/// Composites a tile. `out` `[K + 1][PIXELS]`: features, then transmittance.
pub(super) struct Forward<'a, const K: usize> {
    pub(super) tile: Tile<'a, K>,
    pub(super) out: &'a mut [f32],
    /// Written: for each Gaussian of the list one bit for each block that it contributed to.
    pub(super) blocks: &'a mut [u16],
}

impl<const K: usize> Task for Forward<'_, K> {
    /// Number of the tile's Gaussians that were visited before all its pixels had ended.
    type Output = u32;

    #[inline(always)]
    fn run<V: Vector>(self) -> u32 {
        let Self { tile, out, blocks } = self;
        let (value, trans) = out.split_at_mut(K * PIXELS);
        value.fill(0.0);
        let mut transmittance = Transmittance::<V>::new(&tile);
        let mut visited = 0;
        for (entries, blocks) in tile.entries.chunks(AHEAD).zip(blocks.chunks_mut(AHEAD)) {
            for (&entry, blocks) in entries.iter().zip(&mut *blocks) {
                *blocks = touched::<V, K>(&tile, entry) as u16;
            }
            for (&entry, blocks) in entries.iter().zip(blocks) {
                visited += 1;
                let reached = transmittance.live(u32::from(*blocks));
                *blocks = 0;
                if reached == 0 {
                    continue;
                }
                let gaussian = TileGaussian::<V, K>::new(&tile, entry);
                for block in EachOf(reached) {
                    for from in (0..BLOCK).step_by(V::LANES) {
                        let Some(contribution) = transmittance.composite(&gaussian, block, from) else { continue };
                        *blocks |= 1 << block;
                        for (k, &feature) in gaussian.feature.iter().enumerate() {
                            let sum = &mut value[k * PIXELS + block * BLOCK + from..];
                            contribution.w.mul_add(feature, V::load(sum)).store(sum);
                        }
                    }
                }
                if transmittance.is_over() {
                    break;
                }
            }
            if transmittance.is_over() {
                break;
            }
        }
        trans.copy_from_slice(transmittance.trans.as_flattened());
        visited
    }
}
