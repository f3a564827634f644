//! One tile front to back: each ellipse over the light that is left, `C += alpha T c`.

use float_core::{Task, Vector};

use super::light::{Light, Over};
use super::{PIXELS, Tile};
use crate::tiles::TILE;

/// Composites a tile. `out` `[K + 1][PIXELS]`: features, then what is left of the light.
pub(super) struct Forward<'a, const K: usize> {
    pub(super) tile: Tile<'a, K>,
    pub(super) out: &'a mut [f32],
}

impl<const K: usize> Task for Forward<'_, K> {
    /// How many of the tile's ellipses were looked at before all its pixels were finished.
    type Output = u32;

    #[inline(always)]
    fn run<V: Vector>(self) -> u32 {
        let Self { tile, out } = self;
        let (value, trans) = out.split_at_mut(K * PIXELS);
        value.fill(0.0);
        let mut light = Light::<V>::new(&tile);
        let mut looked = 0;
        for &entry in tile.entries {
            let over = Over::<V, K>::new(&tile, entry);
            for y in over.rows.clone() {
                if !light.is_live(y) {
                    continue;
                }
                for x in (0..TILE).step_by(V::LANES) {
                    let Some(taken) = light.take(&over, y, x) else { continue };
                    for (k, &feature) in over.feature.iter().enumerate() {
                        let sum = &mut value[k * PIXELS + y * TILE + x..];
                        taken.w.mul_add(feature, V::load(sum)).store(sum);
                    }
                }
                light.end_row(y);
            }
            looked += 1;
            if light.is_over() {
                break;
            }
        }
        trans.copy_from_slice(&light.trans);
        looked
    }
}
