//! Samples distributed as the light of a ray whose density is linear between nodes.

use float_core::m64;

/// Optical densities above this one count as it: its square is a number.
const DENSEST: f64 = 1e150;

/// Samples distributed as the weight of a ray under piecewise-linear density: `samples[i]` is where the accumulated opacity
/// reaches the share `u[i]` of what it is at the last node.
///
/// [`invert_cdf`](super::invert_cdf) spreads the weight of a bin evenly over it; here the density is followed inside as well: with
/// the transmittance `T(t) = exp(-quadratic)` between nodes, the sample solves `1 - T(t) = u (1 - T_end)` exactly, in the form
/// `2 d / (a + sqrt(a^2 + 2 (b - a) d))` of the quadratic's root, which cancels for no `a` and `b`. A ray without density gives
/// every interval the same number of samples. `u = 1` gives the last point with density, or the last node where it is beyond
/// counting. `u` need not be sorted; if it is, so are the samples.
///
/// # Shapes and units
/// * `t`     `[n]` nodes, non-decreasing, world units
/// * `sigma` `[n]` density at the nodes, 1 / world unit, `>= 0`; `inf` is opaque
/// * `depth` `[n]` out: optical depth in front of each node
/// * `u`, `samples` `[m]`; fewer than two nodes give no samples: then `m` must be 0
///
/// # Panics
/// When the lengths disagree.
///
/// # Source
/// Uy et al., "NeRF Revisited: Fixing Quadrature Instability in Volume Rendering", 2023, section 4.3.
pub fn invert_linear(t: &[f32], sigma: &[f32], u: &[f32], depth: &mut [f64], samples: &mut [f32]) {
    let n = t.len();
    assert_eq!(sigma.len(), n, "one density a node");
    assert_eq!(depth.len(), n, "depth holds one number a node");
    assert_eq!(u.len(), samples.len(), "one random number a sample");
    if n < 2 {
        assert!(samples.is_empty(), "one node or none gives no samples");
        depth.fill(0.0);
        return;
    }
    depth[0] = 0.0;
    for i in 0..n - 1 {
        let (a, b) = ends(t, sigma, i);
        depth[i + 1] = depth[i] + 0.5 * (a + b);
    }
    let total = depth[n - 1];
    let opacity = -m64::exp_m1(-total);
    for (sample, &u) in samples.iter_mut().zip(u) {
        let u = f64::from(u);
        let (i, share) = if total > 0.0 {
            let target = (-m64::ln_1p(-u * opacity)).min(total);
            // The first interval that ends behind the target, or the last one with density.
            let i = depth.partition_point(|&d| d <= target).min(depth.partition_point(|&d| d < total)).max(1) - 1;
            let (a, b) = ends(t, sigma, i);
            (i, root(a, b, target - depth[i]))
        } else {
            let place = u * (n - 1) as f64;
            let i = (place as usize).min(n - 2);
            (i, place - i as f64)
        };
        let (from, to) = (f64::from(t[i]), f64::from(t[i + 1]));
        *sample = (from + share.clamp(0.0, 1.0) * (to - from)) as f32;
    }
}

/// Optical densities at both ends of interval `i`: density times its length.
fn ends(t: &[f32], sigma: &[f32], i: usize) -> (f64, f64) {
    let dt = f64::from(t[i + 1]) - f64::from(t[i]);
    let optical = |sigma: f32| if dt > 0.0 { (f64::from(sigma) * dt).min(DENSEST) } else { 0.0 };
    (optical(sigma[i]), optical(sigma[i + 1]))
}

/// Where in `[0, 1]` the optical depth `a u + (b - a) u^2 / 2` reaches `d`.
fn root(a: f64, b: f64, d: f64) -> f64 {
    let divisor = a + m64::sqrt((a * a + 2.0 * (b - a) * d).max(0.0));
    if divisor > 0.0 { 2.0 * d / divisor } else { 0.0 }
}
