//! The quadrature in `f64`, one ray at a time, written from its definition: what the fast kernels are tested against,
//! and what a reference renderer uses. Allocates; not for hot paths.

use super::rule::centroid::NODES;
use super::{LastInterval, Rule};
use alloc::vec;
use alloc::vec::Vec;
use float_core::m64;

/// Weights and transmittances of one ray.
#[derive(Clone, Debug, PartialEq)]
pub struct Ray {
    /// `[n]` weights.
    pub w: Vec<f64>,
    /// `[n + 1]` transmittance before each sample; the last entry reaches the background.
    pub trans: Vec<f64>,
    /// Accumulated opacity, `1 - trans[n]` without its cancellation.
    pub opacity: f64,
}

/// Weights of one ray from its optical depths.
#[must_use]
pub fn weights(tau: &[f64], last: LastInterval) -> Ray {
    let mut ray = Ray { w: Vec::with_capacity(tau.len()), trans: vec![1.0], opacity: 0.0 };
    let mut depth = 0.0;
    for (i, &tau_i) in tau.iter().enumerate() {
        let tau_i = if last == LastInterval::Opaque && i + 1 == tau.len() { f64::INFINITY } else { tau_i };
        ray.w.push(m64::exp(-depth) * -m64::exp_m1(-tau_i));
        depth += tau_i;
        ray.trans.push(m64::exp(-depth));
    }
    ray.opacity = -m64::exp_m1(-depth);
    ray
}

/// Composited value of one ray: `values` is `[n][channels]`, sample by sample.
///
/// # Panics
/// Where `ray.trans` is not longer than `ray.w`.
#[must_use]
pub fn colour<const C: usize>(ray: &Ray, values: &[[f64; C]], background: [f64; C]) -> [f64; C] {
    core::array::from_fn(|c| {
        let behind = ray.trans[ray.w.len()] * background[c];
        ray.w.iter().zip(values).map(|(w, v)| w * v[c]).sum::<f64>() + behind
    })
}

/// Gradient with respect to the optical depths, given those with respect to all weights and all `n + 1` transmittances:
/// every entry of the Jacobian, O(n²).
///
/// # Panics
/// Where a slice is shorter than its samples.
#[must_use]
pub fn tau_bar(tau: &[f64], last: LastInterval, w_bar: &[f64], trans_bar: &[f64]) -> Vec<f64> {
    let ray = weights(tau, last);
    let n = tau.len();
    let mut out = vec![0.0; n];
    for (k, out) in out.iter_mut().enumerate() {
        if last == LastInterval::Opaque && k + 1 == n {
            continue;
        }
        // dw[k]/dtau[k] is the transmittance behind k; the samples behind it lose in proportion.
        *out += w_bar[k] * ray.trans[k + 1];
        *out -= w_bar[k + 1..].iter().zip(&ray.w[k + 1..]).map(|(bar, w)| bar * w).sum::<f64>();
        *out -= trans_bar[k + 1..].iter().zip(&ray.trans[k + 1..]).map(|(bar, t)| bar * t).sum::<f64>();
    }
    out
}

/// Optical depths and values of the intervals of one ray: [`intervals`](super::intervals).
///
/// `dt`, `sigma` `[n]`, `values` `[n][channels]`.
///
/// # Panics
/// Where there are fewer lengths or values than densities.
#[must_use]
pub fn intervals<const C: usize>(
    rule: Rule,
    dt: &[f64],
    sigma: &[f64],
    values: &[[f64; C]],
) -> (Vec<f64>, Vec<[f64; C]>) {
    let n = sigma.len();
    let (mut tau, mut out) = (Vec::with_capacity(n), Vec::with_capacity(n));
    for i in 0..n {
        let j = (i + 1).min(n - 1);
        let (a, b) = (sigma[i] * dt[i], sigma[j] * dt[i]);
        let (depth, mu) = match rule {
            Rule::PiecewiseConstant => (a, 0.0),
            Rule::Trapezoid => (0.5 * (a + b), 0.5),
            Rule::PiecewiseLinear => (0.5 * (a + b), centroid(a, b)),
        };
        tau.push(depth);
        out.push(core::array::from_fn(|c| values[i][c] + mu * (values[j][c] - values[i][c])));
    }
    (tau, out)
}

