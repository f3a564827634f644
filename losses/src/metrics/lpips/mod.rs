//! LPIPS: perceptual distance by a pretrained network (SqueezeNet 1.1 trunk, LPIPS v0.1).
//!
//! The weights come from the caller, by name, so this crate reads no file:
//!
//! | tensor | shape |
//! | --- | --- |
//! | `features.0.weight`, `.bias` | `[64, 3, 3, 3]`, `[64]` |
//! | `features.{n}.squeeze.weight`, `.bias`, n = 3 4 6 7 9 10 11 12 | `[s, c, 1, 1]`, `[s]` |
//! | `features.{n}.expand1x1.weight`, `.bias` | `[e, s, 1, 1]`, `[e]` |
//! | `features.{n}.expand3x3.weight`, `.bias` | `[e, s, 3, 3]`, `[e]` |
//! | `lin{i}.weight`, i = 0 .. 6 | `[channels of tap i]` |
//! | `scaling.shift`, `scaling.scale` | `[3]` |
//!
//! Widths are those of the tensors, so any file of this naming works as long as its shapes fit each other. Without
//! weights there is no LPIPS: print `n/a`, never a substitute. Numbers of other backbones (AlexNet, VGG) are on other
//! scales.

mod conv;
mod trunk;
mod weights;

pub use weights::{LpipsError, LpipsTensor};

use super::{
    MetricError,
    image::{Image, check_pair, check_side},
};
use alloc::{vec, vec::Vec};
use conv::Features;
use float_core::{Simd, m64};
use trunk::{Step, pool};

/// Smallest side of an image, pixels: below, the last pooling has nothing to pool.
pub const LPIPS_MIN_SIDE: usize = 17;

/// Added to the length of a feature vector before dividing by it.
const NORM_EPS: f64 = 1e-10;

/// The network and its weights: 2.9 MB for SqueezeNet.
#[derive(Clone, Debug)]
pub struct Lpips {
    simd: Simd,
    shift: [f32; 3],
    scale: [f32; 3],
    steps: Vec<Step>,
}

impl Lpips {
    /// Take the weights, tensor by tensor, from `lookup(name)`.
    ///
    /// # Errors
    /// [`LpipsError`] naming the tensor that is missing, misshapen, or holds a value that cannot work.
    pub fn new<'w>(lookup: impl FnMut(&str) -> Option<LpipsTensor<'w>>) -> Result<Self, LpipsError> {
        let (shift, scale, steps) = trunk::load(&mut weights::Lookup::new(lookup))?;
        Ok(Self { simd: Simd::best(), shift, scale, steps })
    }

    /// The same network at another SIMD level. Levels differ by rounding only, some 1e-7.
    #[must_use]
    pub fn with_simd(mut self, simd: Simd) -> Self {
        self.simd = simd;
        self
    }

    /// Distance of two RGB images: 0 for equal ones, some 0.05 for a faint difference, 0.5 and more for a plain one.
    ///
    /// # Errors
    /// As [`Lpips::layers`].
    pub fn distance(&self, a: &Image<'_>, b: &Image<'_>) -> Result<f64, MetricError> {
        Ok(self.layers(a, b)?.iter().sum())
    }

    /// Share of each of the seven taps in the distance; it is their sum.
    ///
    /// At each tap the feature vector of every pixel is divided by its length, the squared differences of the two images
    /// are weighted by `lin{i}` and summed over channels, and averaged over pixels.
    ///
    /// # Errors
    /// [`MetricError::Mismatch`]; [`MetricError::Channels`] unless there are 3; [`MetricError::TooSmall`] below
    /// [`LPIPS_MIN_SIDE`]; [`MetricError::Overflow`] for values some 1e30 outside `[0, 1]`.
    ///
    /// # Source
    /// Zhang et al., "The unreasonable effectiveness of deep features as a perceptual metric", 2018, eq. 1.
    pub fn layers(&self, a: &Image<'_>, b: &Image<'_>) -> Result<Vec<f64>, MetricError> {
        check_pair("LPIPS", a, b)?;
        if a.channels() != 3 {
            return Err(MetricError::Channels { want: 3, got: a.channels() });
        }
        check_side("LPIPS", a, LPIPS_MIN_SIDE)?;
        let (mut a, mut b) = (self.normalised(a), self.normalised(b));
        let mut taps = Vec::new();
        for step in &self.steps {
            match step {
                Step::Conv(conv) => (a, b) = (conv.run(self.simd, &a), conv.run(self.simd, &b)),
                Step::Fire(fire) => (a, b) = (fire.run(self.simd, &a), fire.run(self.simd, &b)),
                Step::Pool => (a, b) = (pool(&a), pool(&b)),
                Step::Tap(lin) => taps.push(tap_distance(&a, &b, lin)),
            }
        }
        if taps.iter().all(|tap| tap.is_finite()) { Ok(taps) } else { Err(MetricError::Overflow { metric: "LPIPS" }) }
    }

    /// `(2 x - 1 - shift) / scale`, channel by channel.
    fn normalised(&self, image: &Image<'_>) -> Features {
        let pixels = image.width() * image.height();
        let mut data = Vec::with_capacity(3 * pixels);
        for c in 0..3 {
            let (shift, scale) = (f64::from(self.shift[c]), f64::from(self.scale[c]));
            data.extend((0..pixels).map(|i| ((2.0 * image.value(3 * i + c) - 1.0 - shift) / scale) as f32));
        }
        Features { channels: 3, width: image.width(), height: image.height(), data }
    }
}

/// Mean over pixels of `sum_c lin[c] (a[c] / |a| - b[c] / |b|)^2`.
fn tap_distance(a: &Features, b: &Features, lin: &[f32]) -> f64 {
    let pixels = a.width * a.height;
    let scale_a = inverse_norms(a);
    let scale_b = inverse_norms(b);
    let mut distance = vec![0.0_f64; pixels];
    for ((&lin, a), b) in lin.iter().zip(a.data.chunks_exact(pixels)).zip(b.data.chunks_exact(pixels)) {
        let scales = scale_a.iter().zip(&scale_b);
        for (((out, &a), &b), (&sa, &sb)) in distance.iter_mut().zip(a).zip(b).zip(scales) {
            let d = f64::from(a) * sa - f64::from(b) * sb;
            *out += f64::from(lin) * d * d;
        }
    }
    distance.iter().sum::<f64>() / pixels as f64
}

/// `1 / (|f| + eps)` of each pixel's feature vector.
fn inverse_norms(f: &Features) -> Vec<f64> {
    let pixels = f.width * f.height;
    let mut squares = vec![0.0_f64; pixels];
    for plane in f.data.chunks_exact(pixels) {
        for (s, &x) in squares.iter_mut().zip(plane) {
            *s += f64::from(x) * f64::from(x);
        }
    }
    squares.iter().map(|&s| 1.0 / (m64::sqrt(s) + NORM_EPS)).collect()
}
