//! Transmittance of a tile's pixels along its list. The forward and the backward pass share this walk, so that both see the same
//! contributions.
//!
//! ```text
//! alpha = min(alpha_max, opacity exp(-q / 2)),   T' = T (1 - alpha)
//! T' <= transmittance_min: the pixel ends without this contribution
//! T = T';   T <= transmittance_stop: the pixel ends after this contribution
//! ```
//!
//! Source: Kerbl et al., "3D Gaussian splatting", 2023, section 6 and appendix C.

use float_core::{Vector, vecmath};

use super::{PIXELS, Tile};
use crate::tiles::TILE;

/// Centres of a row's pixels, relative to the tile's corner.
const CENTRES: [f32; TILE] = {
    let mut x = [0.5; TILE];
    let mut i = 0;
    while i < TILE {
        x[i] = i as f32 + 0.5;
        i += 1;
    }
    x
};

/// A projected Gaussian in the coordinates of a tile.
pub(super) struct TileGaussian<V, const K: usize> {
    uv: [f32; 2],
    pub(super) conic: [f32; 3],
    pub(super) opacity: f32,
    q_max: f32,
    pub(super) feature: [V; K],
    /// Rows of the tile that it can touch.
    pub(super) rows: core::ops::Range<usize>,
}

impl<V: Vector, const K: usize> TileGaussian<V, K> {
    #[inline(always)]
    pub(super) fn new(tile: &Tile<'_, K>, entry: u32) -> Self {
        let f = &tile.gaussians[entry as usize];
        let mut feature = [V::splat(0.0); K];
        for (lanes, &x) in feature.iter_mut().zip(&tile.features[entry as usize]) {
            *lanes = V::splat(x);
        }
        let uv = [f.uv[0] - tile.corner[0], f.uv[1] - tile.corner[1]];
        // Saturating casts. One row too many does no harm: each pixel is tested.
        let first = (uv[1] - f.half[1] - 0.5).max(0.0) as usize;
        let last = (uv[1] + f.half[1] + 0.5).max(0.0) as usize;
        let rows = first.min(tile.rows)..last.min(tile.rows);
        Self { uv, conic: f.conic, opacity: f.opacity, q_max: f.q_max, feature, rows }
    }

    /// Vertical distance of the centre from the pixel centres of row `y`.
    #[inline(always)]
    pub(super) fn dy(&self, y: usize) -> f32 {
        self.uv[1] - CENTRES[y]
    }
}

/// Contribution of a Gaussian to one vector of pixels.
pub(super) struct Contribution<V> {
    /// Horizontal distance of the centre from the pixels.
    pub(super) dx: V,
    /// `opacity exp(-q / 2)`.
    pub(super) unclamped: V,
    /// The same clamped to `alpha_max`; 0 outside.
    pub(super) alpha: V,
    /// Transmittance in front of it.
    pub(super) t: V,
    /// Weight `alpha t`; 0 where it does not contribute.
    pub(super) w: V,
    /// Above 0 where `q < q_max` and the pixel has not ended.
    pub(super) inside: V,
    /// Above 0 where the transmittance behind it stays above `transmittance_min`.
    pub(super) keep: V,
}

/// Transmittance of all pixels of a tile.
pub(super) struct Transmittance<V> {
    alpha_max: V,
    transmittance_min: V,
    transmittance_stop: V,
    pub(super) trans: [f32; PIXELS],
    /// Upper bound on `q` of contributions: infinite, and negative once the pixel has ended.
    limit: [f32; PIXELS],
    /// One bit per row: set while the row has pixels that have not ended.
    live: u32,
    /// Whether a pixel of the current row has ended.
    ended: bool,
}

impl<V: Vector> Transmittance<V> {
    #[inline(always)]
    pub(super) fn new<const K: usize>(tile: &Tile<'_, K>) -> Self {
        let settings = tile.settings;
        Self {
            alpha_max: V::splat(settings.alpha_max),
            transmittance_min: V::splat(settings.transmittance_min),
            transmittance_stop: V::splat(settings.transmittance_stop),
            trans: [1.0; PIXELS],
            limit: [f32::INFINITY; PIXELS],
            live: (1 << tile.rows) - 1,
            ended: false,
        }
    }

    /// Whether row `y` has pixels that have not ended.
    #[inline(always)]
    pub(super) fn is_live(&self, y: usize) -> bool {
        self.live >> y & 1 != 0
    }

    /// Whether all pixels have ended.
    #[inline(always)]
    pub(super) fn is_over(&self) -> bool {
        self.live == 0
    }

    /// Composite a Gaussian over the pixels of row `y` from column `x` on. `None` if it contributes to none of them.
    #[inline(always)]
    pub(super) fn composite<const K: usize>(
        &mut self,
        gaussian: &TileGaussian<V, K>,
        y: usize,
        x: usize,
    ) -> Option<Contribution<V>> {
        let (zero, at) = (V::splat(0.0), y * TILE + x);
        let ([a, b, c], dy) = (gaussian.conic, gaussian.dy(y));
        let (linear, constant) = (V::splat(2.0 * b * dy), V::splat(c * dy * dy));
        let dx = V::splat(gaussian.uv[0]) - V::load(&CENTRES[x..]);
        let q = dx.mul_add(V::splat(a).mul_add(dx, linear), constant).max(zero);
        let inside = V::splat(gaussian.q_max).min(V::load(&self.limit[at..])) - q;
        if none_positive(inside) {
            return None;
        }
        let unclamped = V::splat(gaussian.opacity) * vecmath::exp(V::splat(-0.5) * q);
        let alpha = inside.select_positive(unclamped.min(self.alpha_max), zero);
        let t = V::load(&self.trans[at..]);
        let w = alpha * t;
        let next = t - w;
        let keep = next - self.transmittance_min;
        let w = keep.select_positive(w, zero);
        keep.select_positive(next, t).store(&mut self.trans[at..]);
        // Pixels that had ended before are outside: they do not end again.
        let open = inside.select_positive(keep.min(next - self.transmittance_stop), V::splat(1.0));
        if !all_positive(open) {
            open.select_positive(V::load(&self.limit[at..]), V::splat(-1.0)).store(&mut self.limit[at..]);
            self.ended = true;
        }
        Some(Contribution { dx, unclamped, alpha, t, w, inside, keep })
    }

    /// Call at the end of row `y`.
    #[inline(always)]
    pub(super) fn end_row(&mut self, y: usize) {
        if self.ended {
            self.ended = false;
            if self.limit[y * TILE..][..TILE].iter().all(|&l| l < 0.0) {
                self.live &= !(1 << y);
            }
        }
    }

    /// The gradient `h` with respect to `q` where it is not 0: where the Gaussian contributed with an alpha that was not clamped.
    #[inline(always)]
    pub(super) fn passes(&self, contribution: &Contribution<V>, h: V) -> V {
        let zero = V::splat(0.0);
        let h = contribution.inside.select_positive(contribution.keep.select_positive(h, zero), zero);
        (self.alpha_max - contribution.unclamped).select_positive(h, zero)
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
