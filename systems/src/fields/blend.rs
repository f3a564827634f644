//! A still part and a moving part of a field at the same points: densities mixed by a gate, and what colours depend on by matter.
//!
//! ```text
//! m = sigmoid(gate)                            blend weight of a sample (NSFF, Li et al., 2021, section 3.3)
//! sigma = (1 - m) sigma_s + m sigma_m          matter of both parts
//! P = m sigma_m / sigma                        the moving part's share of it
//! g = (1 - P) g_s + P g_m                      what colours depend on
//! ```
//!
//! The papers mix colours; here one colour network sees mixed features: where a sample belongs to one part, as the losses ask for,
//! that is the same, and colours are evaluated once.
//!
//! Densities are exponentials of raw numbers `r`, so that `ln sigma = ln(exp(r_s + ln(1 - m)) + exp(r_m + ln m))` and
//! `P = sigmoid(gate + r_m - r_s)`: nothing overflows. Matrices are `[rows][n]`: `r`, then `g`; the moving part has a last row, its gate.

use float_core::m32::{logistic, softplus};

/// Both parts of `n` points.
#[derive(Clone, Copy)]
pub(super) struct Parts<'a> {
    /// `[rows][n]`
    pub(super) still: &'a [f32],
    /// `[rows + 1][n]`; rows after the gate's are not read
    pub(super) moving: &'a [f32],
    pub(super) n: usize,
}

impl Parts<'_> {
    fn rows(&self) -> usize {
        self.still.len() / self.n.max(1)
    }

    /// `r_s`, `r_m` and the gate of point `i`.
    fn heads(&self, i: usize) -> [f32; 3] {
        [self.still[i], self.moving[i], self.moving[self.rows() * self.n + i]]
    }
}

/// The mixture `[rows][n]`, written over `out`, and the moving part's share `[n]`, over `share`.
pub(super) fn blend(parts: Parts<'_>, out: &mut [f32], share: &mut [f32]) {
    let n = parts.n;
    for i in 0..n {
        let [still, moving, gate] = parts.heads(i);
        let (a, b) = (still - softplus(gate), moving - softplus(-gate));
        out[i] = a.max(b) + (-(a - b).abs()).exp().ln_1p();
        share[i] = logistic(gate + moving - still);
    }
    for row in 1..parts.rows() {
        let span = row * n..(row + 1) * n;
        let (still, moving) = (&parts.still[span.clone()], &parts.moving[span.clone()]);
        for (i, out) in out[span].iter_mut().enumerate() {
            *out = still[i] + share[i] * (moving[i] - still[i]);
        }
    }
}

