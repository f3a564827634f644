//! The likelihood of a pixel under an uncertainty of its own.
//!
//! Its tail, which no published system has, keeps occluders from distorting the scene before they are explained: see
//! `docs/decisions/0016-nerf-w-on-a-fast-field.md`.

use super::pixel_error::LEAST_SCALE;
use crate::limits::{MOST, refuse, within};
use engine::system::SystemError;
use losses::uncertainty::Likelihood;

/// The loss of a pixel, and its derivatives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PixelLikelihood {
    pub(crate) loss: f32,
    pub(crate) rgb_bar: [f32; 3],
    pub(crate) beta_bar: f32,
}

/// The likelihood with this least uncertainty and this tail, colour units.
pub(crate) fn likelihood(beta_min: f32, tail: f32) -> Likelihood {
    Likelihood::PHOTOGRAPHS.with_beta_min(beta_min).with_tail(tail)
}

/// Check the settings `beta_min` and `tail`.
///
/// # Errors
/// [`SystemError::Config`] naming the one that cannot work.
pub(crate) fn check(beta_min: f32, tail: f32) -> Result<(), SystemError> {
    within("beta_min", beta_min, LEAST_SCALE..=1e3)?;
    if tail > 0.0 && tail < LEAST_SCALE {
        return refuse("tail", tail, "must be 0, or in 0.000001..=1000");
    }
    within("tail", tail, 0.0..=MOST)
}

/// The loss of a pixel rendered as `rgb` with the uncertainty `beta`, the least included.
pub(crate) fn pixel(likelihood: &Likelihood, rgb: [f32; 3], truth: [f32; 3], beta: f32) -> PixelLikelihood {
    let (rgb, truth, beta) = ([rgb], [truth], [beta]);
    let (mut loss, mut rgb_bar, mut beta_bar) = ([0.0], [[0.0; 3]], [0.0]);
    let fits = "one ray, and the settings are checked before";
    likelihood.per_ray(&rgb, &truth, &beta, &mut loss).expect(fits);
    likelihood.sum_backward(&rgb, &truth, &beta, None, 1.0, &mut rgb_bar, &mut beta_bar).expect(fits);
    PixelLikelihood { loss: loss[0], rgb_bar: rgb_bar[0], beta_bar: beta_bar[0] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_reach_the_likelihood() {
        let likelihood = likelihood(0.05, 0.1);
        let got = pixel(&likelihood, [0.3, 0.9, 0.1], [0.5, 0.4, 0.15], 0.2);
        let e2 = (0.04 + 0.25 + 0.0025_f64) / 3.0;
        let root = (1.0 + e2 / 0.01).sqrt();
        assert!((f64::from(got.loss) - (0.01 * (root - 1.0) / 0.04 + 0.2_f64.ln())).abs() < 1e-6, "{got:?}");
        assert!((f64::from(got.rgb_bar[1]) - 0.5 / 3.0 / 0.04 / root).abs() < 1e-5);
    }

    #[test]
    fn the_least_scales_that_settings_allow_leave_derivatives_finite() {
        for tail in [0.0, LEAST_SCALE, 1e3] {
            for beta_min in [LEAST_SCALE, 1e3] {
                check(beta_min, tail).unwrap();
                for e in [0.0, 1e-30, 1e-6, 1.0, 1e4] {
                    let got = pixel(&likelihood(beta_min, tail), [e, 0.0, -e], [0.0; 3], beta_min);
                    let numbers = [got.loss, got.beta_bar, got.rgb_bar[0], got.rgb_bar[1], got.rgb_bar[2]];
                    assert!(numbers.iter().all(|v| v.is_finite()), "{tail} {beta_min} {e}: {got:?}");
                }
            }
        }
    }

    #[test]
    fn scales_that_overflow_are_refused() {
        for (beta_min, tail, want) in [
            (9e-7, 0.0, "`beta_min` = 0.0000009: must be in 0.000001..=1000"),
            (0.1, 1e-20, "`tail` = 0.00000000000000000001: must be 0, or in 0.000001..=1000"),
            (0.1, -1.0, "`tail` = -1: must be in 0..=1000"),
            (0.1, f32::NAN, "`tail` = NaN: must be in 0..=1000"),
        ] {
            assert_eq!(check(beta_min, tail).unwrap_err().to_string(), want);
        }
    }
}
