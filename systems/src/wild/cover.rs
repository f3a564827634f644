//! What stands before a pixel, and what the pixel costs.
//!
//! Opacities are samples of a Binary Concrete distribution: `a(h) = logistic((ln softplus(h) + noise) / kappa)`.

use super::filter::OUTPUTS;
use super::likelihood::{self, Unlikely};
use float_core::m32;
use losses::concrete::{BinaryConcrete, ln_odds, ln_odds_derivative};
use losses::uncertainty::Likelihood;

/// What stands before a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Cover {
    /// Raw opacity, its noise, and the opacity that both make.
    h: f32,
    pub(super) noise: f32,
    pub(super) alpha: f32,
    rgb: [f32; 3],
    /// Raw uncertainty, and the uncertainty.
    raw_beta: f32,
    beta: f32,
}

/// How a pixel is judged.
#[derive(Clone, Copy, Debug)]
pub(super) struct CoverLoss {
    pub(super) concrete: BinaryConcrete,
    pub(super) likelihood: Likelihood,
    /// Price of opacity.
    pub(super) lambda_alpha: f32,
}

/// What a pixel costs, and the derivatives of that with respect to the composite and the uncertainty.
pub(super) struct Cost {
    pub(super) loss: f32,
    pub(super) over_bar: [f32; 3],
    beta_bar: f32,
}

impl Cover {
    /// `alpha C_t + (1 - alpha) C`
    fn over(&self, rgb: [f32; 3]) -> [f32; 3] {
        [0, 1, 2].map(|c| rgb[c] + self.alpha * (self.rgb[c] - rgb[c]))
    }
}

impl CoverLoss {
    /// What the filter's raw outputs say; `noise` is 0 outside of training.
    pub(super) fn cover(&self, [h, r, g, b, raw_beta]: [f32; OUTPUTS], noise: f32) -> Cover {
        let [alpha, ..] = opacity(self.concrete, h, noise);
        let beta = self.likelihood.beta_min + m32::softplus(raw_beta);
        Cover { h, noise, alpha, rgb: [r, g, b].map(m32::logistic), raw_beta, beta }
    }

    /// A pixel that the field renders as `rgb`.
    pub(super) fn cost(&self, cover: &Cover, rgb: [f32; 3], truth: [f32; 3]) -> Cost {
        let Unlikely { loss, rgb_bar, beta_bar } =
            likelihood::pixel(&self.likelihood, cover.over(rgb), truth, cover.beta);
        Cost { loss: loss + self.lambda_alpha * cover.alpha, over_bar: rgb_bar, beta_bar }
    }

    /// Derivative of `factor` times that with respect to the raw outputs.
    pub(super) fn raw_bar(&self, cover: &Cover, rgb: [f32; 3], truth: [f32; 3], factor: f32) -> [f32; OUTPUTS] {
        let Cost { over_bar, beta_bar, .. } = self.cost(cover, rgb, truth);
        let alpha_bar = self.lambda_alpha + (0..3).map(|c| over_bar[c] * (cover.rgb[c] - rgb[c])).sum::<f32>();
        let [_, slope, _] = opacity(self.concrete, cover.h, cover.noise);
        let colour = |c: usize| factor * over_bar[c] * cover.alpha * cover.rgb[c] * (1.0 - cover.rgb[c]);
        let beta = factor * beta_bar * m32::logistic(cover.raw_beta);
        [factor * alpha_bar * slope, colour(0), colour(1), colour(2), beta]
    }
}

