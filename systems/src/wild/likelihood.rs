//! What a pixel costs under its uncertainty: the likelihood of one ray, where fields and covers ask pixel by pixel.
//!
//! Its tail, which no published system has, keeps strangers from bending the scene before they are explained: see
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

/// The likelihood that the settings ask for.
pub(super) fn likelihood(config: &WildConfig) -> Likelihood {
    Likelihood { beta_min: config.beta_min, channels: Channels::Mean, tail: config.tail }
}

/// A pixel rendered as `rgb`, of this uncertainty, the least included.
pub(super) fn pixel(likelihood: &Likelihood, rgb: [f32; 3], truth: [f32; 3], beta: f32) -> Unlikely {
    let (rgb, truth, beta) = ([rgb], [truth], [beta]);
    let (mut loss, mut rgb_bar, mut beta_bar) = ([0.0], [[0.0; 3]], [0.0]);
    let fits = "one ray, and the settings are checked before";
    likelihood.per_ray(&rgb, &truth, &beta, &mut loss).expect(fits);
    likelihood.sum_backward(&rgb, &truth, &beta, None, 1.0, &mut rgb_bar, &mut beta_bar).expect(fits);
    Unlikely { loss: loss[0], rgb_bar: rgb_bar[0], beta_bar: beta_bar[0] }
}

#[cfg(test)]
mod tests {
    use super::super::check::LEAST_SCALE;
    use super::super::config::{AppearanceKind, FieldKind, OccluderKind};
    use super::*;

    #[test]
    fn settings_reach_the_likelihood() {
        let config = WildConfig::new(FieldKind::Ngp, AppearanceKind::None, OccluderKind::Transient);
        let likelihood = likelihood(&WildConfig { tail: 0.1, beta_min: 0.05, ..config });
        let got = pixel(&likelihood, [0.3, 0.9, 0.1], [0.5, 0.4, 0.15], 0.2);
        let e2 = (0.04 + 0.25 + 0.0025_f64) / 3.0;
        let root = (1.0 + e2 / 0.01).sqrt();
        assert!((f64::from(got.loss) - (0.01 * (root - 1.0) / 0.04 + 0.2_f64.ln())).abs() < 1e-6, "{got:?}");
        assert!((f64::from(got.rgb_bar[1]) - 0.5 / 3.0 / 0.04 / root).abs() < 1e-5);
    }

    #[test]
    fn the_least_scales_that_settings_allow_leave_derivatives_finite() {
        let config = WildConfig::new(FieldKind::Ngp, AppearanceKind::None, OccluderKind::Transient);
        for tail in [0.0, LEAST_SCALE, 1e3] {
            for beta_min in [LEAST_SCALE, 1e3] {
                let config = WildConfig { tail, beta_min, ..config.clone() };
                config.check().unwrap();
                for e in [0.0, 1e-30, 1e-6, 1.0, 1e4] {
                    let got = pixel(&likelihood(&config), [e, 0.0, -e], [0.0; 3], beta_min);
                    let numbers = [got.loss, got.beta_bar, got.rgb_bar[0], got.rgb_bar[1], got.rgb_bar[2]];
                    assert!(numbers.iter().all(|v| v.is_finite()), "{tail} {beta_min} {e}: {got:?}");
                }
            }
        }
    }
}
