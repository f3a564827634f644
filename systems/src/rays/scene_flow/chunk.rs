//! Scene flow in a chunk: all passes forwards, what they cost, and all of it backwards.

use super::chosen::{ChunkSamples, KeptSamples, unit};
use super::elsewhere::{Basis, Pass, PassGradients};
use super::head::FLOW;
use super::term::{BEYOND, FlowRays, HERE, NEXT, PASSES, PREVIOUS, SeenBars};
use super::{Chosen, FlowContext};
use crate::fields::{Detail, Part};
use crate::rays::chunk::Chunk;
use crate::rays::context::StepContext;
use crate::rays::driver::RaySystem;
use crate::rays::step::Plan;
use losses::depth::median::{aligned, aligned_backward};
use std::collections::BTreeMap;
use std::ops::Range;

/// Buffers of scene flow in a chunk.
#[derive(Default)]
pub(in crate::rays) struct FlowChunk {
    pub(in crate::rays) kept: KeptSamples,
    rays: Chosen,
    passes: [Pass; PASSES],
    bars: [SeenBars; PASSES],
    /// `[rays]`, rendered disparities of the moving part, and their gradients.
    disparity: Vec<f32>,
    disparity_bar: Vec<f32>,
}

/// The half of `[6][m]` scene flow that goes to a pass.
fn half(pass: usize, m: usize) -> Range<usize> {
    let rows = FLOW / 2 * m;
    if pass == NEXT { 0..rows } else { rows..2 * rows }
}

impl FlowChunk {
    /// What it brings to the gradient of the moving part's features.
    pub(in crate::rays) fn parts(&self, in_place: bool) -> impl Iterator<Item = Part<'_>> {
        self.passes.iter().map(move |pass| pass.part(in_place))
    }

    /// Whether any ray takes part.
    fn is_empty(&self) -> bool {
        self.rays.len() == 0
    }

    /// Of no rays.
    fn clear(&mut self) {
        self.passes.iter_mut().for_each(Pass::clear);
        self.disparity.clear();
        self.disparity_bar.clear();
    }

    /// All passes at the rays that were chosen.
    fn forward(&mut self, ctx: &StepContext<'_>, flow: &FlowContext<'_>, basis: Basis<'_>) {
        self.clear();
        let Some(part) = ctx.field.moving.as_ref().filter(|_| self.rays.len() > 0) else { return };
        let ([_, m], head, rays) = (self.rays.samples(), flow.config.head(), &self.rays);
        let [here, next, previous, beyond] = &mut self.passes;
        let mut x = Vec::new();
        rays.gather(&rays.x, &mut x);
        here.place(rays, HERE, &x, None);
        here.forward(ctx.field, part, head, rays, basis);
        for (pass, other) in [(NEXT, &mut *next), (PREVIOUS, &mut *previous)] {
            other.place(rays, pass, &here.seen.x, Some(&here.seen.flow[half(pass, m)]));
            other.forward(ctx.field, part, head, rays, basis);
        }
        if let Some(way) = flow.chained() {
            let first = if way == NEXT { &*next } else { &*previous };
            beyond.place(rays, BEYOND, &first.seen.x, Some(&first.seen.flow[half(way, m)]));
            beyond.forward(ctx.field, part, head, rays, basis);
        }
        for (bars, pass) in self.bars.iter_mut().zip(&self.passes) {
            bars.begin(&pass.seen);
        }
        let w = &self.passes[HERE].seen.w;
        let of_ray = |r: usize| self.rays.span(r).map(|i| w[i] * self.rays.disparity[i]).sum::<f32>();
        self.disparity.extend((0..self.rays.len()).map(of_ray));
        self.disparity_bar.resize(self.rays.len(), 0.0);
    }

    /// What the passes cost besides disparities, summed over pixels.
    fn judge(&mut self, ctx: &StepContext<'_>, flow: &FlowContext<'_>) -> f64 {
        let [n, _] = self.rays.samples();
        let per_pixel = f64::from(flow.config.settings.flow_share) * ctx.per_pixel as f64;
        let seen = FlowRays {
            rays: &self.rays,
            seen: self.passes.each_ref().map(|pass| &pass.seen),
            chained: flow.chained(),
            film: flow.film,
            map: ctx.space.map(),
            unit: unit(&ctx.space.map()),
            fade: flow.fade(),
            share: ctx.share,
            per_sample: self.rays.len() as f64 / n.max(1) as f64 / per_pixel,
        };
        let mut loss = 0.0;
        flow.config.terms.iter().for_each(|term| term.add(&seen, &mut self.bars, &mut loss));
        for (r, bar) in self.disparity_bar.iter().enumerate() {
            let w_bar = &mut self.bars[HERE].w;
            self.rays.span(r).for_each(|i| w_bar[i] += bar * self.rays.disparity[i]);
        }
        loss
    }

    /// The way back of [`FlowChunk::forward`], after it was judged.
    fn backward(&mut self, ctx: &StepContext<'_>, flow: &FlowContext<'_>, out: &mut PassGradients<'_>) {
        let Some(part) = ctx.field.moving.as_ref() else { return };
        let ([_, m], head, rays) = (self.rays.samples(), flow.config.head(), &self.rays);
        let ([here, next, previous, beyond], bars) = (&mut self.passes, &mut self.bars);
        // A point of a chain is where its first flow leads, and its second from there.
        if let Some(way) = flow.chained() {
            let x_bar = beyond.backward(ctx.field, part, head, rays, &bars[BEYOND], Detail::All, out);
            add(&mut bars[way].flow[half(way, m)], x_bar);
            let first = if way == NEXT { &mut *next } else { &mut *previous };
            first.carry(x_bar);
        }
        for (pass, other) in [(NEXT, next), (PREVIOUS, previous)] {
            let x_bar = other.backward(ctx.field, part, head, rays, &bars[pass], Detail::All, out);
            add(&mut bars[HERE].flow[half(pass, m)], x_bar);
        }
        here.backward(ctx.field, part, head, rays, &bars[HERE], Detail::Coarse, out);
    }

    /// Bytes held.
    pub(in crate::rays) fn bytes(&self) -> usize {
        let kept = 4 * (self.kept.tau.capacity() + self.kept.still.capacity() + self.kept.rgb.capacity());
        kept + self.rays.bytes() + self.passes.iter().map(Pass::bytes).sum::<usize>()
    }
}

