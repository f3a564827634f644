//! One training step, from random pixels to Adam.

use super::context::Placing;
use super::context::StepContext;
use super::driver::RaySystem;
use super::work::{CHUNKS, Inputs, Work};
use crate::fields::{MovingPart, Part, fold_gradients};
use crate::left_out::unweighted;
use crate::photo_model::mean_transient;
use crate::photo_model::{Drawing, Outcome, Pixel};
use crate::samplers::{Proposals, Sampler};
use crate::survey::Surveys;
use crate::warps::Deform;
use engine::data::{Batch, Dataset};
use engine::system::{StepStats, SystemError};
use field_core::rng::Rng;
use rayon::prelude::*;
use render_core::budget::depth_limit;
use std::array;
use std::sync::atomic::Ordering;
use std::time::Instant;

/// Streams of random numbers of a step.
const BACKGROUND: u64 = 0x6261_636b;
const JITTER: u64 = 0x6a69_7474;
const STILL: u64 = 0x7374_696c;
const NEIGHBOURS: u64 = 0x6e65_6172;

fn since(start: Instant) -> f64 {
    start.elapsed().as_secs_f64()
}

/// What a step is about, before the context that chunks share is made of it.
pub(super) struct Plan {
    pub(super) step: u64,
    pub(super) per_pixel: usize,
    /// One over the pixels that count.
    pub(super) share: f32,
    /// Whether the gradient is that with respect to rays.
    pub(super) by_ray: bool,
}

impl Plan {
    /// Of a picture that nothing is learnt from.
    pub(super) const PICTURE: Self = Self { step: u64::MAX, per_pixel: 1, share: 1.0, by_ray: false };
}

/// Where the first sample of a ray lies within its step where nothing is random.
const MIDDLE: f32 = 0.5;

impl RaySystem {
    /// Pixels of one ray each before `background`; nothing of them is random.
    pub(super) fn not_random(&self, batch: Batch, background: [f32; 3]) -> Inputs {
        let n = batch.len();
        let mut inputs = Inputs {
            rays: batch.rays.clone(),
            background: vec![background; n],
            jitter: vec![MIDDLE; self.sampler.randoms() * n],
            ..Inputs::default()
        };
        batch.over(inputs.background.iter().copied(), &mut inputs.truth);
        Inputs { batch, ..inputs }
    }

    /// See [`engine::system::System::step`].
    pub(super) fn train_step(&mut self, data: &Dataset, step: u64) -> Result<StepStats, SystemError> {
        let step = self.between_steps(data, step)?;
        self.refine_depth(data, step)?;
        self.begin_movers(data, step)?;
        let start = Instant::now();
        if let Some(occupancy) = self.sampler.occupancy_mut().filter(|occupancy| occupancy.is_due(step)) {
            occupancy.update(&self.field, &self.space, self.seed, step);
        }
        self.seconds.occupancy += since(start);

        let start = Instant::now();
        let per_pixel = (self.config.batch.rays_per_side * self.config.batch.rays_per_side) as usize;
        self.draw(data, step, per_pixel)?;
        let rays = self.work.inputs.rays.len();
        let counted: f32 = self.work.inputs.batch.weight.iter().sum();
        self.seconds.draw += since(start);

        let plan = Plan { step, per_pixel, share: 1.0 / counted.max(1.0), by_ray: false };
        let ahead = self.photo_model.as_ref().is_some_and(|photo_model| photo_model.judges_batch(step));
        if ahead {
            self.each_chunk(&plan, |chunk, ctx, pixels| {
                chunk.sample(ctx, pixels.clone());
                chunk.render_ahead(ctx, pixels);
            });
            self.gather_seen();
            let Work { inputs, seen, .. } = &self.work;
            if let Some(photo_model) = &mut self.photo_model {
                photo_model.judge(&inputs.batch, step, seen, &inputs.truth);
            }
            self.each_chunk(&plan, |chunk, ctx, pixels| chunk.learn(ctx, pixels));
        } else {
            self.each_chunk(&plan, |chunk, ctx, pixels| {
                chunk.sample(ctx, pixels.clone());
                chunk.learn(ctx, pixels);
            });
        }
        self.learn_flow(&plan);
        self.render_twice(data, step)?;
        let mut stats = self.count(rays);
        if let Some(mut map) = self.errors.take() {
            self.gather_seen();
            let Work { inputs, seen, .. } = &self.work;
            let squared = |(p, t): (&Pixel, &[f32; 3])| (0..3).map(|c| (p.rgb[c] - t[c]).powi(2)).sum::<f32>();
            map.learn(step, &inputs.batch, seen.iter().zip(&inputs.truth).map(squared));
            self.errors = Some(map);
        }

        self.reopen_missed(step);
        self.look_for_movers(step);
        let lr = f64::from(self.config.rates.learning_rate(self.course.done(step).steps));
        let start = Instant::now();
        let bad = self.update_grid(lr) + self.update_moving_features(lr) + self.update_proposals(lr);
        self.seconds.scatter += since(start);
        let start = Instant::now();
        let network_lr = lr * f64::from(self.config.rates.network_lr);
        let bad =
            bad + self.update_networks(network_lr) + self.update_deform(step, lr) + self.update_photo_model(&plan, lr);
        self.seconds.optimise += since(start);
        if self.head.is_some() {
            stats.transient = mean_transient(&self.work.seen, &self.work.inputs.batch);
        }
        stats.nonfinite = bad as u64;
        self.guard.record(bad)?;
        let done = self.course.done(self.guard.steps());
        self.field.features.refine(done);
        if let Some(part) = &mut self.field.moving {
            part.features.refine(done);
        }

        // As many rays as make the samples the batch aims at; at most twice as many as before, as the count is noisy.
        let per_ray = (stats.samples as f64 / rays.max(1) as f64).max(1.0);
        let aim = (self.config.batch.batch_samples as f64 / per_ray) as usize;
        self.rays = aim.clamp(CHUNKS, (2 * rays).max(CHUNKS)).min(self.config.batch.batch_rays);
        if let Some(occupancy) = self.sampler.occupancy_mut() {
            occupancy.adapt(per_ray as f32);
        }
        Ok(stats)
    }

