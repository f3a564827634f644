//! Patches rendered with the code of another photo, where the photo model asks for them: only the colour network learns from that.

use super::chunk::{Chunk, TileWork};
use super::context::StepContext;
use super::driver::RaySystem;
use super::marched::Gradients;
use super::step::Plan;
use super::tile::Tile;
use super::work::{CHUNKS, SecondRenders};
use crate::buffers::sized;
use crate::fields::Columns;
use crate::photo_model::{RenderedTwice, SecondRender};
use engine::data::Dataset;
use engine::system::SystemError;
use field_core::rng::Rng;
use rayon::prelude::*;
use std::ops::Range;

/// What is behind the scene there.
const GREY: [f32; 3] = [0.5; 3];
/// Stream of the first samples of these rays.
const JITTER: u64 = 0x7265_6c69_6768;

impl RaySystem {
    /// Render the patches the photo model asks for, and keep what it says of them until the networks learn.
    pub(super) fn render_twice(&mut self, data: &Dataset, step: u64) -> Result<(), SystemError> {
        let mut own = std::mem::take(&mut self.work.second_renders);
        own.active = false;
        if let Some(request) = self.photo_model.as_ref().and_then(|photo_model| photo_model.second_render(step)) {
            // Its photos, if not all of them fit in memory, are those of the step.
            own.inputs.batch = self.work.inputs.batch.clone();
            data.draw_patches(self.seed, step, request.views.len(), request.patches, &mut own.inputs.batch)?;
            self.render_patches_twice(&mut own, &request, step);
        }
        self.work.second_renders = own;
        Ok(())
    }

    /// [`RaySystem::render_twice`] for the patches in `own`.
    pub(super) fn render_patches_twice(&mut self, own: &mut SecondRenders, request: &SecondRender, step: u64) {
        let inputs = &mut own.inputs;
        let n = inputs.batch.len();
        own.active = n > 0;
        inputs.rays.clone_from(&inputs.batch.rays);
        inputs.background.clear();
        inputs.background.resize(n, GREY);
        inputs.truth.clone_from(&inputs.background);
        inputs.jitter.resize(self.sampler.randoms() * n, 0.0);
        Rng::new(self.seed, JITTER).substream(step).fill_uniform(0, &mut inputs.jitter);
        own.chunks.resize_with(CHUNKS, || Chunk::new(&self.field, self.head.as_ref()));
        let plan = Plan { step, ..Plan::PICTURE };

        let in_own = self.colours(own, &plan);
        let pixels = request.patches.pixels();
        let others = request.views.iter().flat_map(|&view| std::iter::repeat_n(view, pixels)).collect();
        let views = std::mem::replace(&mut own.inputs.batch.view, others);
        let in_other = self.colours(own, &plan);
        let others = std::mem::replace(&mut own.inputs.batch.view, views);
        let Some(photo_model) = &mut self.photo_model else { return };
        let rendered = RenderedTwice { request, batch: &own.inputs.batch, own: &in_own, other: &in_other };
        let bars = photo_model.judge_second_render(&rendered);
        own.inputs.batch.view = others;
        self.each_part(own, &plan, |chunk, ctx, pixels| chunk.learn_second_render(ctx, pixels, &bars));
    }

    /// Place samples and render.
    fn colours(&mut self, own: &mut SecondRenders, plan: &Plan) -> Vec<[f32; 3]> {
        let parts = self.each_part(own, plan, |chunk, ctx, pixels| {
            chunk.sample(ctx, pixels.clone());
            chunk.render_static(ctx, pixels)
        });
        for chunk in &own.chunks {
            let [march, encode, networks, _] = chunk.stats.seconds;
            self.seconds.march += march;
            self.seconds.encode += encode;
            self.seconds.networks += networks;
        }
        parts.concat()
    }

    fn each_part<T: Send>(
        &self,
        own: &mut SecondRenders,
        plan: &Plan,
        work: impl Fn(&mut Chunk, &StepContext<'_>, Range<usize>) -> T + Sync,
    ) -> Vec<T> {
        let SecondRenders { inputs, chunks, .. } = own;
        let (n, ctx) = (inputs.batch.len(), self.context(plan, inputs));
        let span = |c: usize| c * n / CHUNKS..(c + 1) * n / CHUNKS;
        chunks.par_iter_mut().enumerate().map(|(c, chunk)| work(chunk, &ctx, span(c))).collect()
    }
}

impl Chunk {
    /// The static part of what [`Chunk::sample`] placed.
    fn render_static(&mut self, ctx: &StepContext<'_>, pixels: Range<usize>) -> Vec<[f32; 3]> {
        let mut out = Vec::with_capacity(pixels.len());
        self.each_tile(ctx, pixels, |TileWork { tile, chunk, rays, pixels, .. }| {
            let count = rays.len();
            tile.forward(ctx, chunk, rays, pixels);
            out.extend_from_slice(&tile.pixel.as_chunks().0[..count]);
        });
        out
    }

    /// Bring derivatives of those colours to the colour network's gradient.
    fn learn_second_render(&mut self, ctx: &StepContext<'_>, pixels: Range<usize>, bars: &[[f32; 3]]) {
        self.colour_grad.fill(0.0);
        self.each_tile(ctx, pixels, |TileWork { tile, chunk, gradients, rays, pixels, .. }| {
            // What was rendered in between is gone.
            tile.forward(ctx, chunk, rays, pixels.clone());
            tile.colour_backward(ctx, &bars[pixels], gradients);
        });
    }
}

impl Tile {
    /// Derivatives of the static part of rays, to the colour network's gradient and nowhere else: what is in front of what
    /// stays.
    fn colour_backward(&mut self, ctx: &StepContext<'_>, bars: &[[f32; 3]], out: &mut Gradients<'_>) {
        let field = ctx.field;
        let count = self.offsets.len() - 1;
        let n = self.offsets[count] as usize;
        if n == 0 {
            return;
        }
        let rgb_bar = sized(&mut self.rgb_bar, 3 * n);
        for (r, bar) in bars.iter().enumerate() {
            for i in self.offsets[r] as usize..self.offsets[r + 1] as usize {
                (0..3).for_each(|c| rgb_bar[c * n + i] = self.w[i] * bar[c]);
            }
        }
        let scratch = sized(&mut self.scratch, field.colour.backward_scratch_len());
        let (packed, acts) = (&field.colour_packed, &self.colour_acts);
        let columns = Columns::Rays(&self.offsets);
        field.colour.backward(field.simd, packed, acts, rgb_bar, n, columns, None, out.colour, scratch);
    }
}