fn add(sum: &mut [f32], bars: &[f32]) {
    sum.iter_mut().zip(bars).for_each(|(sum, bar)| *sum += bar);
}

impl Chunk {
    /// See what moves of the rays that take part in the frames beside, after [`Chunk::learn`].
    pub(in crate::rays) fn see_elsewhere(&mut self, ctx: &StepContext<'_>, pixels: Range<usize>) {
        let Some(flow) = &ctx.flow else { return };
        let mut own = std::mem::take(&mut self.flow);
        own.rays.choose(ctx, flow, self.samples(&own.kept), pixels);
        own.forward(ctx, flow, Basis { rows: &self.basis, rays: self.rays.len() });
        self.flow = own;
    }

    /// Learn from it.
    pub(in crate::rays) fn learn_elsewhere(&mut self, ctx: &StepContext<'_>) {
        let Some(flow) = ctx.flow.as_ref().filter(|_| !self.flow.is_empty()) else { return };
        self.stats.loss += self.flow.judge(ctx, flow);
        let mut out = PassGradients {
            network: &mut self.moving_bars.network,
            colour: &mut self.colour_grad,
            deform: &mut self.deform_grad,
            room: &mut self.deform,
        };
        self.flow.backward(ctx, flow, &mut out);
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
            let mut of_view: BTreeMap<u32, (Vec<[usize; 2]>, Vec<f32>, Vec<f32>)> = BTreeMap::new();
            for (c, chunk) in chunks.iter().enumerate().filter(|_| factor > 0.0) {
                let rays = &chunk.flow.rays;
                for (r, rendered) in chunk.flow.disparity.iter().enumerate() {
                    let view = rays.frames[r].view;
                    let Some(prior) = flow.film.disparity(view, rays.place[r]) else { continue };
                    let (of, ours, theirs) = of_view.entry(view).or_default();
                    of.push([c, r]);
                    ours.push(*rendered);
                    theirs.push(prior);
                }
            }
            let all: usize = of_view.values().map(|(of, ..)| of.len()).sum();
            let (mut loss, mut scratch) = (0.0, Vec::new());
            for (of, ours, theirs) in of_view.values() {
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