/// `a(h)`, `a'(h)`, `a''(h)`: the opacity of a pixel and its derivatives with respect to the raw one.
pub(super) fn opacity(concrete: BinaryConcrete, h: f32, noise: f32) -> [f32; 3] {
    let odds = ln_odds(h);
    let alpha = concrete.sample(odds, noise);
    let (outer, inner) = (concrete.sample_derivative(odds, noise), ln_odds_derivative(h));
    let outer2 = outer * (1.0 - 2.0 * alpha) / concrete.temperature;
    // logistic' / softplus - (logistic / softplus)^2; far below 0 both tend to 1, and their difference to -e^h / 2.
    let inner2 = if h < -8.0 {
        -0.5 * m32::exp(h)
    } else {
        m32::logistic(h) * m32::logistic(-h) / m32::softplus(h) - inner * inner
    };
    [alpha, outer * inner, outer2 * inner * inner + outer * inner2]
}

#[cfg(test)]
mod tests {
    use super::super::config::{AppearanceKind, FieldKind, OccluderKind, WildConfig};
    use super::super::twin;
    use super::*;
    use losses::concrete::noise;
    use proptest::prelude::*;

    fn judge(kappa: f32) -> CoverLoss {
        CoverLoss {
            concrete: BinaryConcrete { temperature: kappa },
            likelihood: likelihood::likelihood(&WildConfig {
                beta_min: 0.03,
                ..WildConfig::new(FieldKind::Ngp, AppearanceKind::None, OccluderKind::Filter)
            }),
            lambda_alpha: 0.2,
        }
    }

    #[test]
    fn opacity_and_its_derivatives_match_differences() {
        for kappa in [0.1, 0.7, 1.0] {
            for noise in [-3.0, 0.0, 1.5] {
                for h in [-30.0, -14.0, -8.1, -7.9, -2.0, -0.1, 0.0, 0.7, 3.0, 9.0] {
                    let a = |h: f64| twin::alpha(h, kappa, noise);
                    let step = 1e-3;
                    let (low, mid, high) = (a(h - step), a(h), a(h + step));
                    let concrete = BinaryConcrete { temperature: kappa as f32 };
                    let [alpha, slope, curvature] = opacity(concrete, h as f32, noise as f32).map(f64::from);
                    // Digits of h, and of differences: h^2 of the fourth derivative.
                    let scale = mid.min(1.0 - mid) / (kappa * kappa);
                    assert!((alpha - mid).abs() < 1e-5 * scale + 1e-7, "{alpha} {mid} at {h} {noise} {kappa}");
                    let want = (high - low) / (2.0 * step);
                    assert!(
                        (slope - want).abs() < 1e-4 * scale / kappa + 1e-7,
                        "{slope} {want} at {h} {noise} {kappa}"
                    );
                    let want = (high - 2.0 * mid + low) / (step * step);
                    let bound = 1e-3 * scale / kappa + 1e-6;
                    assert!((curvature - want).abs() < bound, "{curvature} {want} at {h} {noise} {kappa}");
                }
            }
        }
    }

    proptest! {
        #![proptest_config(testkit::property::cases(256))]

        #[test]
        fn the_composite_lies_between_both_colours(
            raw in prop::array::uniform5(-60.0_f32..60.0),
            rgb in prop::array::uniform3(-1.0_f32..2.0),
            u in 0.0_f32..1.0,
            kappa in 0.05_f32..2.0,
        ) {
            let cover = judge(kappa).cover(raw, noise(u));
            prop_assert!((0.0..=1.0).contains(&cover.alpha) && cover.beta >= 0.03 && cover.beta.is_finite());
            for c in 0..3 {
                let over = cover.over(rgb)[c];
                let (low, high) = (rgb[c].min(cover.rgb[c]), rgb[c].max(cover.rgb[c]));
                prop_assert!(low - 1e-6 <= over && over <= high + 1e-6, "{low} {over} {high}");
            }
        }

        #[test]
        fn opacities_of_usual_outputs_are_never_quite_0_or_1(h in -15.0_f32..15.0, u in 0.001_f32..0.999) {
            let cover = judge(1.0).cover([h, 0.0, 0.0, 0.0, 0.0], noise(u));
            prop_assert!(0.0 < cover.alpha && cover.alpha < 1.0);
        }
    }
}
