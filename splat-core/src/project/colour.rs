//! The colour of a Gaussian seen from somewhere, and the chain rule back.

use float_core::Vector;

use super::block::dot;
use super::rows::lanes;
use crate::gaussians::{SH_0, rest_len};
use crate::sh::{basis, slope};
use crate::{Gaussians, View};

/// Where the camera is.
pub(crate) struct Sight<V> {
    o: [V; 3],
}

/// A unit direction from the camera to a Gaussian, and one over the distance: 0 where there is none.
pub(crate) struct Direction<V> {
    pub(crate) d: [V; 3],
    inv_distance: V,
}

impl<V: Vector> Sight<V> {
    #[inline(always)]
    pub(crate) fn new(view: &View) -> Self {
        Self { o: view.centre().map(V::splat) }
    }

    #[inline(always)]
    pub(crate) fn direction(&self, mean: [V; 3]) -> Direction<V> {
        let (zero, one) = (V::splat(0.0), V::splat(1.0));
        let way: [V; 3] = each!(3, |k| mean[k] - self.o[k]);
        let squared = dot(way, way);
        let away = squared - V::splat(f32::MIN_POSITIVE);
        let inv_distance = away.select_positive(one / away.select_positive(squared, one).sqrt(), zero);
        let ahead = [zero, zero, one];
        let d = each!(3, |k| away.select_positive(way[k] * inv_distance, ahead[k]));
        Direction { d, inv_distance }
    }
}

/// `max(0, 1/2 + sum_k basis_k h_k)` of each channel; and 1, or NaN where one of them is not finite.
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
        // NaN ends as 0 here.
        sum.max(V::splat(0.0))
    });
    (rgb, finite)
}

/// Gradient of [`colour`]: that of the position, through the direction, and those of the coefficients `[16][channel]`, the constant one
/// first. `rgb_bar` is 0 where the colour was clamped.
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
    let d_bar = slope(degree, to.d, &weights);
    // Across the direction only, and less the farther away.
    let along = dot(d_bar, to.d);
    (each!(3, |k| (d_bar[k] - along * to.d[k]) * to.inv_distance), h_bar)
}
