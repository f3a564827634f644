//! View-dependent colour of a Gaussian, and its backward pass.

use float_core::Vector;

use super::block::dot;
use super::rows::lanes;
use crate::gaussians::{SH_0, rest_len};
use crate::sh::{basis, gradient};
use crate::{Gaussians, View};

/// Centre of the camera.
pub(crate) struct Viewpoint<V> {
    o: [V; 3],
}

/// Unit direction from the camera to a Gaussian, and 1 / distance. At distance 0: the z axis and 0.
pub(crate) struct Direction<V> {
    pub(crate) d: [V; 3],
    inv_distance: V,
}

impl<V: Vector> Viewpoint<V> {
    #[inline(always)]
    pub(crate) fn new(view: &View) -> Self {
        Self { o: view.centre().map(V::splat) }
    }

    #[inline(always)]
    pub(crate) fn direction(&self, mean: [V; 3]) -> Direction<V> {
        let (zero, one) = (V::splat(0.0), V::splat(1.0));
        let offset: [V; 3] = each!(3, |k| mean[k] - self.o[k]);
        let squared = dot(offset, offset);
        let away = squared - V::splat(f32::MIN_POSITIVE);
        let inv_distance = away.select_positive(one / away.select_positive(squared, one).sqrt(), zero);
        let ahead = [zero, zero, one];
        let d = each!(3, |k| away.select_positive(offset[k] * inv_distance, ahead[k]));
        Direction { d, inv_distance }
    }
}

/// Colour `max(0, 1/2 + sum_k basis_k h_k)` of each channel. The second value is 1, or NaN where a channel is not finite.
#[inline(always)]
pub(crate) fn colour<V: Vector>(cloud: &Gaussians, degree: usize, at: usize, to: &Direction<V>) -> ([V; 3], V) {
    let n = cloud.len();
    let y = basis(degree, to.d);
    let mut finite = V::splat(1.0);
    let rgb = each!(3, |c| {
        let mut sum = V::splat(SH_0).mul_add(lanes(&cloud.dc, n, c, at), V::splat(0.5));
        for (k, &y) in y[..rest_len(degree)].iter().enumerate() {
            sum = y.mul_add(lanes(&cloud.rest, n, 3 * k + c, at), sum);
        }
        finite = sum.mul_add(V::splat(0.0), finite);
        // NaN becomes 0.
        sum.max(V::splat(0.0))
    });
    (rgb, finite)
}

/// Backward pass of [`colour`]: the gradient with respect to the position (through the direction), and those with respect to the
/// coefficients `[16][channel]`, the constant one first. `rgb_bar` must be 0 where the colour was clamped.
#[inline(always)]
pub(crate) fn colour_backward<V: Vector>(
    cloud: &Gaussians,
    degree: usize,
    at: usize,
    to: &Direction<V>,
    rgb_bar: [V; 3],
) -> ([V; 3], [[V; 3]; 16]) {
    let n = cloud.len();
    let y = basis(degree, to.d);
    let mut weights = [V::splat(0.0); 15];
    let mut h_bar = [[V::splat(0.0); 3]; 16];
    for (c, &bar) in rgb_bar.iter().enumerate() {
        h_bar[0][c] = V::splat(SH_0) * bar;
        for k in 0..rest_len(degree) {
            h_bar[k + 1][c] = y[k] * bar;
            weights[k] = bar.mul_add(lanes(&cloud.rest, n, 3 * k + c, at), weights[k]);
        }
    }
    let d_bar = gradient(degree, to.d, &weights);
    // Through the normalisation of the direction.
    let along = dot(d_bar, to.d);
    (each!(3, |k| (d_bar[k] - along * to.d[k]) * to.inv_distance), h_bar)
}
