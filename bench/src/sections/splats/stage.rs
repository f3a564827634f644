//! A picture, and a training step, from the public parts: what is timed.

use super::ground::Shot;
use crate::error::BenchError;
use float_core::Simd;
use losses::dssim::{Dssim, Pair, Target};
use optim::{Adam, AdamConfig};
use splat_core::{DrawStats, Gaussians, MAX_DEGREE, ProjectedGradient, Projection, Raster, RasterSettings};
use std::time::Instant;

/// Features composited: colour.
pub(super) const COLOUR: usize = 3;
/// Share of `1 - SSIM` in the loss.
pub(super) const DSSIM: f32 = 0.2;
/// Behind everything: white, as photos without alpha do not mind.
pub(super) const BACKGROUND: f32 = 1.0;

/// Parts of a step.
pub(super) const PARTS: [&str; 6] = [
    "projection",
    "drawing (sort, lists, tiles)",
    "loss (L1 + D-SSIM, with gradient)",
    "drawing, backwards",
    "projection, backwards",
    "optimiser (all parameters)",
];

/// Buffers of a picture and of a step.
pub(super) struct Stage {
    pub(super) simd: Simd,
    pub(super) projection: Projection,
    pub(super) raster: Raster<COLOUR>,
    /// `[4][rows][columns]`, colours on the background.
    pub(super) planes: Vec<f32>,
    /// Gradient of the loss with respect to `planes`.
    pub(super) bars: Vec<f32>,
    pub(super) records: Vec<ProjectedGradient<COLOUR>>,
    pub(super) grad: Gaussians,
    loss: Dssim,
    adam: Vec<Adam>,
}

impl Stage {
    pub(super) fn new(simd: Simd, cloud: &Gaussians) -> Self {
        let config = AdamConfig::DEFAULT.with_eps(1e-15);
        Self {
            simd,
            projection: Projection::default(),
            raster: Raster::default(),
            planes: Vec::new(),
            bars: Vec::new(),
            records: Vec::new(),
            grad: cloud.clone(),
            loss: Dssim::new(simd),
            adam: cloud.fields().iter().map(|(_, numbers)| Adam::new(numbers.len(), config)).collect(),
        }
    }

    /// A picture, into `planes`.
    pub(super) fn render(
        &mut self,
        cloud: &Gaussians,
        shot: &Shot,
        rules: &RasterSettings,
    ) -> Result<DrawStats, BenchError> {
        self.project(cloud, shot, rules)?;
        self.draw(shot, rules)
    }

    /// A step that moves nothing: the rates are 0, which is the same arithmetic, so that all repetitions have the same to do.
    /// Adds the time of each part.
    pub(super) fn step(
        &mut self,
        cloud: &mut Gaussians,
        shot: &Shot,
        rules: &RasterSettings,
        seconds: &mut [f64; PARTS.len()],
    ) -> Result<DrawStats, BenchError> {
        let mut at = Instant::now();
        let mut lap = |part: usize| {
            let now = Instant::now();
            seconds[part] += (now - at).as_secs_f64();
            at = now;
        };
        self.project(cloud, shot, rules)?;
        lap(0);
        let drawn = self.draw(shot, rules)?;
        lap(1);
        self.compare(shot)?;
        lap(2);
        self.draw_backward(rules)?;
        lap(3);
        self.project_backward(cloud, shot, rules)?;
        lap(4);
        for ((adam, (_, numbers)), (_, grad)) in
            self.adam.iter_mut().zip(cloud.fields_mut()).zip(self.grad.fields_mut())
        {
            let bad = adam.step(self.simd, 0.0, numbers, grad);
            if bad > 0 {
                return Err(BenchError::Part(format!("{bad} gradients of splats are not finite")));
            }
        }
        lap(5);
        Ok(drawn)
    }

    fn project(&mut self, cloud: &Gaussians, shot: &Shot, rules: &RasterSettings) -> Result<(), BenchError> {
        self.projection.project(self.simd, cloud, &shot.view, rules, MAX_DEGREE).map_err(BenchError::part)
    }

    fn draw(&mut self, shot: &Shot, rules: &RasterSettings) -> Result<DrawStats, BenchError> {
        let Self { simd, projection, raster, planes, .. } = self;
        let drawn = raster
            .draw(*simd, &projection.gaussians, &projection.rgb, shot.view.size, rules)
            .map_err(BenchError::part)?;
        let pixels = shot.view.size[0] * shot.view.size[1];
        planes.resize((COLOUR + 1) * pixels, 0.0);
        raster.planes(planes).map_err(BenchError::part)?;
        let (colour, trans) = planes.split_at_mut(COLOUR * pixels);
        for plane in colour.chunks_exact_mut(pixels) {
            plane.iter_mut().zip(&*trans).for_each(|(c, t)| *c += t * BACKGROUND);
        }
        Ok(drawn)
    }

    /// The loss; its gradient into `bars`.
    pub(super) fn compare(&mut self, shot: &Shot) -> Result<f64, BenchError> {
        let Self { planes, bars, loss, .. } = self;
        let pixels = shot.view.size[0] * shot.view.size[1];
        bars.resize(planes.len(), 0.0);
        bars.fill(0.0);
        let (colour_bar, trans_bar) = bars.split_at_mut(COLOUR * pixels);
        let pair = Pair {
            channels: COLOUR,
            height: shot.view.size[1],
            width: shot.view.size[0],
            x: &planes[..COLOUR * pixels],
            target: Target::Planes(&shot.truth),
            weights: None,
        };
        let value = loss.l1_dssim_backward(&pair, DSSIM, 1.0, colour_bar).map_err(BenchError::part)?;
        for bar in colour_bar.chunks_exact(pixels) {
            trans_bar.iter_mut().zip(bar).for_each(|(t, bar)| *t += bar * BACKGROUND);
        }
        Ok(value.loss)
    }

    /// `bars` to `records`.
    pub(super) fn draw_backward(&mut self, rules: &RasterSettings) -> Result<(), BenchError> {
        let Self { simd, projection, raster, bars, records, .. } = self;
        raster.backward(*simd, &projection.gaussians, &projection.rgb, rules, bars, records).map_err(BenchError::part)
    }

    /// `records` to `grad`.
    pub(super) fn project_backward(
        &mut self,
        cloud: &Gaussians,
        shot: &Shot,
        rules: &RasterSettings,
    ) -> Result<(), BenchError> {
        let Self { simd, projection, records, grad, .. } = self;
        projection.backward(*simd, cloud, &shot.view, rules, MAX_DEGREE, records, None, grad).map_err(BenchError::part)
    }
}