    /// The pixels of a step, their rays, and all that is random about them.
    pub(super) fn draw(&mut self, data: &Dataset, step: u64, per_pixel: usize) -> Result<(), SystemError> {
        let looking = self.is_looking();
        let Inputs { batch, rays, .. } = &mut self.work.inputs;
        let pixels = self.rays.div_ceil(per_pixel);
        match self.photo_model.as_ref().map_or(Drawing::Pixels, |photo_model| photo_model.drawing()) {
            Drawing::Pixels if let Some(guide) = &self.guide => {
                data.draw_guided(self.seed, step, pixels, guide, batch)?
            }
            // What a still part alone cannot explain is not drawn more often for that.
            Drawing::Pixels if let Some(map) = self.errors.as_ref().filter(|_| !looking) => {
                data.draw_by_error(self.seed, step, pixels, map, batch)?
            }
            Drawing::Pixels => {
                let views = self.field.deform().and_then(Deform::open_views);
                data.draw_among(self.seed, step, pixels, views, batch)?;
            }
            Drawing::Patches(patches, least) => {
                let count = pixels.div_ceil(patches.pixels()).max(least);
                data.draw_patches(self.seed, step, count, patches, batch)?;
            }
        }
        if looking && let Some(movers) = &self.movers {
            movers.leave_out(batch);
        }
        let ignored = unweighted(batch);
        if let Some(photo_model) = &mut self.photo_model {
            photo_model.begin(data, batch, step)?;
        }
        self.skipped.left_out.count(batch, ignored);
        data.spread(self.seed, step, self.config.batch.rays_per_side, batch, rays);
        self.draw_randoms(step);
        Ok(())
    }

    /// Random backgrounds, the truth before them, and first samples of a step's rays.
    fn draw_randoms(&mut self, step: u64) {
        let work = &mut self.work.inputs;
        let n = work.batch.len();
        work.jitter.resize(self.sampler.randoms() * work.rays.len(), 0.0);
        Rng::new(self.seed, JITTER).substream(step).fill_uniform(0, &mut work.jitter);
        work.background.resize(n, [0.0; 3]);
        let rng = Rng::new(self.seed, BACKGROUND).substream(step);
        for (i, b) in work.background.iter_mut().enumerate() {
            *b = self.background.of_ray(&rng, i as u64);
        }
        work.batch.over(work.background.iter().copied(), &mut work.truth);
    }

