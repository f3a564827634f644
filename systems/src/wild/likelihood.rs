//! The likelihood of a pixel under its uncertainty, of which the residual's tail may be longer than a normal distribution's.
//!
//! ```text
//! L = k(e)^2 / (2 beta^2) + ln beta        e^2 = mean |C - Y|^2 over channels
//! k(e)^2 = 2 c^2 (sqrt(1 + e^2 / c^2) - 1)
//! ```
//!
//! `k(e) = e` well below `c` and, as published, everywhere for `c = 0`; beyond, an error costs its length instead of its
//! square. Until strangers are explained, their squares are most of a batch's gradient, and the scene bends to them: see
//! `docs/decisions/0016-nerf-w-on-a-fast-field.md`.

use super::config::WildConfig;
use losses::uncertainty::{Channels, Likelihood};

/// What a pixel costs, and the derivatives of that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Unlikely {
    pub(super) loss: f32,
    pub(super) rgb_bar: [f32; 3],
    pub(super) beta_bar: f32,
}

/// The likelihood.
#[derive(Clone, Copy, Debug)]
pub(super) struct TailedLikelihood {
    normal: Likelihood,
    /// `c`, colour units; 0: none.
    tail: f32,
}

impl TailedLikelihood {
    pub(super) fn new(config: &WildConfig) -> Self {
        Self { normal: Likelihood { beta_min: config.beta_min, channels: Channels::Mean }, tail: config.tail }
    }

    pub(super) fn beta_min(&self) -> f32 {
        self.normal.beta_min
    }

    #[cfg(test)]
    pub(super) fn tail(&self) -> f32 {
        self.tail
    }

    /// A pixel rendered as `rgb`, of this uncertainty, the least included.
    pub(super) fn pixel(&self, rgb: [f32; 3], truth: [f32; 3], beta: f32) -> Unlikely {
        let (shorter, slope) = self.shorten(rgb, truth);
        let (seen, truth, beta) = ([shorter], [truth], [beta]);
        let (mut loss, mut rgb_bar, mut beta_bar) = ([0.0], [[0.0; 3]], [0.0]);
        let fits = "one ray, and `beta_min` is checked before";
        self.normal.per_ray(&seen, &truth, &beta, &mut loss).expect(fits);
        self.normal.sum_backward(&seen, &truth, &beta, None, 1.0, &mut rgb_bar, &mut beta_bar).expect(fits);
        Unlikely { loss: loss[0], rgb_bar: rgb_bar[0].map(|bar| bar * slope), beta_bar: beta_bar[0] }
    }

    /// A colour whose error is `k(e)`, and what its gradient is multiplied by to be that of the colour itself.
    fn shorten(&self, rgb: [f32; 3], truth: [f32; 3]) -> ([f32; 3], f32) {
        if self.tail == 0.0 {
            return (rgb, 1.0);
        }
        let error = [0, 1, 2].map(|i| rgb[i] - truth[i]);
        let ratio = error.iter().map(|e| e * e).sum::<f32>() / (3.0 * self.tail * self.tail);
        let root = (1.0 + ratio).sqrt();
        // 2 (root - 1) / ratio, without the difference of near numbers.
        let k = (2.0 / (root + 1.0)).sqrt();
        // d (k e)^2 / d e = 2 e / root, and the normal likelihood says 2 k e.
        ([0, 1, 2].map(|i| truth[i] + k * error[i]), 1.0 / (k * root))
    }
}

#[cfg(test)]
mod tests {
    use super::super::check::LEAST_SCALE;
    use super::super::config::{AppearanceKind, FieldKind, OccluderKind};
    use super::*;
    use proptest::prelude::*;

    fn likelihood(tail: f32) -> TailedLikelihood {
        let config = WildConfig::new(FieldKind::Ngp, AppearanceKind::None, OccluderKind::Transient);
        TailedLikelihood::new(&WildConfig { tail, beta_min: 0.05, ..config })
    }

