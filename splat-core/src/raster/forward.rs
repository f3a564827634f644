//! One tile front to back: each ellipse over the light that is left.
//!
//! ```text
//! alpha = min(alpha_max, opacity exp(-q / 2)),   T' = T (1 - alpha)
//! T' <= stop: the pixel is finished, and this contribution is not in it
//! C += alpha T c,   T = T'
//! T <= enough: the pixel is finished, what is behind is worth no more
//! ```
//!
//! Source: Kerbl et al., "3D Gaussian splatting", 2023, section 6 and appendix C.

use float_core::{Task, Vector, vecmath};

use super::lanes::{all_positive, none_positive};
use super::{PIXELS, Tile};
use crate::tiles::TILE;

/// Centres of a row's pixels, from the tile's corner.
pub(super) const CENTRES: [f32; TILE] = {
    let mut x = [0.5; TILE];
    let mut i = 0;
    while i < TILE {
        x[i] = i as f32 + 0.5;
        i += 1;
    }
    x
};

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
        let rules = tile.rules;
        let (zero, alpha_max) = (V::splat(0.0), V::splat(rules.alpha_max));
        let (stop, enough) = (V::splat(rules.stop), V::splat(rules.enough));
        let (value, trans) = out.split_at_mut(K * PIXELS);
        let trans = &mut trans[..PIXELS];
        value.fill(0.0);
        trans.fill(1.0);
        // Squared radius up to which a pixel still takes contributions: none once it is finished.
        let mut limit = [f32::INFINITY; PIXELS];
        let mut live = (1_u32 << tile.rows) - 1;
        for (looked, &entry) in tile.entries.iter().enumerate() {
            let f = &tile.footprints[entry as usize];
            let mut feature = [zero; K];
            for (lanes, &x) in feature.iter_mut().zip(&tile.features[entry as usize]) {
                *lanes = V::splat(x);
            }
            let (u, v) = (f.uv[0] - tile.corner[0], f.uv[1] - tile.corner[1]);
            let [a, b, c] = f.conic;
            let (first, last) = tile.rows_of(v, f.half[1]);
            for y in first..last {
                if live >> y & 1 == 0 {
                    continue;
                }
                let dy = v - CENTRES[y];
                let (linear, constant) = (V::splat(2.0 * b * dy), V::splat(c * dy * dy));
                let mut finished = false;
                for x in (0..TILE).step_by(V::LANES) {
                    let at = y * TILE + x;
                    let dx = V::splat(u) - V::load(&CENTRES[x..]);
                    let q = dx.mul_add(V::splat(a).mul_add(dx, linear), constant).max(zero);
                    let inside = V::splat(f.q_max).min(V::load(&limit[at..])) - q;
                    if none_positive(inside) {
                        continue;
                    }
                    let alpha = (V::splat(f.opacity) * vecmath::exp(V::splat(-0.5) * q)).min(alpha_max);
                    let alpha = inside.select_positive(alpha, zero);
                    let t = V::load(&trans[at..]);
                    let w = alpha * t;
                    let next = t - w;
                    let keep = next - stop;
                    let w = keep.select_positive(w, zero);
                    for (k, &feature) in feature.iter().enumerate() {
                        let sum = &mut value[k * PIXELS + at..];
                        w.mul_add(feature, V::load(sum)).store(sum);
                    }
                    keep.select_positive(next, t).store(&mut trans[at..]);
                    let open = keep.min(next - enough);
                    if !all_positive(open) {
                        open.select_positive(V::load(&limit[at..]), V::splat(-1.0)).store(&mut limit[at..]);
                        finished = true;
                    }
                }
                if finished && limit[y * TILE..][..TILE].iter().all(|&l| l < 0.0) {
                    live &= !(1 << y);
                }
            }
            if live == 0 {
                return looked as u32 + 1;
            }
        }
        tile.entries.len() as u32
    }
}
