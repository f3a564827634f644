//! A step of scene flow: what moves is seen in the frames beside, and learns from what it shows there.

use super::chosen::{BatchRays, ChunkSamples, KeptSamples};
use super::elsewhere::{Basis, PassGradients};
use crate::rays::chunk::Chunk;
use crate::rays::context::StepContext;
use crate::rays::driver::RaySystem;
use crate::rays::step::Plan;
use losses::depth::median::{aligned, aligned_backward};
use std::collections::BTreeMap;
use std::ops::Range;
use std::time::Instant;

impl Chunk {
    /// See what moves of the rays that take part in the frames beside, after [`Chunk::learn`].
    pub(in crate::rays) fn see_elsewhere(&mut self, ctx: &StepContext<'_>, pixels: Range<usize>) {
        let Some(flow) = &ctx.flow else { return };
        let start = Instant::now();
        let mut own = std::mem::take(&mut self.flow);
        let of = BatchRays {
            batch: ctx.batch,
            per_pixel: ctx.per_pixel,
            rays: ctx.rays,
            truth: ctx.truth,
            background: ctx.background,
            space: ctx.space,
            film: flow.film,
            share: flow.config.settings.flow_share,
            chained: flow.chained(),
        };
        own.rays.choose(of, self.samples(&own.kept), pixels);
        own.forward(ctx, flow, Basis { rows: &self.basis, rays: self.rays.len() });
        self.flow = own;
        self.stats.seconds[2] += start.elapsed().as_secs_f64();
    }

    /// Learn from it.
    pub(in crate::rays) fn learn_elsewhere(&mut self, ctx: &StepContext<'_>) {
        let Some(flow) = ctx.flow.as_ref().filter(|_| !self.flow.is_empty()) else { return };
        let start = Instant::now();
        self.stats.loss += self.flow.judge(ctx, flow);
        let mut out = PassGradients {
            network: &mut self.moving_bars.network,
            colour: &mut self.colour_grad,
            deform: &mut self.deform_grad,
            room: &mut self.deform,
        };
        self.flow.backward(ctx, flow, &mut out);
        self.stats.seconds[2] += start.elapsed().as_secs_f64();
    }

    /// Its samples, with what was kept of its main pass.
    fn samples<'a>(&'a self, kept: &'a KeptSamples) -> ChunkSamples<'a> {
        let n = self.n;
        ChunkSamples {
            offsets: &self.offsets,
            t: &self.t[..n],
            dt: &self.dt[..n],
            x: &self.x[..3 * n],
            moving: &self.moving,
            kept,
        }
    }
}

/// Disparities of the rays of a photo.
#[derive(Default)]
struct ViewDisparities {
    /// Chunk and ray in it.
    of: Vec<[usize; 2]>,
    /// As rendered, and those of the prior.
    ours: Vec<f32>,
    theirs: Vec<f32>,
}

impl RaySystem {
    /// Learn where what moves is in the frames beside, and from what it shows there, after all chunks have learned.
    pub(in crate::rays) fn learn_flow(&mut self, plan: &Plan) {
        if self.context(plan, &self.work.inputs).flow.is_none() {
            self.work.chunks.iter_mut().for_each(|chunk| chunk.flow.clear());
            return;
        }
        self.each_chunk(plan, |chunk, ctx, pixels| chunk.see_elsewhere(ctx, pixels));
        self.judge_disparities(plan);
        self.each_chunk(plan, |chunk, ctx, _| chunk.learn_elsewhere(ctx));
    }

    /// What rendered disparities cost beside those of priors, both aligned over the rays of a photo: the mean over rays, whose derivatives are
    /// left with the chunks.
    fn judge_disparities(&mut self, plan: &Plan) {
        let mut chunks = std::mem::take(&mut self.work.chunks);
        let ctx = self.context(plan, &self.work.inputs);
        if let Some(flow) = &ctx.flow {
            let factor = f64::from(flow.config.settings.flow_disparity) * flow.fade();
            let mut of_view: BTreeMap<u32, ViewDisparities> = BTreeMap::new();
            for (c, chunk) in chunks.iter().enumerate().filter(|_| factor > 0.0) {
                let rays = &chunk.flow.rays;
                for (r, rendered) in chunk.flow.disparity.iter().enumerate() {
                    let view = rays.frames[r].view;
                    let Some(prior) = flow.film.disparity(view, rays.place[r]) else { continue };
                    let seen = of_view.entry(view).or_default();
                    seen.of.push([c, r]);
                    seen.ours.push(*rendered);
                    seen.theirs.push(prior);
                }
            }
            let all: usize = of_view.values().map(|seen| seen.of.len()).sum();
            let (mut loss, mut scratch) = (0.0, Vec::new());
            for ViewDisparities { of, ours, theirs } in of_view.values() {
                let part = factor * of.len() as f64 / all as f64;
                let mut bars = vec![0.0; of.len()];
                let fits = "as many of both";
                loss += part * aligned(ours, theirs, &mut scratch).expect(fits);
                aligned_backward(ours, theirs, part, &mut bars, &mut scratch).expect(fits);
                of.iter().zip(bars).for_each(|(&[c, r], bar)| chunks[c].flow.disparity_bar[r] = bar);
            }
            // Chunks add up costs of pixels, of which the mean is taken.
            chunks[0].stats.loss += loss / f64::from(ctx.share);
        }
        self.work.chunks = chunks;
    }
}
