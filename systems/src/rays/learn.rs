//! What a chunk learns: the loss of its pixels, brought back to features, networks, codes, proposals and deformation.

use super::chunk::{Chunk, TileWork};
use super::context::StepContext;
use super::deform_losses::{self, Weighed};
use crate::buffers::sized;
use crate::fields::{Detail, MovingPart, Places};
use crate::photo_model::PixelBar;
use crate::warps::Points;
use field_core::rng::Rng;
use std::ops::Range;
use std::time::Instant;

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
        let keeps = ctx.placing.proposals().is_some() || ctx.weighs_deform();
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
        self.move_back(ctx, ctx.neighbours.substream(pixels.start as u64));
        let rendered = Instant::now();
        if let Some(proposals) = ctx.placing.proposals() {
            // The mean over rays and final intervals.
            let factor = f64::from(ctx.share) / (ctx.per_pixel * proposals.last()) as f64;
            self.proposed.learn(proposals, ctx.field.simd, &self.offsets, &self.w[..n], factor);
        }
        self.stats.seconds[2] += (rendered - start).as_secs_f64();
        self.stats.seconds[3] = rendered.elapsed().as_secs_f64();
    }

    /// Bring the gradient of the features back to the table, and through positions to the deformation, whose losses draw from `draws`.
    fn move_back(&mut self, ctx: &StepContext<'_>, draws: Rng) {
        let (field, n) = (ctx.field, self.n);
        let bars = &mut self.features_bar[..field.rows() * n];
        let (raw_bar, seen_bar) = field.pull(&self.features[..field.rows() * n], n, bars, &mut self.raw_bar);
        if let Some(part) = &field.moving {
            return self.move_part_back(ctx, part, draws);
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
        if ctx.weighs_deform() {
            let weighed = Weighed { w: &self.w[..n], offsets: &self.offsets, moving: None, judged: &mut self.judged };
            let (grad, scratch) = (&mut self.deform_grad, &mut self.deform);
            self.stats.loss += deform_losses::learn(ctx, deform, points, weighed, draws, grad, scratch);
        }
    }

    /// The same where a part of the field is for what moves: points of that alone are moved.
    fn move_part_back(&mut self, ctx: &StepContext<'_>, part: &MovingPart, draws: Rng) {
        let (x_bar, seen_bar) = self.moving_bars.pull(part, &self.moving, Detail::Leading);
        let Some(deform) = &part.deform else { return };
        self.deform_grad.begin(deform);
        if self.moving.columns.is_empty() {
            return;
        }
        let points = self.moving.points(deform.time_steps());
        deform.learn(points, x_bar, seen_bar, &mut self.deform_grad, &mut self.deform);
        if ctx.weighs_deform() {
            let moving = Some(&self.moving.columns[..]);
            let weighed = Weighed { w: &self.w[..self.n], offsets: &self.offsets, moving, judged: &mut self.judged };
            let (grad, scratch) = (&mut self.deform_grad, &mut self.deform);
            self.stats.loss += deform_losses::learn(ctx, deform, points, weighed, draws, grad, scratch);
        }
    }
}