/// Gradients of one ray with respect to what [`intervals`] takes.
#[derive(Clone, Debug, PartialEq)]
pub struct PointsBar<const C: usize> {
    /// `[n]`
    pub dt: Vec<f64>,
    /// `[n]`
    pub sigma: Vec<f64>,
    /// `[n][channels]`
    pub values: Vec<[f64; C]>,
}

/// Gradient of [`intervals`] from those with respect to its two results.
///
/// # Panics
/// Where a slice is shorter than the densities.
#[must_use]
pub fn intervals_backward<const C: usize>(
    rule: Rule,
    dt: &[f64],
    sigma: &[f64],
    values: &[[f64; C]],
    tau_bar: &[f64],
    values_bar: &[[f64; C]],
) -> PointsBar<C> {
    let n = sigma.len();
    let mut bar = PointsBar { dt: vec![0.0; n], sigma: vec![0.0; n], values: vec![[0.0; C]; n] };
    for i in 0..n {
        let j = (i + 1).min(n - 1);
        let (a, b) = (sigma[i] * dt[i], sigma[j] * dt[i]);
        let (mu, mut a_bar, mut b_bar) = match rule {
            Rule::PiecewiseConstant => (0.0, tau_bar[i], 0.0),
            Rule::Trapezoid => (0.5, 0.5 * tau_bar[i], 0.5 * tau_bar[i]),
            Rule::PiecewiseLinear => (centroid(a, b), 0.5 * tau_bar[i], 0.5 * tau_bar[i]),
        };
        let mut mu_bar = 0.0;
        for c in 0..C {
            bar.values[i][c] += (1.0 - mu) * values_bar[i][c];
            bar.values[j][c] += mu * values_bar[i][c];
            mu_bar += values_bar[i][c] * (values[j][c] - values[i][c]);
        }
        if rule == Rule::PiecewiseLinear {
            let [mu_a, mu_b] = centroid_gradient(a, b);
            a_bar += mu_bar * mu_a;
            b_bar += mu_bar * mu_b;
        }
        bar.sigma[i] += a_bar * dt[i];
        bar.sigma[j] += b_bar * dt[i];
        bar.dt[i] += a_bar * sigma[i] + b_bar * sigma[j];
    }
    bar
}

/// Mean position of absorption in `[0, 1]` under the optical density `a + (b - a) u`; 1/2 where there is none.
#[must_use]
pub fn centroid(a: f64, b: f64) -> f64 {
    if a + b == 0.0 {
        return 0.5;
    }
    let moments = moments(a, b, |u, density| [density, density * u]);
    moments[1] / moments[0]
}

/// The derivatives of [`centroid`] by `a` and `b`; 0 where it has none.
#[must_use]
pub fn centroid_gradient(a: f64, b: f64) -> [f64; 2] {
    if a + b == 0.0 {
        return [0.0; 2];
    }
    let mu = centroid(a, b);
    let [total, by_a, by_b] = moments(a, b, |u, density| {
        let half = 0.5 * u * u;
        [density, (u - mu) * ((1.0 - u) - density * (u - half)), (u - mu) * (u - density * half)]
    });
    [by_a / total, by_b / total]
}

/// Integrals over `[0, 1]` of `f(u, a + (b - a) u) exp(-a u - (b - a) u^2 / 2)`, by Gauss panels on the part in front of the
/// optical depth 45; what is left out has a share of `3e-20`.
fn moments<const K: usize>(a: f64, b: f64, f: impl Fn(f64, f64) -> [f64; K]) -> [f64; K] {
    const PANELS: usize = 32;
    let depth = (0.5 * (a + b)).min(45.0);
    let reach = (2.0 * depth / (a + m64::sqrt((a * a + 2.0 * (b - a) * depth).max(0.0)))).min(1.0);
    let mut sums = [0.0; K];
    for panel in 0..PANELS {
        for (x, weight) in NODES {
            let u = reach * (panel as f64 + x) / PANELS as f64;
            let e = weight * m64::exp(-u * (a + 0.5 * (b - a) * u));
            for (sum, f) in sums.iter_mut().zip(f(u, a + (b - a) * u)) {
                *sum += e * f;
            }
        }
    }
    sums
}
