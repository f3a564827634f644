//! One tile front to back again: what each ellipse's numbers are worth to the loss.
//!
//! With `g_i = <C_bar, c_i>` and `R = <C_bar, C> + T_bar T_end` (one number a pixel: the features' own sums are not needed),
//!
//! ```text
//! alpha_bar_i = T_i g_i - (R - sum_{j <= i} w_j g_j) / (1 - alpha_i)
//! ```
//!
//! so that nothing is divided out of the light that is left, and the walk ends where the forward one did.

use float_core::{Task, Vector, vecmath};

use super::forward::CENTRES;
use super::lanes::{all_positive, none_positive};
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
        let rules = tile.rules;
        let (zero, one) = (V::splat(0.0), V::splat(1.0));
        let (alpha_max, stop, enough) = (V::splat(rules.alpha_max), V::splat(rules.stop), V::splat(rules.enough));
        let mut trans = [1.0_f32; PIXELS];
        let mut limit = [f32::INFINITY; PIXELS];
        let mut rest = [0.0_f32; PIXELS];
        for k in 0..=K {
            for (rest, (bar, out)) in rest.iter_mut().zip(value_bar[k * PIXELS..].iter().zip(&out[k * PIXELS..])) {
                *rest += bar * out;
            }
        }
        records.fill(Record::default());
        let mut live = (1_u32 << tile.rows) - 1;
        for (&entry, record) in tile.entries[..looked as usize].iter().zip(records) {
            let f = &tile.footprints[entry as usize];
            let mut feature = [zero; K];
            for (lanes, &x) in feature.iter_mut().zip(&tile.features[entry as usize]) {
                *lanes = V::splat(x);
            }
            let (u, v) = (f.uv[0] - tile.corner[0], f.uv[1] - tile.corner[1]);
            let [a, b, c] = f.conic;
            let (first, last) = tile.rows_of(v, f.half[1]);
            // Sums of h = q_bar times 1, dx, dy and their products.
            let mut sums = [zero; 6];
            let mut features_bar = [zero; K];
            for y in first..last {
                if live >> y & 1 == 0 {
                    continue;
                }
                let dy = v - CENTRES[y];
                let (linear, constant) = (V::splat(2.0 * b * dy), V::splat(c * dy * dy));
                let mut finished = false;
                let mut row = [zero; 3];
                for x in (0..TILE).step_by(V::LANES) {
                    let at = y * TILE + x;
                    let dx = V::splat(u) - V::load(&CENTRES[x..]);
                    let q = dx.mul_add(V::splat(a).mul_add(dx, linear), constant).max(zero);
                    let inside = V::splat(f.q_max).min(V::load(&limit[at..])) - q;
                    if none_positive(inside) {
                        continue;
                    }
                    let full = V::splat(f.opacity) * vecmath::exp(V::splat(-0.5) * q);
                    let alpha = inside.select_positive(full.min(alpha_max), zero);
                    let t = V::load(&trans[at..]);
                    let w = alpha * t;
                    let next = t - w;
                    let keep = next - stop;
                    let w = keep.select_positive(w, zero);
                    let mut worth = zero;
                    for k in 0..K {
                        let bar = V::load(&value_bar[k * PIXELS + at..]);
                        worth = bar.mul_add(feature[k], worth);
                        features_bar[k] = w.mul_add(bar, features_bar[k]);
                    }
                    let behind = V::load(&rest[at..]) - w * worth;
                    behind.store(&mut rest[at..]);
                    keep.select_positive(next, t).store(&mut trans[at..]);
                    let open = keep.min(next - enough);
                    if !all_positive(open) {
                        open.select_positive(V::load(&limit[at..]), V::splat(-1.0)).store(&mut limit[at..]);
                        finished = true;
                    }
                    let alpha_bar = t * worth - behind / (one - alpha);
                    // q_bar; none where the pixel did not take it, nor where alpha was capped.
                    let h = V::splat(-0.5) * full * alpha_bar;
                    let h = inside.select_positive(keep.select_positive(h, zero), zero);
                    let h = (alpha_max - full).select_positive(h, zero);
                    let hx = h * dx;
                    row = [row[0] + h, row[1] + hx, hx.mul_add(dx, row[2])];
                }
                let dy = V::splat(dy);
                sums[0] = sums[0] + row[0];
                sums[1] = sums[1] + row[1];
                sums[2] = dy.mul_add(row[0], sums[2]);
                sums[3] = sums[3] + row[2];
                sums[4] = dy.mul_add(row[1], sums[4]);
                sums[5] = (dy * dy).mul_add(row[0], sums[5]);
                if finished && limit[y * TILE..][..TILE].iter().all(|&l| l < 0.0) {
                    live &= !(1 << y);
                }
            }
            let [h, hx, hy, hxx, hxy, hyy] = sums.map(V::sum);
            *record = Record {
                uv: [2.0 * (a * hx + b * hy), 2.0 * (b * hx + c * hy)],
                conic: [hxx, 2.0 * hxy, hyy],
                opacity: if f.opacity > 0.0 { -2.0 * h / f.opacity } else { 0.0 },
                features: features_bar.map(V::sum),
            };
        }
    }
}
