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

use super::Tile;
use super::blocks::{BLOCK, CENTRES, Pixels, in_picture};
use crate::tiles::TILE;

/// `exp(-q / 2) = 2^(HALF_LOG2_E q)`.
const HALF_LOG2_E: f32 = -0.5 * core::f32::consts::LOG2_E;

/// A projected Gaussian in the coordinates of a tile.
pub(super) struct TileGaussian<V, const K: usize> {
    uv: [f32; 2],
    pub(super) conic: [f32; 3],
    pub(super) opacity: f32,
    q_max: f32,
    pub(super) feature: [V; K],
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
        Self { uv, conic: f.conic, opacity: f.opacity, q_max: f.q_max, feature }
    }
}

/// Contribution of a Gaussian to one vector of pixels.
pub(super) struct Contribution<V> {
    /// Distance of the centre from the pixels along each axis.
    pub(super) dx: V,
    pub(super) dy: V,
    /// `opacity exp(-q / 2)`.
    pub(super) unclamped: V,
    /// The same clamped to `alpha_max`; 0 outside.
    pub(super) alpha: V,
    /// Transmittance in front of it.
    pub(super) t: V,
    /// Weight `alpha t`; 0 where it does not contribute.
    pub(super) w: V,
}

/// Transmittance of all pixels of a tile.
pub(super) struct Transmittance<V> {
    alpha_max: V,
    transmittance_min: V,
    transmittance_stop: V,
    pub(super) trans: Pixels,
    /// Upper bound on `q` of contributions: infinite, and negative once the pixel has ended.
    limit: Pixels,
    /// One bit per block: set while it has pixels that have not ended.
    live: u32,
}

impl<V: Vector> Transmittance<V> {
    #[inline(always)]
    pub(super) fn new<const K: usize>(tile: &Tile<'_, K>) -> Self {
        let settings = tile.settings;
        let mut limit = [[f32::INFINITY; BLOCK]; BLOCK];
        // Pixels beyond the picture have ended: nothing waits for them.
        if tile.size.iter().any(|&n| n < TILE) {
            for (axis, centres) in CENTRES.iter().enumerate() {
                for (limit, centre) in limit.iter_mut().flatten().zip(centres.iter().flatten()) {
                    if *centre > tile.size[axis] as f32 {
                        *limit = -1.0;
                    }
                }
            }
        }
        Self {
            alpha_max: V::splat(settings.alpha_max),
            transmittance_min: V::splat(settings.transmittance_min),
            transmittance_stop: V::splat(settings.transmittance_stop),
            trans: [[1.0; BLOCK]; BLOCK],
            limit,
            live: in_picture(tile),
        }
    }

    /// Those of `blocks` that have pixels that have not ended.
    #[inline(always)]
    pub(super) fn live(&self, blocks: u32) -> u32 {
        self.live & blocks
    }

    /// Whether all pixels have ended.
    #[inline(always)]
    pub(super) fn is_over(&self) -> bool {
        self.live == 0
    }

    /// Composite a Gaussian over the pixels of block `block` from `from` on. `None` if it contributes to none of them.
    #[inline(always)]
    pub(super) fn composite<const K: usize>(
        &mut self,
        gaussian: &TileGaussian<V, K>,
        block: usize,
        from: usize,
    ) -> Option<Contribution<V>> {
        let zero = V::splat(0.0);
        let [a, b, c] = gaussian.conic;
        let dx = V::splat(gaussian.uv[0]) - V::load(&CENTRES[0][block][from..]);
        let dy = V::splat(gaussian.uv[1]) - V::load(&CENTRES[1][block][from..]);
        let linear = V::splat(2.0 * b) * dy;
        let q = dx.mul_add(V::splat(a).mul_add(dx, linear), V::splat(c) * dy * dy).max(zero);
        let (trans, limit) = (&mut self.trans[block][from..], &mut self.limit[block][from..]);
        let inside = V::splat(gaussian.q_max).min(V::load(limit)) - q;
        if inside.positive() == 0 {
            return None;
        }
        let unclamped = V::splat(gaussian.opacity) * vecmath::exp2(V::splat(HALF_LOG2_E) * q);
        let alpha = inside.select_positive(unclamped.min(self.alpha_max), zero);
        let t = V::load(trans);
        let w = alpha * t;
        let next = t - w;
        let keep = next - self.transmittance_min;
        let w = keep.select_positive(w, zero);
        // The same as `next` or `t`, in one store of all lanes.
        (t - w).store(trans);
        // Pixels that had ended before are outside: they do not end again.
        let open = inside.select_positive(keep.min(next - self.transmittance_stop), V::splat(1.0));
        if open.positive() != (1 << V::LANES) - 1 {
            open.select_positive(V::load(limit), V::splat(-1.0)).store(limit);
            if self.limit[block].iter().all(|&l| l < 0.0) {
                self.live &= !(1 << block);
            }
        }
        Some(Contribution { dx, dy, unclamped, alpha, t, w })
    }

    /// The gradient `h` with respect to `q` where it is not 0: where the Gaussian contributed with an alpha that was not clamped.
    #[inline(always)]
    pub(super) fn passes(&self, contribution: &Contribution<V>, h: V) -> V {
        let zero = V::splat(0.0);
        let h = contribution.w.select_positive(h, zero);
        (self.alpha_max - contribution.unclamped).select_positive(h, zero)
    }
}