/// Gradients of both parts, written over `still_bar` `[rows][n]` and `moving_bar` `[rows + 1][n]`, from those of what [`blend`]
/// gave.
pub(super) fn blend_backward(
    parts: Parts<'_>,
    share: &[f32],
    out_bar: &[f32],
    share_bar: &[f32],
    still_bar: &mut [f32],
    moving_bar: &mut [f32],
) {
    let (n, rows) = (parts.n, parts.rows());
    // The gate's row first holds the gradient of the share.
    moving_bar[rows * n..(rows + 1) * n].copy_from_slice(share_bar);
    for row in 1..rows {
        for i in 0..n {
            let k = row * n + i;
            still_bar[k] = (1.0 - share[i]) * out_bar[k];
            moving_bar[k] = share[i] * out_bar[k];
            moving_bar[rows * n + i] += out_bar[k] * (parts.moving[k] - parts.still[k]);
        }
    }
    for i in 0..n {
        let [_, _, gate] = parts.heads(i);
        let (p, m) = (share[i], logistic(gate));
        // d P / d (gate + r_m - r_s) = P (1 - P).
        let z_bar = moving_bar[rows * n + i] * p * (1.0 - p);
        still_bar[i] = (1.0 - p) * out_bar[i] - z_bar;
        moving_bar[i] = p * out_bar[i] + z_bar;
        moving_bar[rows * n + i] = (p - m) * out_bar[i] + z_bar;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use field_core::rng::Rng;
    use testkit::gradient::{Tolerance, central_difference, compare};

    const ROWS: usize = 3;

    /// The equations as they stand.
    fn twin(still: &[f64], moving: &[f64], n: usize) -> (Vec<f64>, Vec<f64>) {
        let (mut out, mut share) = (vec![0.0; ROWS * n], vec![0.0; n]);
        for i in 0..n {
            let m = 1.0 / (1.0 + (-moving[ROWS * n + i]).exp());
            let [of_still, of_moving] = [(1.0 - m) * still[i].exp(), m * moving[i].exp()];
            out[i] = (of_still + of_moving).ln();
            share[i] = of_moving / (of_still + of_moving);
            for k in (1..ROWS).map(|row| row * n + i) {
                out[k] = (1.0 - share[i]) * still[k] + share[i] * moving[k];
            }
        }
        (out, share)
    }

    fn random(len: usize, stream: u64) -> Vec<f32> {
        let mut out = vec![0.0; len];
        Rng::new(3, stream).fill_uniform(0, &mut out);
        out.iter().map(|u| 4.0 * u - 2.0).collect()
    }

    fn wide(x: &[f32]) -> Vec<f64> {
        x.iter().map(|&x| f64::from(x)).collect()
    }

    #[test]
    fn a_mixture_is_its_equations_and_so_is_its_gradient() {
        let n = 5;
        let (still, moving) = (random(ROWS * n, 1), random((ROWS + 1) * n, 2));
        let (out_bar, share_bar) = (random(ROWS * n, 3), random(n, 4));
        let parts = Parts { still: &still, moving: &moving, n };
        let (mut out, mut share) = (vec![f32::NAN; ROWS * n], vec![f32::NAN; n]);
        blend(parts, &mut out, &mut share);
        let (want, want_share) = twin(&wide(&still), &wide(&moving), n);
        compare("mixture", &out, &want, Tolerance::new(2e-6, 1e-6)).unwrap();
        compare("share", &share, &want_share, Tolerance::new(2e-6, 1e-6)).unwrap();

        let (mut still_bar, mut moving_bar) = (vec![f32::NAN; ROWS * n], vec![f32::NAN; (ROWS + 1) * n]);
        blend_backward(parts, &share, &out_bar, &share_bar, &mut still_bar, &mut moving_bar);
        let functional = |still: &[f64], moving: &[f64]| {
            let (out, share) = twin(still, moving, n);
            let dot = |a: &[f64], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * f64::from(*b)).sum::<f64>();
            dot(&out, &out_bar) + dot(&share, &share_bar)
        };
        let want = central_difference(&wide(&still), |still| functional(still, &wide(&moving)));
        compare("still part", &still_bar, &want, Tolerance::SINGLE).unwrap();
        let want = central_difference(&wide(&moving), |moving| functional(&wide(&still), moving));
        compare("moving part", &moving_bar, &want, Tolerance::SINGLE).unwrap();
    }

    #[test]
    fn a_closed_gate_leaves_the_still_part_and_extremes_stay_finite() {
        for (gate, want) in [(-200.0, 1.5), (200.0, -70.0)] {
            let (still, moving) = ([1.5, 7.0], [-70.0, 3.0, gate]);
            let (mut out, mut share) = ([0.0; 2], [0.0]);
            blend(Parts { still: &still, moving: &moving, n: 1 }, &mut out, &mut share);
            assert_eq!(out, [want, if gate < 0.0 { 7.0 } else { 3.0 }], "gate {gate}: share {share:?}");
        }
        for heads in [[-80.0, 80.0, 90.0], [80.0, -80.0, -90.0], [3e4, -3e4, 0.0]] {
            let [still, moving, gate] = heads;
            let (still, moving) = ([still], [moving, gate]);
            let parts = Parts { still: &still, moving: &moving, n: 1 };
            let (mut out, mut share) = ([0.0], [0.0]);
            blend(parts, &mut out, &mut share);
            let (mut still_bar, mut moving_bar) = ([0.0], [0.0; 2]);
            blend_backward(parts, &share, &[1.0], &[1.0], &mut still_bar, &mut moving_bar);
            let all = [out[0], share[0], still_bar[0], moving_bar[0], moving_bar[1]];
            assert!(all.iter().all(|x| x.is_finite()), "{heads:?}: {all:?}");
        }
        blend(Parts { still: &[], moving: &[], n: 0 }, &mut [], &mut []);
    }
}
