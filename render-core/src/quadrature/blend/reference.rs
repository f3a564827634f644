//! The blend in `f64`, one ray at a time, written from its definition. Allocates; not for hot paths.

use alloc::vec;
use alloc::vec::Vec;
use float_core::m64;

/// Weights and transmittances of one ray.
#[derive(Clone, Debug, PartialEq)]
pub struct Ray {
    /// `[n]` weights of the static part.
    pub w_s: Vec<f64>,
    /// `[n]` weights of the dynamic part.
    pub w_d: Vec<f64>,
    /// `[n + 1]` transmittance before each sample; the last entry reaches the background.
    pub trans: Vec<f64>,
    /// How much of the pixel moves.
    pub dynamic: f64,
}

/// Gradients that reach all of a [`Ray`].
#[derive(Clone, Copy, Debug)]
pub struct RayBar<'a> {
    /// `[n]`
    pub w_s: &'a [f64],
    /// `[n]`
    pub w_d: &'a [f64],
    /// `[n + 1]`
    pub trans: &'a [f64],
    /// Of the one number.
    pub dynamic: f64,
}

/// Gradients of optical depths and shares.
#[derive(Clone, Debug, PartialEq)]
pub struct SamplesBar {
    /// `[n]`
    pub tau_s: Vec<f64>,
    /// `[n]`
    pub tau_d: Vec<f64>,
    /// `[n]`
    pub m: Vec<f64>,
}

/// `1 - exp(-tau)`.
fn opacity(tau: f64) -> f64 {
    -m64::exp_m1(-tau)
}

/// Weights of one ray from its optical depths and shares.
#[must_use]
pub fn weights(tau_s: &[f64], tau_d: &[f64], m: &[f64]) -> Ray {
    let mut ray = Ray { w_s: Vec::new(), w_d: Vec::new(), trans: vec![1.0], dynamic: 0.0 };
    let mut trans = 1.0;
    for ((&s, &d), &m) in tau_s.iter().zip(tau_d).zip(m) {
        let (p, q) = (m * opacity(d), (1.0 - m) * opacity(s));
        ray.w_d.push(trans * p);
        ray.w_s.push(trans * q);
        ray.dynamic += trans * (p + q) * m;
        // 1 - m (1 - exp(-d)), without the cancellation.
        trans *= ((1.0 - m) + m * m64::exp(-d)) * (m + (1.0 - m) * m64::exp(-s));
        ray.trans.push(trans);
    }
    ray
}

/// Composited colour of one ray: `values_s`, `values_d` are `[n][channels]`, sample by sample.
///
/// # Panics
/// Where there are fewer values than weights, or the lists of `ray` do not fit together.
#[must_use]
pub fn colour<const C: usize>(
    ray: &Ray,
    values_s: &[[f64; C]],
    values_d: &[[f64; C]],
    background: [f64; C],
) -> [f64; C] {
    let n = ray.w_s.len();
    core::array::from_fn(|c| {
        let seen = (0..n).map(|i| ray.w_s[i] * values_s[i][c] + ray.w_d[i] * values_d[i][c]).sum::<f64>();
        seen + ray.trans[n] * background[c]
    })
}

/// Gradients of [`weights`]: every sample sums over all behind it, O(n²).
///
/// # Panics
/// Where a slice is shorter than its samples.
#[must_use]
pub fn weights_backward(tau_s: &[f64], tau_d: &[f64], m: &[f64], bar: RayBar<'_>) -> SamplesBar {
    let ray = weights(tau_s, tau_d, m);
    let n = m.len();
    let mut out = SamplesBar { tau_s: vec![0.0; n], tau_d: vec![0.0; n], m: vec![0.0; n] };
    // What all that a sample is seen by is worth: its gradient with respect to the transmittance before it.
    let worth = |i: usize, trans: f64| {
        let (p, q) = (m[i] * opacity(tau_d[i]), (1.0 - m[i]) * opacity(tau_s[i]));
        trans * (bar.trans[i] + p * bar.w_d[i] + q * bar.w_s[i] + (p + q) * m[i] * bar.dynamic)
    };
    for k in 0..n {
        let (a_s, a_d) = (opacity(tau_s[k]), opacity(tau_d[k]));
        let (p, q) = (m[k] * a_d, (1.0 - m[k]) * a_s);
        // Behind k as if k were not there: no division by what k lets pass.
        let (mut trans, mut behind) = (ray.trans[k], 0.0);
        for i in k + 1..n {
            behind += worth(i, trans);
            trans *= (1.0 - m[i] * opacity(tau_d[i])) * (1.0 - (1.0 - m[i]) * opacity(tau_s[i]));
        }
        behind += trans * bar.trans[n];
        let moves = bar.dynamic * m[k];
        let p_bar = ray.trans[k] * (bar.w_d[k] + moves) - (1.0 - q) * behind;
        let q_bar = ray.trans[k] * (bar.w_s[k] + moves) - (1.0 - p) * behind;
        out.tau_d[k] = p_bar * m[k] * m64::exp(-tau_d[k]);
        out.tau_s[k] = q_bar * (1.0 - m[k]) * m64::exp(-tau_s[k]);
        out.m[k] = p_bar * a_d - q_bar * a_s + bar.dynamic * ray.trans[k] * (p + q);
    }
    out
}
