//! The quadrature in `f64`, one ray at a time, written from its definition: what the fast kernels are tested against,
//! and what a reference renderer uses. Allocates; not for hot paths.

use super::LastInterval;
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
#[must_use]
pub fn colour<const C: usize>(ray: &Ray, values: &[[f64; C]], background: [f64; C]) -> [f64; C] {
    core::array::from_fn(|c| {
        let behind = ray.trans[ray.w.len()] * background[c];
        ray.w.iter().zip(values).map(|(w, v)| w * v[c]).sum::<f64>() + behind
    })
}

/// Gradient with respect to the optical depths, given those with respect to all weights and all `n + 1` transmittances:
/// every entry of the Jacobian, O(n²).
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