    /// What the chunks of a step share.
    pub(super) fn context<'a>(&'a self, plan: &Plan, inputs: &'a Inputs) -> StepContext<'a> {
        StepContext {
            field: &self.field,
            space: &self.space,
            head: self.head.as_ref(),
            placing: match &self.sampler {
                Sampler::Occupancy(occupancy) => Placing::March(occupancy, occupancy.marcher()),
                Sampler::Proposals(proposals) => Placing::Proposals(proposals, Proposals::exponent(plan.step)),
            },
            lead: self.sampler.lead(),
            batch: &inputs.batch,
            time_steps: self.field.time_steps(),
            photo_model: self.photo_model.as_deref(),
            appearance: self.photo_model.as_ref().and_then(|photo_model| photo_model.learning_appearance()),
            transient: self.photo_model.as_ref().and_then(|photo_model| photo_model.transient()),
            per_pixel: plan.per_pixel,
            rays: &inputs.rays,
            background: &inputs.background,
            truth: &inputs.truth,
            jitter: &inputs.jitter,
            neighbours: Rng::new(self.seed, NEIGHBOURS).substream(plan.step),
            cues: self.cues.as_ref(),
            kernel: self.config.batch.kernel(),
            terms: &self.terms,
            flow: self.flow_context(plan.step).filter(|_| plan.step != u64::MAX && !plan.by_ray),
            depth_limit: depth_limit(self.config.batch.train_stop),
            faint: self.faint(),
            share: plan.share,
            by_ray: plan.by_ray,
        }
    }

