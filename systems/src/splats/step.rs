//! One training step: draw the cloud as one photo's camera sees it, compare, and take the gradient back.

use super::photo::Photo;
use float_core::Simd;
use losses::dssim::{Dssim, Pair, Target};
use rayon::prelude::*;
use splat_core::{
    DrawStats, Gaussians, ProjectedGaussian, ProjectedGradient, Projection, Raster, RasterSettings, SplatError, View,
};
use std::time::Instant;

/// Pixels that one task takes.
const PIXELS: usize = 1 << 13;
/// Features that training composites: colour.
const COLOUR: usize = 3;

/// Parts of a step that are timed.
pub(super) const PARTS: [&str; 6] =
    ["photo", "projection", "rasterising", "loss", "rasterising, backwards", "projection, backwards"];

/// Buffers of a step.
#[derive(Debug)]
pub(super) struct Pass {
    projection: Projection,
    raster: Raster<COLOUR>,
    planes: Vec<f32>,
    bars: Vec<f32>,
    records: Vec<ProjectedGradient<COLOUR>>,
    loss: Dssim,
}

/// What the cloud is drawn with.
#[derive(Clone, Copy)]
pub(super) struct Lens<'a> {
    pub(super) simd: Simd,
    pub(super) view: &'a View,
    pub(super) rules: &'a RasterSettings,
    pub(super) degree: usize,
    pub(super) background: [f32; 3],
    /// Share of `1 - SSIM`.
    pub(super) dssim: f32,
}

/// What came out, besides the gradient.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Outcome {
    pub(super) loss: f64,
    pub(super) mse: f64,
    pub(super) drawn: DrawStats,
}

impl Pass {
    pub(super) fn new(simd: Simd) -> Self {
        Self {
            projection: Projection::default(),
            raster: Raster::default(),
            planes: Vec::new(),
            bars: Vec::new(),
            records: Vec::new(),
            loss: Dssim::new(simd),
        }
    }

    /// Loss of a photo and its gradient, written to `grad`.
    pub(super) fn run(
        &mut self,
        cloud: &Gaussians,
        lens: Lens<'_>,
        photo: &Photo,
        grad: &mut Gaussians,
        seconds: &mut [f64; PARTS.len()],
    ) -> Result<Outcome, PassError> {
        let Lens { simd, view, rules, degree, background, dssim } = lens;
        let Self { projection, raster, planes, bars, records, loss } = self;
        let mut clock = Clock { at: Instant::now(), seconds };
        projection.project(simd, cloud, view, rules, degree)?;
        clock.lap(1);
        let drawn = raster.draw(simd, &projection.gaussians, &projection.rgb, view.size, rules)?;
        let pixels = view.size[0] * view.size[1];
        planes.resize((COLOUR + 1) * pixels, 0.0);
        raster.planes(planes)?;
        let (colour, trans) = planes.split_at_mut(COLOUR * pixels);
        for (plane, back) in colour.chunks_exact_mut(pixels).zip(background) {
            plane.par_chunks_mut(PIXELS).zip(trans.par_chunks(PIXELS)).for_each(|(plane, trans)| {
                for (c, t) in plane.iter_mut().zip(trans) {
                    *c += t * back;
                }
            });
        }
        clock.lap(2);
        bars.resize((COLOUR + 1) * pixels, 0.0);
        let (colour_bar, trans_bar) = bars.split_at_mut(COLOUR * pixels);
        colour_bar.fill(0.0);
        let pair = Pair {
            channels: COLOUR,
            height: view.size[1],
            width: view.size[0],
            x: colour,
            target: Target::Planes(&photo.truth),
            weights: (!photo.weight.is_empty()).then_some(&photo.weight),
        };
        let value = loss.l1_dssim_backward(&pair, dssim, 1.0, colour_bar)?;
        let [r, g, b] = [0, 1, 2].map(|c| &colour_bar[c * pixels..][..pixels]);
        trans_bar.par_iter_mut().with_min_len(PIXELS).enumerate().for_each(|(i, bar)| {
            *bar = r[i] * background[0] + g[i] * background[1] + b[i] * background[2];
        });
        clock.lap(3);
        raster.backward(simd, &projection.gaussians, &projection.rgb, rules, bars, records)?;
        clock.lap(4);
        projection.backward(simd, cloud, view, rules, degree, records, None, grad)?;
        clock.lap(5);
        Ok(Outcome { loss: value.loss, mse: mse(&pair), drawn })
    }

    /// The Gaussians that the last photo saw, and what it says of them.
    pub(super) fn seen(&self) -> (&[ProjectedGaussian], &[ProjectedGradient<COLOUR>]) {
        (&self.projection.gaussians, &self.records)
    }
}

/// Mean squared error over every eighth row that counts: for the progress line, not for learning.
fn mse(pair: &Pair<'_>) -> f64 {
    let Target::Planes(truth) = pair.target else { return 0.0 };
    let n = pair.width.max(1);
    let (mut sum, mut count) = (0.0, 0.0);
    for (row, (x, y)) in pair.x.chunks_exact(n).zip(truth.chunks_exact(n)).enumerate().step_by(8) {
        for (column, (x, y)) in x.iter().zip(y).enumerate() {
            let weight = pair.weights.map_or(1.0, |w| w[row % pair.height * n + column]);
            sum += f64::from(weight * (x - y) * (x - y));
            count += f64::from(weight);
        }
    }
    if count > 0.0 { sum / count } else { 0.0 }
}

/// A pass that could not be made.
#[derive(Debug, thiserror::Error)]
pub(super) enum PassError {
    /// What the rasteriser refuses.
    #[error(transparent)]
    Splat(#[from] SplatError),
    /// What the loss refuses.
    #[error(transparent)]
    Loss(#[from] losses::LossError),
}

/// Seconds of each part.
struct Clock<'a> {
    at: Instant,
    seconds: &'a mut [f64; PARTS.len()],
}

impl Clock<'_> {
    fn lap(&mut self, part: usize) {
        let now = Instant::now();
        self.seconds[part] += (now - self.at).as_secs_f64();
        self.at = now;
    }
}
