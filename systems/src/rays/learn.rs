//! What a chunk learns: the loss of its pixels, brought back to features, networks, codes, proposals and deformation.

use super::chunk::{Chunk, TileWork};
use super::context::StepContext;
use crate::buffers::sized;
use crate::fields::{Detail, MovingPart, Places};
use crate::photo_model::PixelBar;
use crate::warps::{Deform, ElasticAt, Points};
use std::ops::Range;
use std::time::Instant;

/// Samples of less weight do not pay for a Jacobian.
const FAINT: f32 = 1e-4;

/// Weight 1 for the sample of a ray in which half of its transmittance is gone, 0 for the others; 0 for all of a ray that loses less.
fn middle_alone(w: &mut [f32]) {
    let mut sum = 0.0;
    let middle = w.iter().position(|w| {
        sum += w;
        sum >= 0.5
    });
    w.fill(0.0);
    if let Some(middle) = middle {
        w[middle] = 1.0;
    }
}

/// Weights of the samples that the elastic loss looks at, 0 for the others.
fn judged(w: &mut [f32], offsets: &[u32], deform: &Deform) {
    if deform.config().elastic_at == ElasticAt::Middle {
        offsets.windows(2).for_each(|ray| middle_alone(&mut w[ray[0] as usize..ray[1] as usize]));
    }
    w.iter_mut().filter(|w| **w < FAINT).for_each(|w| *w = 0.0);
}

impl Chunk {
    /// Render what [`Chunk::sample`] placed and bring the loss back to features and network gradients.
    pub(super) fn learn(&mut self, ctx: &StepContext<'_>, pixels: Range<usize>) {
        let start = Instant::now();
        self.density_grad.fill(0.0);
        self.colour_grad.fill(0.0);
        self.head_grad.fill(0.0);
        self.seen.clear();
        let n = self.n;
        sized(&mut self.features_bar, ctx.field.rows() * n).fill(0.0);
        if let Some(part) = &ctx.field.moving {
            self.moving_bars.begin(part, self.moving.columns.len());
        }
        let rays = pixels.len() * ctx.per_pixel;
        for (buffer, codes) in [(&mut self.appearance_bar, ctx.appearance), (&mut self.transient_bar, ctx.transient)] {
            buffer.clear();
            buffer.resize(codes.map_or(0, |codes| codes.dims * rays), 0.0);
        }
        self.ray_bars.begin(ctx, rays);
        let keeps = ctx.placing.proposals().is_some() || ctx.elastic() > 0.0;
        if keeps {
            sized(&mut self.w, n);
        }
        let mut stats = self.stats;
        let mut flow = std::mem::take(&mut self.flow);
        if ctx.flow.is_some() {
            flow.kept.begin(n);
        }
        self.each_tile(ctx, pixels.clone(), |work| {
            let TileWork { tile, chunk, gradients, weights, seen, rays, pixels } = work;
            tile.forward(ctx, chunk, rays.clone(), pixels.clone());
            if keeps {
                let samples = chunk.offsets[rays.start] as usize..chunk.offsets[rays.end] as usize;
                let n = samples.len();
                weights[samples].copy_from_slice(&tile.w[..n]);
            }
            if ctx.flow.is_some() {
                tile.keep(ctx, chunk, rays.clone(), &mut flow.kept);
            }
            let first = seen.len();
            seen.extend(tile.pixels(ctx));
            tile.set_bars(
                ctx.per_pixel,
                seen[first..].iter().zip(pixels.clone()).map(|(pixel, i)| {
                    let weight = ctx.batch.weight[i];
                    let (loss, bar) = ctx.loss(i, pixel);
                    let squared: f32 = (0..3).map(|c| (pixel.rgb[c] - ctx.truth[i][c]).powi(2)).sum();
                    stats.pixels += f64::from(weight);
                    stats.loss += f64::from(weight * loss);
                    stats.squared_error += f64::from(weight * squared) / 3.0;
                    let factor = weight * ctx.share;
                    PixelBar {
                        rgb: bar.rgb.map(|g| g * factor),
                        beta: bar.beta * factor,
                        sigma_t: bar.sigma_t * factor,
                    }
                }),
            );
            stats.loss += tile.backward(ctx, chunk, rays, pixels, gradients);
        });
        self.flow = flow;
        self.stats = stats;
        if ctx.by_ray {
            return self.rays_back(ctx, pixels);
        }
        self.move_back(ctx);
        let rendered = Instant::now();
        if let Some(proposals) = ctx.placing.proposals() {
            // The mean over rays and final intervals.
            let factor = f64::from(ctx.share) / (ctx.per_pixel * proposals.last()) as f64;
            self.proposed.learn(proposals, ctx.field.simd, &self.offsets, &self.w[..n], factor);
        }
        self.stats.seconds[2] += (rendered - start).as_secs_f64();
        self.stats.seconds[3] = rendered.elapsed().as_secs_f64();
    }

    /// Bring the gradient of the features back to the table, and through positions to the deformation.
    fn move_back(&mut self, ctx: &StepContext<'_>) {
        let (field, n) = (ctx.field, self.n);
        let bars = &mut self.features_bar[..field.rows() * n];
        let (raw_bar, seen_bar) = field.pull(&self.features[..field.rows() * n], n, bars, &mut self.raw_bar);
        if let Some(part) = &field.moving {
            return self.move_part_back(ctx, part);
        }
        let Some(deform) = &field.deform else { return };
        self.deform_grad.begin(deform);
        let x_bar = sized(&mut self.x_bar, 3 * n);
        x_bar.fill(0.0);
        if deform.warps() {
            let places = Places { x: &self.x[..3 * n], times: &self.times };
            field.features.pull_positions(places, raw_bar, Detail::Leading, x_bar);
        }
        let points = Points { x: &self.was[..3 * n], which: &self.which, time_steps: deform.time_steps() };
        deform.learn(points, x_bar, seen_bar, &mut self.deform_grad, &mut self.deform);
        if ctx.elastic() > 0.0 {
            judged(&mut self.w[..n], &self.offsets, deform);
            let w = &self.w[..n];
            // The mean over rays.
            let factor = f64::from(ctx.share * deform.config().elastic) / ctx.per_pixel as f64;
            let sum = deform.elastic(points, w, factor, &mut self.deform_grad, &mut self.deform);
            self.stats.loss += f64::from(deform.config().elastic) * sum / ctx.per_pixel as f64;
        }
    }

    /// The same where a part of the field is for what moves: points of that alone are moved.
    fn move_part_back(&mut self, ctx: &StepContext<'_>, part: &MovingPart) {
        let (x_bar, seen_bar) = self.moving_bars.pull(part, &self.moving, Detail::Leading);
        let Some(deform) = &part.deform else { return };
        self.deform_grad.begin(deform);
        if self.moving.columns.is_empty() {
            return;
        }
        let points = self.moving.points(deform.time_steps());
        deform.learn(points, x_bar, seen_bar, &mut self.deform_grad, &mut self.deform);
        if ctx.elastic() > 0.0 {
            judged(&mut self.w[..self.n], &self.offsets, deform);
            let w: Vec<f32> = self.moving.columns.iter().map(|&i| self.w[i as usize]).collect();
            let factor = f64::from(ctx.share * deform.config().elastic) / ctx.per_pixel as f64;
            let sum = deform.elastic(points, &w, factor, &mut self.deform_grad, &mut self.deform);
            self.stats.loss += f64::from(deform.config().elastic) * sum / ctx.per_pixel as f64;
        }
    }
}