    /// All chunks with their share of the batch's pixels, in parallel.
    pub(super) fn each_chunk(
        &mut self,
        plan: &Plan,
        work: impl Fn(&mut super::chunk::Chunk, &StepContext<'_>, std::ops::Range<usize>) + Sync,
    ) {
        let mut chunks = std::mem::take(&mut self.work.chunks);
        let pixels = self.work.inputs.batch.len();
        let ctx = self.context(plan, &self.work.inputs);
        chunks.par_iter_mut().enumerate().for_each(|(c, chunk)| {
            work(chunk, &ctx, c * pixels / CHUNKS..(c + 1) * pixels / CHUNKS);
        });
        self.work.chunks = chunks;
    }

    /// The pixels the chunks rendered, in the order of the batch.
    pub(super) fn gather_seen(&mut self) {
        let Work { chunks, seen, .. } = &mut self.work;
        seen.clear();
        chunks.iter().for_each(|chunk| seen.extend_from_slice(&chunk.seen));
    }

    /// Add up what the chunks counted.
    fn count(&mut self, rays: usize) -> StepStats {
        let mut stats = StepStats { rays: rays as u64, ..StepStats::default() };
        let mut weight = 0.0;
        for chunk in &self.work.chunks {
            let s = &chunk.stats;
            stats.loss += s.loss;
            stats.mse += s.squared_error;
            stats.samples += chunk.n as u64;
            weight += s.pixels;
            self.seconds.march += s.seconds[0];
            self.seconds.encode += s.seconds[1];
            self.seconds.networks += s.seconds[2];
            self.seconds.proposals += s.seconds[3];
            self.skipped.proposed.fetch_add(s.proposed, Ordering::Relaxed);
            self.skipped.dense.fetch_add(s.dense, Ordering::Relaxed);
            self.skipped.placed.fetch_add(s.placed, Ordering::Relaxed);
            self.skipped.kept.fetch_add(chunk.n as u64, Ordering::Relaxed);
            if self.field.moving.is_some() {
                self.skipped.moving.fetch_add(chunk.moving.columns.len() as u64, Ordering::Relaxed);
                self.skipped.beside_moving.fetch_add(chunk.n as u64, Ordering::Relaxed);
            }
        }
        if weight > 0.0 {
            stats.loss /= weight;
            stats.mse /= weight;
        }
        stats
    }

    /// Gradients of the grid, level by level, and Adam on what they touched. Returns the count of non-finite gradients.
    fn update_grid(&mut self, lr: f64) -> usize {
        if self.still_is_held() {
            return 0;
        }
        let field = &mut self.field;
        let parts: [Part<'_>; CHUNKS] = array::from_fn(|c| self.work.chunks[c].part(&*field.features));
        field.features.step(lr, &parts)
    }

    /// The same of what the moving part learns about places.
    fn update_moving_features(&mut self, lr: f64) -> usize {
        let Some(MovingPart { features, .. }) = &mut self.field.moving else { return 0 };
        let chunks = &self.work.chunks;
        let in_place = features.pulls_in_place();
        let own = chunks.iter().map(|chunk| chunk.moving_bars.part(in_place, &chunk.moving));
        let parts: Vec<Part<'_>> = own.chain(chunks.iter().flat_map(|chunk| chunk.flow.parts(in_place))).collect();
        features.step(lr, &parts)
    }

    /// Fold the chunks' network gradients in order, and Adam. Returns the count of non-finite gradients.
    fn update_networks(&mut self, lr: f64) -> usize {
        let held = self.still_is_held();
        let field = &mut self.field;
        let Work { chunks, packed_grad, density_grad, colour_grad, head_grad, moving_grad, second_renders, .. } =
            &mut self.work;
        let colours = chunks.iter().chain(second_renders.chunks()).map(|c| &c.colour_grad[..]);
        fold_gradients(field.colour.mlp(), colours, packed_grad, colour_grad);
        let mut bad = self.colour_adam.step(field.simd, lr, &mut field.colour_params, colour_grad);
        if !held {
            let grads = chunks.iter().map(|c| &c.density_grad[..]);
            fold_gradients(field.density.mlp(), grads, packed_grad, density_grad);
            bad += self.density_adam.step(field.simd, lr, &mut field.density_params, density_grad);
        }
        if let Some(head) = &mut self.head {
            fold_gradients(&head.mlp, chunks.iter().map(|c| &c.head_grad[..]), packed_grad, head_grad);
            bad += head.adam.step(field.simd, lr, &mut head.params, head_grad);
            head.pack();
        }
        if let Some(part) = &mut field.moving {
            let grads = chunks.iter().map(|c| &c.moving_bars.network[..]);
            moving_grad.resize(part.params.len(), 0.0);
            fold_gradients(&part.network, grads, packed_grad, moving_grad);
            bad += part.adam.step(field.simd, lr, &mut part.params, moving_grad);
            part.pack();
        }
        field.pack();
        bad
    }

    /// One step of what moves. Returns the count of non-finite gradients.
    fn update_deform(&mut self, step: u64, lr: f64) -> usize {
        let share = self.course.done(step + 1).share;
        let Some(deform) = self.field.deform_mut() else { return 0 };
        let Work { chunks, still, .. } = &mut self.work;
        let grads = chunks.iter().map(|c| &c.deform_grad);
        if deform.holds_background(&Rng::new(self.seed, STILL).substream(step), still) {
            return deform.step(grads.chain([&still.grad]), lr, share);
        }
        deform.step(grads, lr, share)
    }

    /// One step of each proposal. Returns the count of non-finite gradients.
    fn update_proposals(&mut self, lr: f64) -> usize {
        let Sampler::Proposals(proposals) = &mut self.sampler else { return 0 };
        let Work { chunks, packed_grad, .. } = &mut self.work;
        let mut bad = 0;
        for (round, field) in proposals.fields.iter_mut().enumerate() {
            let parts: [Part<'_>; CHUNKS] = array::from_fn(|c| chunks[c].proposed.part(round, &*field.features));
            let grads = chunks.iter().map(|c| c.proposed.mlp_grad(round));
            bad += field.step(self.field.simd, lr, &parts, grads, packed_grad);
        }
        bad
    }

    /// The photo model's own step. Returns the count of non-finite gradients.
    fn update_photo_model(&mut self, plan: &Plan, lr: f64) -> usize {
        if self.photo_model.is_none() {
            return 0;
        }
        self.gather_seen();
        let Work { chunks, appearance_bar, transient_bar, .. } = &mut self.work;
        for (out, of) in [(appearance_bar, 0), (transient_bar, 1)] {
            out.clear();
            for chunk in chunks.iter() {
                let bars = if of == 0 { &chunk.appearance_bar } else { &chunk.transient_bar };
                // The code of a pixel is that of each of its rays.
                let dims = bars.len() / (chunk.seen.len() * plan.per_pixel).max(1);
                for rays in bars.chunks_exact((dims * plan.per_pixel).max(1)) {
                    out.extend((0..dims).map(|k| rays[k..].iter().step_by(dims).sum::<f32>()));
                }
            }
        }
        let Work { inputs, seen, appearance_bar, transient_bar, .. } = &self.work;
        let Some(photo_model) = &mut self.photo_model else { return 0 };
        photo_model.learn(&Outcome {
            step: plan.step,
            lr,
            simd: self.field.simd,
            batch: &inputs.batch,
            share: plan.share,
            pixels: seen,
            truth: &inputs.truth,
            appearance_bar,
            transient_bar,
        })
    }
}
