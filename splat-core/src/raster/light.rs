//! The light that is left of a tile's pixels while its list is walked: one walk for both ways, so that the backward pass meets the
//! contributions of the forward pass and no others.
//!
//! ```text
//! alpha = min(alpha_max, opacity exp(-q / 2)),   T' = T (1 - alpha)
//! T' <= stop: the pixel is finished, and this contribution is not in it
//! T = T';   T <= enough: the pixel is finished, what is behind is worth no more
//! ```
//!
//! Source: Kerbl et al., "3D Gaussian splatting", 2023, section 6 and appendix C.

use float_core::{Vector, vecmath};

use super::{PIXELS, Tile};
use crate::tiles::TILE;

/// Centres of a row's pixels, from the tile's corner.
const CENTRES: [f32; TILE] = {
    let mut x = [0.5; TILE];
    let mut i = 0;
    while i < TILE {
        x[i] = i as f32 + 0.5;
        i += 1;
    }
    x
};

/// An ellipse in the coordinates of a tile.
pub(super) struct Over<V, const K: usize> {
    uv: [f32; 2],
    pub(super) conic: [f32; 3],
    pub(super) opacity: f32,
    q_max: f32,
    pub(super) feature: [V; K],
    /// Rows of the tile that it may touch.
    pub(super) rows: core::ops::Range<usize>,
}

impl<V: Vector, const K: usize> Over<V, K> {
    #[inline(always)]
    pub(super) fn new(tile: &Tile<'_, K>, entry: u32) -> Self {
        let f = &tile.footprints[entry as usize];
        let mut feature = [V::splat(0.0); K];
        for (lanes, &x) in feature.iter_mut().zip(&tile.features[entry as usize]) {
            *lanes = V::splat(x);
        }
        let uv = [f.uv[0] - tile.corner[0], f.uv[1] - tile.corner[1]];
        // Saturating casts; a row too many is found to be outside pixel by pixel.
        let first = (uv[1] - f.half[1] - 0.5).max(0.0) as usize;
        let last = (uv[1] + f.half[1] + 0.5).max(0.0) as usize;
        let rows = first.min(tile.rows)..last.min(tile.rows);
        Self { uv, conic: f.conic, opacity: f.opacity, q_max: f.q_max, feature, rows }
    }

    /// How far the centre is from row `y`.
    #[inline(always)]
    pub(super) fn dy(&self, y: usize) -> f32 {
        self.uv[1] - CENTRES[y]
    }
}

/// What a vector of pixels takes of an ellipse.
pub(super) struct Taken<V> {
    /// How far the centre is, along the row.
    pub(super) dx: V,
    /// Opacity there before its cap, and after: 0 outside.
    pub(super) full: V,
    pub(super) alpha: V,
    /// Light before.
    pub(super) t: V,
    /// Light that it takes: 0 where it is not taken.
    pub(super) w: V,
    /// Above 0 inside of the ellipse, and where a pixel takes it.
    pub(super) inside: V,
    pub(super) keep: V,
}

/// The light of all pixels.
pub(super) struct Light<V> {
    alpha_max: V,
    stop: V,
    enough: V,
    pub(super) trans: [f32; PIXELS],
    /// Squared radius up to which a pixel still takes contributions: none once it is finished.
    limit: [f32; PIXELS],
    /// Rows with pixels that are not finished, a bit each.
    live: u32,
    /// A pixel of the row was finished.
    finished: bool,
}

impl<V: Vector> Light<V> {
    #[inline(always)]
    pub(super) fn new<const K: usize>(tile: &Tile<'_, K>) -> Self {
        let rules = tile.rules;
        Self {
            alpha_max: V::splat(rules.alpha_max),
            stop: V::splat(rules.stop),
            enough: V::splat(rules.enough),
            trans: [1.0; PIXELS],
            limit: [f32::INFINITY; PIXELS],
            live: (1 << tile.rows) - 1,
            finished: false,
        }
    }

    /// Whether a row has pixels that are not finished.
    #[inline(always)]
    pub(super) fn is_live(&self, y: usize) -> bool {
        self.live >> y & 1 != 0
    }

    /// Whether all pixels are finished.
    #[inline(always)]
    pub(super) fn is_over(&self) -> bool {
        self.live == 0
    }

    /// The pixels of row `y` from column `x` on take what an ellipse gives them; `None` where all of them are outside, or finished.
    #[inline(always)]
    pub(super) fn take<const K: usize>(&mut self, over: &Over<V, K>, y: usize, x: usize) -> Option<Taken<V>> {
        let (zero, at) = (V::splat(0.0), y * TILE + x);
        let ([a, b, c], dy) = (over.conic, over.dy(y));
        let (linear, constant) = (V::splat(2.0 * b * dy), V::splat(c * dy * dy));
        let dx = V::splat(over.uv[0]) - V::load(&CENTRES[x..]);
        let q = dx.mul_add(V::splat(a).mul_add(dx, linear), constant).max(zero);
        let inside = V::splat(over.q_max).min(V::load(&self.limit[at..])) - q;
        if none_positive(inside) {
            return None;
        }
        let full = V::splat(over.opacity) * vecmath::exp(V::splat(-0.5) * q);
        let alpha = inside.select_positive(full.min(self.alpha_max), zero);
        let t = V::load(&self.trans[at..]);
        let w = alpha * t;
        let next = t - w;
        let keep = next - self.stop;
        let w = keep.select_positive(w, zero);
        keep.select_positive(next, t).store(&mut self.trans[at..]);
        // Pixels that were finished before take nothing, and are not finished again.
        let open = inside.select_positive(keep.min(next - self.enough), V::splat(1.0));
        if !all_positive(open) {
            open.select_positive(V::load(&self.limit[at..]), V::splat(-1.0)).store(&mut self.limit[at..]);
            self.finished = true;
        }
        Some(Taken { dx, full, alpha, t, w, inside, keep })
    }

    /// A row was walked through.
    #[inline(always)]
    pub(super) fn end_row(&mut self, y: usize) {
        if self.finished {
            self.finished = false;
            if self.limit[y * TILE..][..TILE].iter().all(|&l| l < 0.0) {
                self.live &= !(1 << y);
            }
        }
    }

    /// Where the gradient of `q` is one: pixels that took the contribution, with an opacity that was not capped.
    #[inline(always)]
    pub(super) fn passes(&self, taken: &Taken<V>, h: V) -> V {
        let zero = V::splat(0.0);
        let h = taken.inside.select_positive(taken.keep.select_positive(h, zero), zero);
        (self.alpha_max - taken.full).select_positive(h, zero)
    }
}

/// Whether no lane is above 0.
#[inline(always)]
fn none_positive<V: Vector>(x: V) -> bool {
    // The smallest number above 0.
    x.all_below(V::splat(f32::from_bits(1)))
}

/// Whether every lane is above 0.
#[inline(always)]
fn all_positive<V: Vector>(x: V) -> bool {
    (-x).all_below(V::splat(0.0))
}
