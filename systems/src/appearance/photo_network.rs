//! The network that makes a code of a photo: convolutions, and a linear map of the photo's tones.
//!
//! The convolutions end in the mean of each channel and learn slowly what a factor and a summand do to a photo. So a code
//! is theirs plus a linear map of *tones*, a few numbers for each channel that a change of colours moves evenly: the mean over
//! the photo, tilted towards bright (`t > 0`) or dark (`t < 0`) pixels,
//!
//! ```text
//! tone = sum(a exp(t x) x) / sum(a exp(t x))        x in [-1, 1], a the pixel's opacity
//! ```
//!
//! Without tilts this is the encoder alone, as published.

use field_core::conv::{Encoder, Size, Workspace};
use field_core::rng::Rng;
use float_core::Simd;

/// Factor of tones: those of photos are a few tenths apart, other inputs of networks a few ones.
const GAIN: f32 = 3.0;

/// Pictures have the size that [`Encoder`] needs: settings and photos are checked before.
const FITS: &str = "the picture is at least as large as the encoder needs";

/// Convolutions and tilts. Parameters: those of the convolutions, then `[code][tilts * 3]`.
pub(crate) struct PhotoNetwork {
    encoder: Encoder,
    tilts: Vec<f32>,
    simd: Simd,
}

/// A picture to be encoded.
#[derive(Clone, Copy)]
pub(crate) struct Picture<'a> {
    /// `[3][height][width]`, `2 srgb - 1`.
    pub(crate) x: &'a [f32],
    /// `[height][width]`, opacity.
    pub(crate) alpha: &'a [f32],
    pub(crate) size: Size,
}

/// Activations that the backward pass needs.
#[derive(Default)]
pub(crate) struct ForwardMemory {
    acts: Vec<f32>,
    tones: Vec<f32>,
    work: Workspace,
}

impl ForwardMemory {
    /// Numbers held.
    pub(crate) fn len(&self) -> usize {
        self.acts.capacity() + self.tones.capacity()
    }
}

impl PhotoNetwork {
    pub(crate) fn new(encoder: Encoder, tilts: &[f32]) -> Self {
        Self { encoder, tilts: tilts.to_vec(), simd: Simd::best() }
    }

    /// Numbers of a code.
    pub(crate) fn code(&self) -> usize {
        self.encoder.code()
    }

    /// The smallest side of a picture.
    pub(crate) fn min_side(&self) -> usize {
        self.encoder.min_side()
    }

    fn tones(&self) -> usize {
        3 * self.tilts.len()
    }

    pub(crate) fn param_count(&self) -> usize {
        self.encoder.param_count() + self.code() * self.tones()
    }

    /// Random convolutions; weights of tones are 0.
    pub(crate) fn init(&self, rng: Rng, params: &mut [f32]) {
        let (network, weights) = params.split_at_mut(self.encoder.param_count());
        self.encoder.init(rng, network);
        weights.fill(0.0);
    }

    /// Let codes begin as zeros: their convolutions say nothing yet.
    pub(crate) fn begin_at_zero(&self, params: &mut [f32]) {
        let last = self.encoder.param_count();
        let channels = self.encoder.config().channels.last().map_or(0, |channels| channels + 1);
        params[last - self.code() * channels..last].fill(0.0);
    }

    /// The code of a picture, written.
    pub(crate) fn forward(
        &self,
        params: &[f32],
        picture: Picture<'_>,
        memory: &mut ForwardMemory,
        code: &mut Vec<f32>,
    ) {
        let (network, weights) = params.split_at(self.encoder.param_count());
        let ForwardMemory { acts, tones, work } = memory;
        acts.resize(self.encoder.activations_len(picture.size).expect(FITS), 0.0);
        code.resize(self.code(), 0.0);
        self.encoder.forward(self.simd, network, picture.x, picture.size, acts, code, work).expect(FITS);
        tones.clear();
        for x in picture.x.chunks_exact(picture.size.pixels()) {
            tones.extend(self.tilts.iter().map(|&tilt| tone(x, picture.alpha, tilt)));
        }
        for (code, weights) in code.iter_mut().zip(weights.chunks_exact(tones.len().max(1))) {
            *code += weights.iter().zip(&tones[..]).map(|(w, tone)| w * tone).sum::<f32>();
        }
    }

    /// Gradient of [`PhotoNetwork::forward`]: adds into `grad`, and into `x_bar` where it is wanted.
    pub(crate) fn backward(
        &self,
        params: &[f32],
        picture: Picture<'_>,
        memory: &mut ForwardMemory,
        code_bar: &[f32],
        grad: &mut [f32],
        mut x_bar: Option<&mut [f32]>,
    ) {
        let (network, weights) = params.split_at(self.encoder.param_count());
        let (network_grad, weights_grad) = grad.split_at_mut(network.len());
        let ForwardMemory { acts, tones, work } = memory;
        let (x, size, bars) = (picture.x, picture.size, x_bar.as_deref_mut());
        self.encoder.backward(self.simd, network, x, size, acts, code_bar, network_grad, bars, work).expect(FITS);
        let count = tones.len().max(1);
        for (bar, grad) in code_bar.iter().zip(weights_grad.chunks_exact_mut(count)) {
            grad.iter_mut().zip(&tones[..]).for_each(|(grad, tone)| *grad += bar * tone);
        }
        let Some(x_bar) = x_bar else { return };
        let planes = x.chunks_exact(size.pixels()).zip(x_bar.chunks_exact_mut(size.pixels()));
        for (channel, (x, x_bar)) in planes.enumerate() {
            for (k, &tilt) in self.tilts.iter().enumerate() {
                let row = channel * self.tilts.len() + k;
                let bar: f32 = code_bar.iter().zip(weights.chunks_exact(count)).map(|(bar, w)| bar * w[row]).sum();
                Tilted::new(x, picture.alpha, tilt).backward(x, picture.alpha, GAIN * bar, x_bar);
            }
        }
    }
}

