//! The passes of a chunk: all of them forwards, what they cost, and backwards.

use super::chosen::{Chosen, KeptSamples, unit};
use super::config::FlowContext;
use super::elsewhere::{Basis, Pass, PassGradients};
use super::film::{BEYOND, HERE, NEXT, PASSES, PREVIOUS};
use super::head::FLOW;
use super::term::{FlowRays, SeenBars};
use crate::fields::{Detail, Part};
use crate::rays::context::StepContext;
use std::ops::Range;

/// Buffers of scene flow in a chunk.
#[derive(Default)]
pub(in crate::rays) struct FlowChunk {
    pub(in crate::rays) kept: KeptSamples,
    pub(super) rays: Chosen,
    pub(super) passes: [Pass; PASSES],
    bars: [SeenBars; PASSES],
    /// `[rays]`, rendered disparities of the moving part, and their gradients.
    pub(super) disparity: Vec<f32>,
    pub(super) disparity_bar: Vec<f32>,
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
    pub(super) fn is_empty(&self) -> bool {
        self.rays.len() == 0
    }

    /// Of no rays.
    pub(super) fn clear(&mut self) {
        self.passes.iter_mut().for_each(Pass::clear);
        self.disparity.clear();
        self.disparity_bar.clear();
    }

    /// All passes at the rays that were chosen.
    pub(super) fn forward(&mut self, ctx: &StepContext<'_>, flow: &FlowContext<'_>, basis: Basis<'_>) {
        self.clear();
        let Some(part) = ctx.field.moving.as_ref().filter(|_| self.rays.len() > 0) else { return };
        let ([_, m], head, rays) = (self.rays.samples(), flow.config.head(), &self.rays);
        let [here, next, previous, beyond] = &mut self.passes;
        let mut x = Vec::new();
        rays.gather(&rays.x, &mut x);
        here.place(rays, HERE, &x, None);
        here.forward(ctx.field, part, head, rays, basis);
        here.share(ctx.field.simd, rays);
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
    pub(super) fn judge(&mut self, ctx: &StepContext<'_>, flow: &FlowContext<'_>) -> f64 {
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
    pub(super) fn backward(&mut self, ctx: &StepContext<'_>, flow: &FlowContext<'_>, out: &mut PassGradients<'_>) {
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
        here.backward(ctx.field, part, head, rays, &bars[HERE], Detail::Leading, out);
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
