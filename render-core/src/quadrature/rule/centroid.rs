//! Where in an interval of linear density its light comes from.
//!
//! On an interval `[0, 1]` with optical density `a + (b - a) u`, so that `tau = (a + b) / 2`,
//!
//! ```text
//! mu(a, b) = int(u p(u), 0..1) / int(p(u), 0..1)      p(u) = (a + (b - a) u) exp(-a u - (b - a) u^2 / 2)
//! ```
//!
//! is the mean position of absorption, in `[0, 1]`. The integral below is `1 - exp(-tau)`; the one above has a closed form,
//! with `erfcx` for `b > a` and Dawson's function for `b < a`. It is not used: it takes the difference of two numbers that
//! agree in all digits when `tau` is small, divides by `b - a`, and its gradient divides by it again (the tests measure
//! what is left of it in `f32`: nothing below `tau = 1e-3`). Both integrands are positive and entire, so [`NODES`] Gauss
//! points on the part of the interval that light reaches give `mu` to `4e-7` for every `a` and `b`, and its gradient from the
//! same exponentials.

use float_core::{Vector, vecmath};

/// Gauss-Legendre nodes and weights on `[0, 1]`.
pub(in crate::quadrature) const NODES: [(f64, f64); 12] = [
    (0.009_219_682_876_640_38, 0.023_587_668_193_255_92),
    (0.047_941_371_814_762_6, 0.053_469_662_997_659_09),
    (0.115_048_662_902_847_65, 0.080_039_164_271_673_17),
    (0.206_341_022_856_691_26, 0.101_583_713_361_532_92),
    (0.316_084_250_500_909_94, 0.116_746_268_269_177_39),
    (0.437_383_295_744_265_54, 0.124_573_522_906_701_44),
    (0.562_616_704_255_734_4, 0.124_573_522_906_701_44),
    (0.683_915_749_499_090_1, 0.116_746_268_269_177_39),
    (0.793_658_977_143_308_7, 0.101_583_713_361_532_92),
    (0.884_951_337_097_152_3, 0.080_039_164_271_673_17),
    (0.952_058_628_185_237_5, 0.053_469_662_997_659_09),
    (0.990_780_317_123_359_6, 0.023_587_668_193_255_92),
];

/// Optical depth behind which an interval is not integrated: a share of `exp(-15) = 3e-7` of its light. Deeper, the Gauss
/// points would be too far apart; less deep, the cut would show.
const REACH: f32 = 15.0;

/// Below this optical depth an interval counts as empty: `mu = 1/2` and no gradient. Its inverse is still a number.
pub(super) const EMPTY: f32 = 1e-30;

/// Above this one nothing changes any more; squares stay finite.
pub(super) const DENSEST: f32 = 1e30;

/// An interval, scaled: `p(u) ~ (r + 2 g u) exp(-tau u (r + g u))`.
struct Shape<V> {
    tau: V,
    /// `1 / tau`
    inv: V,
    /// `a / tau`, in `[0, 2]`.
    r: V,
    /// `(b - a) / (2 tau)`, in `[-1, 1]`.
    g: V,
    /// The part of the interval with the optical depth [`REACH`], at most 1.
    reach: V,
}

impl<V: Vector> Shape<V> {
    #[inline(always)]
    fn new(a: V, tau: V) -> Self {
        let one = V::splat(1.0);
        let live = tau - V::splat(EMPTY);
        let inv = one / tau.max(V::splat(EMPTY));
        let r = live.select_positive((a * inv).min(V::splat(2.0)), one);
        let g = one - r;
        // Root of r u + g u^2 = s in the form that does not cancel.
        let s = (V::splat(REACH) * inv).min(one);
        let root = (r * r + V::splat(4.0) * g * s).max(V::splat(0.0)).sqrt();
        let reach = ((s + s) / (r + root)).min(one);
        Self { tau, inv, r, g, reach }
    }

    /// Position `u`, weight without and with the density, of one node.
    #[inline(always)]
    fn node(&self, x: f64, weight: f64) -> (V, V, V) {
        let u = self.reach * V::splat(x as f32);
        let gu = self.g * u;
        let e = V::splat(weight as f32) * vecmath::exp(-(self.tau * u * (self.r + gu)));
        (u, e, e * (self.r + (gu + gu)))
    }
}

/// `mu(a, b)` with `tau = (a + b) / 2`, all at most [`DENSEST`].
#[inline(always)]
pub(super) fn centroid<V: Vector>(a: V, tau: V) -> V {
    let shape = Shape::new(a, tau);
    let (mut p0, mut p1) = (V::splat(0.0), V::splat(0.0));
    for (x, weight) in NODES {
        let (u, _, p) = shape.node(x, weight);
        p0 = p0 + p;
        p1 = p.mul_add(u, p1);
    }
    (tau - V::splat(EMPTY)).select_positive(p1 / p0, V::splat(0.5))
}

/// The derivatives of `mu` by `a` and by `b`.
///
/// With `E` the mean under `p`: `mu_a = E[(u - mu) (1 - u) / (a + (b - a) u)] - Cov(u, u - u^2 / 2)`, and
/// `mu_b = E[(u - mu) u / (a + (b - a) u)] - Cov(u, u^2 / 2)`. The density under the fraction cancels against the one in
/// `p`: nothing divides by it.
#[inline(always)]
pub(super) fn centroid_gradient<V: Vector>(a: V, tau: V) -> (V, V) {
    let shape = Shape::new(a, tau);
    let zero = V::splat(0.0);
    let (mut e0, mut e1, mut e2) = (zero, zero, zero);
    let (mut p0, mut p1, mut p2, mut p3) = (zero, zero, zero, zero);
    for (x, weight) in NODES {
        let (u, e, p) = shape.node(x, weight);
        let (eu, pu) = (e * u, p * u);
        e0 = e0 + e;
        e1 = e1 + eu;
        e2 = eu.mul_add(u, e2);
        p0 = p0 + p;
        p1 = p1 + pu;
        p2 = pu.mul_add(u, p2);
        p3 = (pu * u).mul_add(u, p3);
    }
    let inv = V::splat(1.0) / p0;
    let mu = p1 * inv;
    let half = V::splat(0.5);
    let cov_u = p2 * inv - mu * mu;
    let half_cov_uu = half * (p3 * inv - mu * p2 * inv);
    let scale = inv * shape.inv;
    let mu_a = ((e1 - e2) - mu * (e0 - e1)) * scale - (cov_u - half_cov_uu);
    let mu_b = (e2 - mu * e1) * scale - half_cov_uu;
    let live = tau - V::splat(EMPTY);
    (live.select_positive(mu_a, zero), live.select_positive(mu_b, zero))
}