    /// From the definition, in `f64`.
    fn twin(tail: f64, rgb: [f64; 3], truth: [f64; 3], beta: f64) -> f64 {
        let e2 = (0..3).map(|i| (rgb[i] - truth[i]).powi(2)).sum::<f64>() / 3.0;
        let k2 = if tail > 0.0 { 2.0 * tail * tail * ((1.0 + e2 / (tail * tail)).sqrt() - 1.0) } else { e2 };
        k2 / (2.0 * beta * beta) + beta.ln()
    }

    #[test]
    fn without_a_tail_it_is_the_published_one() {
        let (rgb, truth) = ([0.3, 0.9, 0.1], [0.5, 0.4, 0.15]);
        let normal = Likelihood { beta_min: 0.05, channels: Channels::Mean };
        let mut loss = [0.0];
        normal.per_ray(&[rgb], &[truth], &[0.2], &mut loss).unwrap();
        assert_eq!(likelihood(0.0).pixel(rgb, truth, 0.2).loss, loss[0]);
        // So it is well below the scale of the tail, and no pixel costs more with one.
        let near = likelihood(100.0).pixel(rgb, truth, 0.2).loss;
        assert!((near - loss[0]).abs() < 1e-4 && likelihood(0.1).pixel(rgb, truth, 0.2).loss < loss[0]);
    }

    #[test]
    fn the_least_scales_that_settings_allow_leave_derivatives_finite() {
        let config = WildConfig::new(FieldKind::Ngp, AppearanceKind::None, OccluderKind::Transient);
        for tail in [0.0, LEAST_SCALE, 1e3] {
            for beta_min in [LEAST_SCALE, 1e3] {
                let config = WildConfig { tail, beta_min, ..config.clone() };
                config.check().unwrap();
                for e in [0.0, 1e-30, 1e-6, 1.0, 1e4] {
                    let got = TailedLikelihood::new(&config).pixel([e, 0.0, -e], [0.0; 3], beta_min);
                    let numbers = [got.loss, got.beta_bar, got.rgb_bar[0], got.rgb_bar[1], got.rgb_bar[2]];
                    assert!(numbers.iter().all(|v| v.is_finite()), "{tail} {beta_min} {e}: {got:?}");
                }
            }
        }
    }

    proptest! {
        #[test]
        fn gradients_match_central_differences(
            rgb in prop::array::uniform3(-0.5_f32..1.5),
            truth in prop::array::uniform3(0.0_f32..1.0),
            beta in 0.051_f32..1.0,
            tail in prop_oneof![Just(0.0_f32), 0.01_f32..0.5],
        ) {
            let got = likelihood(tail).pixel(rgb, truth, beta);
            let f = |rgb: [f64; 3], beta: f64| twin(tail.into(), rgb, truth.map(f64::from), beta);
            let (at, b) = (rgb.map(f64::from), f64::from(beta));
            let close = |got: f32, want: f64| (f64::from(got) - want).abs() < 1e-4 * (1.0 + want.abs());
            prop_assert!(close(got.loss, f(at, b)));
            const H: f64 = 1e-6;
            for c in 0..3 {
                let moved = |by: f64| { let mut rgb = at; rgb[c] += by; f(rgb, b) };
                let want = (moved(H) - moved(-H)) / (2.0 * H);
                prop_assert!(close(got.rgb_bar[c], want), "{:?} {want}", got.rgb_bar);
            }
            let want = (f(at, b + H) - f(at, b - H)) / (2.0 * H);
            prop_assert!(close(got.beta_bar, want), "{} {want}", got.beta_bar);
        }

        #[test]
        fn nothing_is_without_end(e in -1e6_f32..1e6, tail in 0.0_f32..0.5) {
            let got = likelihood(tail).pixel([e, 0.0, 0.0], [0.0; 3], 0.05);
            prop_assert!(got.loss.is_finite() && got.beta_bar.is_finite() && got.rgb_bar.iter().all(|b| b.is_finite()));
            if tail > 0.01 {
                // Beyond the tail's scale the gradient no longer grows.
                prop_assert!(got.rgb_bar[0].abs() <= 1.01 * tail / (0.05 * 0.05));
            }
        }
    }
}
