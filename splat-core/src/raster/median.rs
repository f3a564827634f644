//! Median depth: the depth of the Gaussian at which a pixel's transmittance falls to 1/2. Unlike the mean depth it lies on one surface.

use float_core::{Task, Vector};

use super::Tile;
use super::blocks::{BLOCK, EachOf, touched};
use super::transmittance::{TileGaussian, Transmittance};

/// Transmittance at the median.
pub(super) const HALF: f32 = 0.5;

/// Walks a tile whose settings end a pixel at transmittance [`HALF`]. `out` `[blocks][BLOCK]`: depth of the last Gaussian that contributed to
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
            for block in EachOf(transmittance.live(touched::<V, K>(&tile, entry))) {
                for from in (0..BLOCK).step_by(V::LANES) {
                    let Some(contribution) = transmittance.composite(&gaussian, block, from) else { continue };
                    let at = &mut out[block * BLOCK + from..];
                    contribution.w.select_positive(z, V::load(at)).store(at);
                }
            }
            if transmittance.is_over() {
                break;
            }
        }
        for (out, left) in out.iter_mut().zip(transmittance.trans.as_flattened()) {
            if *left > HALF {
                *out = f32::INFINITY;
            }
        }
    }
}
