//! One tile front to back again: what each ellipse's numbers are worth to the loss.
//!
//! With `g_i = <C_bar, c_i>` and `R = <C_bar, C> + T_bar T_end` (one number a pixel: the features' own sums are not needed),
//!
//! ```text
//! alpha_bar_i = T_i g_i - (R - sum_{j <= i} w_j g_j) / (1 - alpha_i)
//! ```
//!
//! so that nothing is divided out of the light that is left, and the walk ends where the forward one did.

use float_core::{Task, Vector};

use super::light::{Light, Over};
use super::{PIXELS, Record, Tile};
use crate::tiles::TILE;

/// Walks a tile's list again. `value_bar` `[K + 1][PIXELS]`: gradient with respect to features and to what is left of the light;
/// `out` as the forward pass left it; `records`: a sum over the tile's pixels for each ellipse of the list.
pub(super) struct Backward<'a, const K: usize> {
    pub(super) tile: Tile<'a, K>,
    pub(super) out: &'a [f32],
    pub(super) value_bar: &'a [f32],
    pub(super) looked: u32,
    pub(super) records: &'a mut [Record<K>],
}

impl<const K: usize> Task for Backward<'_, K> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { tile, out, value_bar, looked, records } = self;
        let (zero, one) = (V::splat(0.0), V::splat(1.0));
        let mut light = Light::<V>::new(&tile);
        let mut rest = [0.0_f32; PIXELS];
        for k in 0..=K {
            for (rest, (bar, out)) in rest.iter_mut().zip(value_bar[k * PIXELS..].iter().zip(&out[k * PIXELS..])) {
                *rest += bar * out;
            }
        }
        records.fill(Record::default());
        for (&entry, record) in tile.entries[..looked as usize].iter().zip(records) {
            let over = Over::<V, K>::new(&tile, entry);
            // Sums of h = q_bar times 1, dx, dy and their products.
            let mut sums = [zero; 6];
            let mut features_bar = [zero; K];
            for y in over.rows.clone() {
                if !light.is_live(y) {
                    continue;
                }
                let mut row = [zero; 3];
                for x in (0..TILE).step_by(V::LANES) {
                    let Some(taken) = light.take(&over, y, x) else { continue };
                    let at = y * TILE + x;
                    let mut worth = zero;
                    for k in 0..K {
                        let bar = V::load(&value_bar[k * PIXELS + at..]);
                        worth = bar.mul_add(over.feature[k], worth);
                        features_bar[k] = taken.w.mul_add(bar, features_bar[k]);
                    }
                    let behind = V::load(&rest[at..]) - taken.w * worth;
                    behind.store(&mut rest[at..]);
                    let alpha_bar = taken.t * worth - behind / (one - taken.alpha);
                    let h = light.passes(&taken, V::splat(-0.5) * taken.full * alpha_bar);
                    let hx = h * taken.dx;
                    row = [row[0] + h, row[1] + hx, hx.mul_add(taken.dx, row[2])];
                }
                light.end_row(y);
                let dy = V::splat(over.dy(y));
                sums[0] = sums[0] + row[0];
                sums[1] = sums[1] + row[1];
                sums[2] = dy.mul_add(row[0], sums[2]);
                sums[3] = sums[3] + row[2];
                sums[4] = dy.mul_add(row[1], sums[4]);
                sums[5] = (dy * dy).mul_add(row[0], sums[5]);
            }
            let [h, hx, hy, hxx, hxy, hyy] = sums.map(V::sum);
            let [a, b, c] = over.conic;
            *record = Record {
                uv: [2.0 * (a * hx + b * hy), 2.0 * (b * hx + c * hy)],
                conic: [hxx, 2.0 * hxy, hyy],
                opacity: if over.opacity > 0.0 { -2.0 * h / over.opacity } else { 0.0 },
                features: features_bar.map(V::sum),
            };
        }
    }
}
