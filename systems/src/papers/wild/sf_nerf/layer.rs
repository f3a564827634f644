//! The occluder before a pixel, composited over the field, and the loss of the pixel:
//!
//! ```text
//! Y' = alpha C_t + (1 - alpha) C
//! L  = |Y' - Y|^2 / (2 beta^2) + ln beta + lambda_alpha alpha
//! ```
//!
//! Opacities are samples of a Binary Concrete distribution: `alpha = a(h) = logistic((ln softplus(h) + noise) / kappa)`.

use super::filter::OUTPUTS;
use crate::occluders::likelihood::{self, PixelLikelihood};
use float_core::m32;
use losses::concrete::{BinaryConcrete, ln_odds, ln_odds_derivative};
use losses::uncertainty::Likelihood;

/// The occluder before a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Layer {
    /// `h`, its noise, and `alpha`.
    h: f32,
    pub(super) noise: f32,
    pub(super) alpha: f32,
    /// `C_t`
    rgb: [f32; 3],
    /// Raw uncertainty, and `beta`.
    raw_beta: f32,
    beta: f32,
}

/// The loss of a pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct LayerLoss {
    pub(super) concrete: BinaryConcrete,
    pub(super) likelihood: Likelihood,
    /// Factor of the opacity.
    pub(super) lambda_alpha: f32,
}

/// `L`, and its derivatives with respect to `Y'` and `beta`.
pub(super) struct Cost {
    pub(super) loss: f32,
    pub(super) over_bar: [f32; 3],
    beta_bar: f32,
}

impl Layer {
    /// `Y' = alpha C_t + (1 - alpha) C`
    fn over(&self, rgb: [f32; 3]) -> [f32; 3] {
        [0, 1, 2].map(|c| rgb[c] + self.alpha * (self.rgb[c] - rgb[c]))
    }
}

impl LayerLoss {
    /// The occluder from the filter's raw outputs; `noise` is 0 outside of training.
    pub(super) fn layer(&self, raw: [f32; OUTPUTS], noise: f32) -> Layer {
        let [h, r, g, b, raw_beta] = raw;
        let [alpha, ..] = opacity(self.concrete, h, noise);
        let beta = self.likelihood.beta_min + m32::softplus(raw_beta);
        Layer { h, noise, alpha, rgb: [r, g, b].map(m32::logistic), raw_beta, beta }
    }

    /// `L` of a pixel that the field renders as `rgb`.
    pub(super) fn cost(&self, layer: &Layer, rgb: [f32; 3], truth: [f32; 3]) -> Cost {
        let PixelLikelihood { loss, rgb_bar, beta_bar } =
            likelihood::pixel(&self.likelihood, layer.over(rgb), truth, layer.beta);
        Cost { loss: loss + self.lambda_alpha * layer.alpha, over_bar: rgb_bar, beta_bar }
    }

    /// Derivative of `factor` times `L` with respect to the raw outputs.
    pub(super) fn raw_bar(&self, layer: &Layer, rgb: [f32; 3], truth: [f32; 3], factor: f32) -> [f32; OUTPUTS] {
        let Cost { over_bar, beta_bar, .. } = self.cost(layer, rgb, truth);
        let alpha_bar = self.lambda_alpha + (0..3).map(|c| over_bar[c] * (layer.rgb[c] - rgb[c])).sum::<f32>();
        let [_, derivative, _] = opacity(self.concrete, layer.h, layer.noise);
        let colour = |c: usize| factor * over_bar[c] * layer.alpha * layer.rgb[c] * (1.0 - layer.rgb[c]);
        let beta = factor * beta_bar * m32::logistic(layer.raw_beta);
        [factor * alpha_bar * derivative, colour(0), colour(1), colour(2), beta]
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
    use super::super::twin;
    use super::*;
    use losses::concrete::noise;
    use proptest::prelude::*;

    fn loss(kappa: f32) -> LayerLoss {
        LayerLoss {
            concrete: BinaryConcrete { temperature: kappa },
            likelihood: likelihood::likelihood(0.03, 0.0),
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
                    let [alpha, first, second] = opacity(concrete, h as f32, noise as f32).map(f64::from);
                    // Digits of h, and of differences: h^2 of the fourth derivative.
                    let scale = mid.min(1.0 - mid) / (kappa * kappa);
                    assert!((alpha - mid).abs() < 1e-5 * scale + 1e-7, "{alpha} {mid} at {h} {noise} {kappa}");
                    let want = (high - low) / (2.0 * step);
                    assert!(
                        (first - want).abs() < 1e-4 * scale / kappa + 1e-7,
                        "{first} {want} at {h} {noise} {kappa}"
                    );
                    let want = (high - 2.0 * mid + low) / (step * step);
                    let bound = 1e-3 * scale / kappa + 1e-6;
                    assert!((second - want).abs() < bound, "{second} {want} at {h} {noise} {kappa}");
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
            let layer = loss(kappa).layer(raw, noise(u));
            prop_assert!((0.0..=1.0).contains(&layer.alpha) && layer.beta >= 0.03 && layer.beta.is_finite());
            for c in 0..3 {
                let over = layer.over(rgb)[c];
                let (low, high) = (rgb[c].min(layer.rgb[c]), rgb[c].max(layer.rgb[c]));
                prop_assert!(low - 1e-6 <= over && over <= high + 1e-6, "{low} {over} {high}");
            }
        }

        #[test]
        fn opacities_of_usual_outputs_are_never_quite_0_or_1(h in -15.0_f32..15.0, u in 0.001_f32..0.999) {
            let layer = loss(1.0).layer([h, 0.0, 0.0, 0.0, 0.0], noise(u));
            prop_assert!(0.0 < layer.alpha && layer.alpha < 1.0);
        }
    }
}