/// The tone of a channel `x` of a photo, -1 to 1, whose pixels have opacities `alpha`: how bright it is at a tilt, about 0.
pub(crate) fn tone(x: &[f32], alpha: &[f32], tilt: f32) -> f32 {
    GAIN * (Tilted::new(x, alpha, tilt).mean - usual(tilt))
}

/// The tone of a photo whose colours are spread evenly.
fn usual(tilt: f32) -> f32 {
    0.6 * (0.2 * tilt).tanh()
}

/// A tilted mean.
struct Tilted {
    tilt: f32,
    /// One over the sum of weights; 0 where nothing has any.
    per_sum: f32,
    mean: f32,
}

impl Tilted {
    fn new(x: &[f32], alpha: &[f32], tilt: f32) -> Self {
        let (mut sum, mut of_x) = (0.0, 0.0);
        for (x, alpha) in x.iter().zip(alpha) {
            let weight = alpha * (tilt * x).exp();
            sum += weight;
            of_x += weight * x;
        }
        let per_sum = if sum > 0.0 { 1.0 / sum } else { 0.0 };
        Self { tilt, per_sum, mean: of_x * per_sum }
    }

    fn backward(&self, x: &[f32], alpha: &[f32], bar: f32, x_bar: &mut [f32]) {
        for ((x_bar, x), alpha) in x_bar.iter_mut().zip(x).zip(alpha) {
            let share = alpha * (self.tilt * x).exp() * self.per_sum;
            *x_bar += bar * share * (1.0 + self.tilt * (x - self.mean));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use field_core::conv::EncoderConfig;

    #[test]
    fn tones_lie_between_the_darkest_and_the_brightest_pixel() {
        let (x, alpha) = ([-0.9, -0.2, 0.3, 0.8, 1.0], [1.0, 0.5, 1.0, 1.0, 0.0]);
        let tone = |tilt| Tilted::new(&x, &alpha, tilt).mean;
        assert!((tone(0.0) - (-0.9 - 0.1 + 0.3 + 0.8) / 3.5).abs() < 1e-6);
        assert!(-0.9 <= tone(-50.0) && tone(-50.0) < -0.89 && tone(-50.0) < tone(-1.0) && tone(-1.0) < tone(1.0));
        // What is transparent does not count, however bright.
        assert!(tone(50.0) > 0.79 && tone(50.0) <= 0.8);
        // A photo without anything in it has none.
        assert_eq!(Tilted::new(&x, &[0.0; 5], 3.0).mean, 0.0);
        // A summand moves all of them by as much.
        let moved: Vec<f32> = x.iter().map(|x| x - 0.1).collect();
        assert!((Tilted::new(&moved, &alpha, 7.0).mean - tone(7.0) + 0.1).abs() < 1e-6);
    }

    #[test]
    fn codes_and_their_gradients_are_those_of_differences() {
        let encoder = Encoder::new(EncoderConfig::new(3, vec![3, 4], 2)).unwrap();
        let network = PhotoNetwork::new(encoder, &[-4.0, 0.0, 6.0]);
        let rng = Rng::new(5, 6);
        let mut params = vec![0.0; network.param_count()];
        network.init(rng, &mut params);
        rng.fill_uniform(2000, &mut params[network.encoder.param_count()..]);
        let size = Size::one(5, 6);
        let mut x = vec![0.0; 90];
        rng.fill_uniform(0, &mut x);
        x.iter_mut().for_each(|x| *x = 2.0 * *x - 1.0);
        let mut alpha = vec![0.0; 30];
        rng.fill_uniform(1000, &mut alpha);
        let bar = [0.7, -1.3];
        let value = |params: &[f32], x: &[f32]| {
            let mut code = Vec::new();
            network.forward(params, Picture { x, alpha: &alpha, size }, &mut ForwardMemory::default(), &mut code);
            code.iter().zip(bar).map(|(c, b)| f64::from(c * b)).sum::<f64>()
        };
        let (mut memory, mut code) = (ForwardMemory::default(), Vec::new());
        let picture = Picture { x: &x, alpha: &alpha, size };
        network.forward(&params, picture, &mut memory, &mut code);
        let (mut grad, mut x_bar) = (vec![0.0; params.len()], vec![0.0; x.len()]);
        network.backward(&params, picture, &mut memory, &bar, &mut grad, Some(&mut x_bar));
        let h = 1e-2;
        // The rows of tones, which are linear; the encoder has tests of its own.
        for i in params.len() - 18..params.len() {
            let at = |by: f32| {
                let mut params = params.clone();
                params[i] += by;
                value(&params, &x)
            };
            let derivative = (at(h) - at(-h)) / f64::from(2.0 * h);
            assert!((derivative - f64::from(grad[i])).abs() < 1e-3, "parameter {i}: {derivative} {}", grad[i]);
        }
        for i in 0..x.len() {
            let at = |by: f32| {
                let mut x = x.clone();
                x[i] += by;
                value(&params, &x)
            };
            let derivative = (at(1e-3) - at(-1e-3)) / 2e-3;
            assert!((derivative - f64::from(x_bar[i])).abs() < 3e-3, "pixel {i}: {derivative} {}", x_bar[i]);
        }
    }
}
