//! The ellipse at which a pixel's light falls to a half: a surface has one depth there, where a mean lies between surfaces.

use float_core::{Task, Vector};

use super::Tile;
use super::light::{Light, Over};
use crate::tiles::TILE;

/// Light that is left at the middle.
pub(super) const HALF: f32 = 0.5;

/// Walks a tile whose rules end a pixel at [`HALF`]. `out` `[TILE][TILE]`: depth of the last ellipse that a pixel took, infinite where
/// more light than that is left.
pub(super) struct Middle<'a, const K: usize> {
    pub(super) tile: Tile<'a, K>,
    pub(super) out: &'a mut [f32],
}

impl<const K: usize> Task for Middle<'_, K> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { tile, out } = self;
        let mut light = Light::<V>::new(&tile);
        for &entry in tile.entries {
            let over = Over::<V, K>::new(&tile, entry);
            let z = V::splat(tile.footprints[entry as usize].z);
            for y in over.rows.clone() {
                if !light.is_live(y) {
                    continue;
                }
                for x in (0..TILE).step_by(V::LANES) {
                    let Some(taken) = light.take(&over, y, x) else { continue };
                    let at = &mut out[y * TILE + x..];
                    taken.w.select_positive(z, V::load(at)).store(at);
                }
                light.end_row(y);
            }
            if light.is_over() {
                break;
            }
        }
        for (out, left) in out.iter_mut().zip(&light.trans) {
            if *left > HALF {
                *out = f32::INFINITY;
            }
        }
    }
}
