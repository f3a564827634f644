//! Backward pass of one tile, front to back: gradients with respect to its projected Gaussians.
//!
//! With `g_i = <C_bar, c_i>` and `R = <C_bar, C> + T_bar T_end` (one number per pixel: sums per feature are not needed),
//!
//! ```text
//! alpha_bar_i = T_i g_i - (R - sum_{j <= i} w_j g_j) / (1 - alpha_i)
//! ```
//!
//! so that the transmittance is never divided, and the walk ends where the forward pass ended.

use float_core::{Task, Vector};

use super::blocks::{BLOCK, EachOf};
use super::transmittance::{TileGaussian, Transmittance};
use super::{PIXELS, ProjectedGradient, Tile};

/// Walks a tile's list again. With `ABSOLUTE`, sums of absolute view-space gradients are computed, too.
pub(super) struct Backward<'a, const K: usize, const ABSOLUTE: bool> {
    pub(super) tile: Tile<'a, K>,
    /// As the forward pass left it.
    pub(super) out: &'a [f32],
    /// `[K + 1][PIXELS]` gradient with respect to features and transmittance.
    pub(super) value_bar: &'a [f32],
    /// For each Gaussian that the forward pass visited one bit for each block that it contributed to.
    pub(super) blocks: &'a [u16],
    /// Written: one for each Gaussian of the list, summed over the tile's pixels.
    pub(super) gradients: &'a mut [ProjectedGradient<K>],
    /// Written with `ABSOLUTE`, else empty: the sum over the tile's pixels of the absolute gradient with respect to the centre.
    pub(super) uv_absolute: &'a mut [[f32; 2]],
}

impl<const K: usize, const ABSOLUTE: bool> Task for Backward<'_, K, ABSOLUTE> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { tile, out, value_bar, blocks, gradients, uv_absolute } = self;
        let (zero, one) = (V::splat(0.0), V::splat(1.0));
        let mut transmittance = Transmittance::<V>::new(&tile);
        let mut rest = [0.0_f32; PIXELS];
        for k in 0..=K {
            for (rest, (bar, out)) in rest.iter_mut().zip(value_bar[k * PIXELS..].iter().zip(&out[k * PIXELS..])) {
                *rest += bar * out;
            }
        }
        gradients.fill(ProjectedGradient::default());
        if ABSOLUTE {
            uv_absolute.fill([0.0; 2]);
        }
        for (i, (&entry, gradient)) in tile.entries.iter().zip(gradients).enumerate().take(blocks.len()) {
            if blocks[i] == 0 {
                continue;
            }
            let gaussian = TileGaussian::<V, K>::new(&tile, entry);
            let [a, b, c] = gaussian.conic;
            // Sums of h = q_bar times 1, dx, dy and their products.
            let mut sums = [zero; 6];
            let mut features_bar = [zero; K];
            let mut absolute = [zero; 2];
            for block in EachOf(blocks[i].into()) {
                for from in (0..BLOCK).step_by(V::LANES) {
                    let Some(contribution) = transmittance.composite(&gaussian, block, from) else { continue };
                    let at = block * BLOCK + from;
                    let mut worth = zero;
                    for k in 0..K {
                        let bar = V::load(&value_bar[k * PIXELS + at..]);
                        worth = bar.mul_add(gaussian.feature[k], worth);
                        features_bar[k] = contribution.w.mul_add(bar, features_bar[k]);
                    }
                    let behind = V::load(&rest[at..]) - contribution.w * worth;
                    behind.store(&mut rest[at..]);
                    let alpha_bar = contribution.t * worth - behind / (one - contribution.alpha);
                    let h = transmittance.passes(&contribution, V::splat(-0.5) * contribution.unclamped * alpha_bar);
                    let (dx, dy) = (contribution.dx, contribution.dy);
                    let (hx, hy) = (h * dx, h * dy);
                    sums[0] = sums[0] + h;
                    sums[1] = sums[1] + hx;
                    sums[2] = sums[2] + hy;
                    sums[3] = hx.mul_add(dx, sums[3]);
                    sums[4] = hx.mul_add(dy, sums[4]);
                    sums[5] = hy.mul_add(dy, sums[5]);
                    if ABSOLUTE {
                        let u = V::splat(a).mul_add(hx, V::splat(b) * hy);
                        let v = V::splat(b).mul_add(hx, V::splat(c) * hy);
                        absolute = [absolute[0] + u.max(-u), absolute[1] + v.max(-v)];
                    }
                }
            }
            let [h, hx, hy, hxx, hxy, hyy] = sums.map(V::sum);
            *gradient = ProjectedGradient {
                uv: [2.0 * (a * hx + b * hy), 2.0 * (b * hx + c * hy)],
                conic: [hxx, 2.0 * hxy, hyy],
                opacity: if gaussian.opacity > 0.0 { -2.0 * h / gaussian.opacity } else { 0.0 },
                features: features_bar.map(V::sum),
            };
            if ABSOLUTE {
                uv_absolute[i] = absolute.map(|sum| 2.0 * sum.sum());
            }
        }
    }
}
