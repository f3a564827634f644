//! The joint quadrature in `f64`, one ray at a time, written from its definition. Allocates; not for hot paths.

use super::Mixture;
use alloc::vec;
use alloc::vec::Vec;
use float_core::m64;

/// Weights and transmittances of one ray.
#[derive(Clone, Debug, PartialEq)]
pub struct Ray {
    /// `[n]` weights of the static part.
    pub w_s: Vec<f64>,
    /// `[n]` weights of the transient part.
    pub w_t: Vec<f64>,
    /// `[n + 1]` transmittance before each sample; the last entry reaches the background.
    pub trans: Vec<f64>,
}

/// Weights of one ray from its optical depths.
#[must_use]
pub fn weights(mixture: Mixture, tau_s: &[f64], tau_t: &[f64]) -> Ray {
    let mut ray = Ray { w_s: Vec::new(), w_t: Vec::new(), trans: vec![1.0] };
    let mut depth = 0.0;
    for (&s, &t) in tau_s.iter().zip(tau_t) {
        let trans = m64::exp(-depth);
        let [a_s, a_t] = match mixture {
            Mixture::Paper => [s, t].map(|tau| -m64::exp_m1(-tau)),
            Mixture::Proportional => shares(s, t).map(|share| -m64::exp_m1(-(s + t)) * share),
        };
        ray.w_s.push(trans * a_s);
        ray.w_t.push(trans * a_t);
        depth += s + t;
        ray.trans.push(m64::exp(-depth));
    }
    ray
}

/// What a ray sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pixel<const C: usize> {
    /// Composited colour.
    pub colour: [f64; C],
    /// Uncertainty, without its lower bound.
    pub beta: f64,
    /// What the transient part covers.
    pub transient: f64,
}

/// Composited values of one ray: `values_s`, `values_t` are `[n][channels]`, sample by sample.
///
/// # Panics
/// Where there are fewer values than weights, or the lists of `ray` do not fit together.
#[must_use]
pub fn pixel<const C: usize>(
    ray: &Ray,
    values_s: &[[f64; C]],
    values_t: &[[f64; C]],
    beta: &[f64],
    background: [f64; C],
) -> Pixel<C> {
    let n = ray.w_s.len();
    let channel = |c: usize| {
        let seen = (0..n).map(|i| ray.w_s[i] * values_s[i][c] + ray.w_t[i] * values_t[i][c]).sum::<f64>();
        seen + ray.trans[n] * background[c]
    };
    Pixel {
        colour: core::array::from_fn(channel),
        beta: ray.w_t.iter().zip(beta).map(|(w, b)| w * b).sum(),
        transient: ray.w_t.iter().sum(),
    }
}

/// Gradients with respect to both optical depths, given those with respect to all weights and all `n + 1` transmittances:
/// every entry of the Jacobian, O(n²).
///
/// # Panics
/// Where a slice is shorter than its samples.
#[must_use]
pub fn tau_bar(mixture: Mixture, tau_s: &[f64], tau_t: &[f64], w_bar: [&[f64]; 2], trans_bar: &[f64]) -> [Vec<f64>; 2] {
    let ray = weights(mixture, tau_s, tau_t);
    let n = tau_s.len();
    let mut out = [vec![0.0; n], vec![0.0; n]];
    for k in 0..n {
        // What lies behind loses in proportion, whichever of the two grows.
        let sum = |bar: &[f64], of: &[f64]| bar[k + 1..].iter().zip(&of[k + 1..]).map(|(bar, x)| bar * x).sum::<f64>();
        let behind = sum(w_bar[0], &ray.w_s) + sum(w_bar[1], &ray.w_t) + sum(trans_bar, &ray.trans);
        let jacobian = own(mixture, tau_s[k], tau_t[k]);
        for (out, by) in out.iter_mut().zip(jacobian) {
            out[k] = ray.trans[k] * (w_bar[0][k] * by[0] + w_bar[1][k] * by[1]) - behind;
        }
    }
    out
}

/// Derivatives of the two opacities of one interval: `[by tau_s or tau_t][of a_s or a_t]`.
fn own(mixture: Mixture, s: f64, t: f64) -> [[f64; 2]; 2] {
    if mixture == Mixture::Paper {
        return [[m64::exp(-s), 0.0], [0.0, m64::exp(-t)]];
    }
    let tau = s + t;
    if tau == f64::INFINITY {
        return [[0.0; 2]; 2];
    }
    // a_s = f s with f = (1 - exp(-tau)) / tau.
    let f = if tau > 0.0 { -m64::exp_m1(-tau) / tau } else { 1.0 };
    let derivative = if tau > 1e-2 {
        (m64::exp(-tau) - f) / tau
    } else {
        [1.0 / 840.0, -1.0 / 144.0, 1.0 / 30.0, -0.125, 1.0 / 3.0, -0.5].iter().fold(0.0, |sum, c| sum * tau + c)
    };
    [[f + derivative * s, derivative * t], [derivative * s, f + derivative * t]]
}

/// Shares of the two in their sum; nothing is divided into nothing, two infinities evenly.
fn shares(s: f64, t: f64) -> [f64; 2] {
    match (s == f64::INFINITY, t == f64::INFINITY) {
        (true, true) => [0.5; 2],
        (true, false) => [1.0, 0.0],
        (false, true) => [0.0, 1.0],
        (false, false) if s + t > 0.0 => [s / (s + t), t / (s + t)],
        (false, false) => [0.0; 2],
    }
}
