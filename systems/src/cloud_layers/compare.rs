//! One of the pictures of two clouds, compared with the photo.

use super::composite::{Composed, ComposedBar};
use super::seen::{CostBars, Seen};
use crate::views::TargetPicture;
use float_core::Simd;
use losses::LossError;
use losses::dssim::{Dssim, Pair, Target};

/// A pixel is most likely of a cloud above this share of it.
const LIKELY: f32 = 0.51;

/// One of the pictures.
#[derive(Clone, Copy)]
pub(super) enum Which {
    /// What is seen.
    Both,
    /// The cloud in front.
    Front,
    /// The one behind, as bright as the front leaves it.
    Behind,
    /// The one behind, as bright as it is.
    Unlit,
}

impl Which {
    pub(super) fn of(self, pixel: &Composed) -> [f32; 3] {
        match self {
            Self::Both => pixel.colour,
            Self::Front => pixel.front,
            Self::Behind => pixel.behind,
            // At least one half.
            Self::Unlit => pixel.behind.map(|c| c / pixel.brightness),
        }
    }

    /// Add the gradient `bar` of channel `c` of a pixel.
    fn add(self, seen: &Composed, pixel: &mut ComposedBar, c: usize, bar: f32) {
        match self {
            Self::Both => pixel.colour[c] += bar,
            Self::Front => pixel.front[c] += bar,
            Self::Behind => pixel.behind[c] += bar,
            // What the brightness has of that is taken back.
            Self::Unlit => {
                pixel.behind[c] += bar / seen.brightness;
                pixel.brightness -= bar * seen.behind[c] / (seen.brightness * seen.brightness);
            }
        }
    }

    /// Add the gradients `planes` `[3][pixels]` of the picture.
    pub(super) fn pull_back(self, planes: &[f32], seen: &Seen<'_>, bars: &mut CostBars) {
        for (c, plane) in planes.chunks_exact(seen.composed.len().max(1)).enumerate() {
            let pixels = bars.composed.iter_mut().zip(seen.composed).zip(plane);
            pixels.for_each(|((pixel, seen), bar)| self.add(seen, pixel, c, *bar));
        }
    }
}

/// Which pixels count.
#[derive(Clone, Copy)]
pub(super) enum Counted {
    All,
    /// Those that are most likely the cloud's.
    Likely,
}

/// Compares pictures with photos, with its buffers.
pub(super) struct Comparison {
    dssim: Dssim,
    planes: Vec<f32>,
    planes_bar: Vec<f32>,
    weights: Vec<f32>,
}

impl Comparison {
    pub(super) fn new(simd: Simd) -> Self {
        Self { dssim: Dssim::new(simd), planes: Vec::new(), planes_bar: Vec::new(), weights: Vec::new() }
    }

    /// `weights[0] mean g |x - y| + weights[1] mean g (1 - SSIM)` of one of the pictures; of those pixels only that
    /// are `counted`.
    pub(super) fn add(
        &mut self,
        which: Which,
        seen: &Seen<'_>,
        target: &TargetPicture<'_>,
        counted: Counted,
        weights: [f32; 2],
        bars: &mut CostBars,
    ) -> Result<f64, LossError> {
        let (size, n) = (seen.behind.size, seen.composed.len());
        let total = weights[0] + weights[1];
        if total <= 0.0 || n == 0 {
            return Ok(0.0);
        }
        self.planes.resize(3 * n, 0.0);
        for (c, plane) in self.planes.chunks_exact_mut(n).enumerate() {
            plane.iter_mut().zip(seen.composed).for_each(|(x, pixel)| *x = which.of(pixel)[c]);
        }
        self.planes_bar.clear();
        self.planes_bar.resize(3 * n, 0.0);
        let weights_of_pixels = match counted {
            Counted::All => target.weights,
            Counted::Likely => Some(likely_weights(which, seen, target, &mut self.weights)),
        };
        let pair = Pair {
            channels: 3,
            height: size[1],
            width: size[0],
            x: &self.planes,
            target: Target::Planes(target.colour),
            weights: weights_of_pixels,
        };
        let (lambda, bar) = (weights[1] / total, f64::from(total));
        let loss = self.dssim.l1_dssim_backward(&pair, lambda, bar, &mut self.planes_bar)?.loss;
        which.pull_back(&self.planes_bar, seen, bars);
        Ok(bar * loss)
    }

    /// `[pixels]`, how much each counts of what one cloud alone costs.
    pub(super) fn likely(&mut self, which: Which, seen: &Seen<'_>, target: &TargetPicture<'_>) -> &[f32] {
        likely_weights(which, seen, target, &mut self.weights)
    }
}

/// `[pixels]`, how much each counts of what one cloud alone costs, written over `out`.
fn likely_weights<'a>(which: Which, seen: &Seen<'_>, target: &TargetPicture<'_>, out: &'a mut Vec<f32>) -> &'a [f32] {
    let weight = |(i, pixel): (usize, &Composed)| likely(which, pixel) * target.weights.map_or(1.0, |w| w[i]);
    out.clear();
    out.extend(seen.composed.iter().enumerate().map(weight));
    out
}

/// How much a pixel counts of what one cloud alone costs: 1 where it is most likely the cloud's. Not its share: steps of Adam are as long
/// for a hundredth of a gradient.
fn likely(which: Which, pixel: &Composed) -> f32 {
    let own = match which {
        Which::Both => 1.0,
        Which::Front => pixel.share,
        Which::Behind | Which::Unlit => 1.0 - pixel.share,
    };
    f32::from(u8::from(own > LIKELY))
}
