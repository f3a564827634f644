//! Median depth: the depth of the Gaussian at which a pixel's transmittance falls to 1/2. Unlike the mean depth it lies on one surface.

use float_core::{Task, Vector};

use super::Tile;
use super::transmittance::{TileGaussian, Transmittance};
use crate::tiles::TILE;

/// Transmittance at the median.
pub(super) const HALF: f32 = 0.5;

/// Walks a tile whose settings end a pixel at transmittance [`HALF`]. `out` `[TILE][TILE]`: depth of the last Gaussian that contributed to
/// a pixel; infinite where the transmittance stays above [`HALF`].
pub(super) struct MedianDepth<'a, const K: usize> {
    pub(super) tile: Tile<'a, K>,
    pub(super) out: &'a mut [f32],
}

impl<const K: usize> Task for MedianDepth<'_, K> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { tile, out } = self;
        let mut transmittance = Transmittance::<V>::new(&tile);
        for &entry in tile.entries {
            let gaussian = TileGaussian::<V, K>::new(&tile, entry);
            let z = V::splat(tile.gaussians[entry as usize].z);
            for y in gaussian.rows.clone() {
                if !transmittance.is_live(y) {
                    continue;
                }
                for x in (0..TILE).step_by(V::LANES) {
                    let Some(contribution) = transmittance.composite(&gaussian, y, x) else { continue };
                    let at = &mut out[y * TILE + x..];
                    contribution.w.select_positive(z, V::load(at)).store(at);
                }
                transmittance.end_row(y);
            }
            if transmittance.is_over() {
                break;
            }
        }
        for (out, left) in out.iter_mut().zip(&transmittance.trans) {
            if *left > HALF {
                *out = f32::INFINITY;
            }
        }
    }
}
