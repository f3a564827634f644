//! One training step: random pixels through both levels, the loss and all of it backwards, Adam.

use super::chunk::{Chunk, Context, Inputs, Pass, TwoLevelOps};
use super::recipe::Recipe;
use super::two_level::{CHUNKS, TwoLevel};
use crate::left_out::unweighted;
use crate::photo_model::{Drawing, Outcome, mean_transient};
use crate::survey::Surveys;
use engine::data::Dataset;
use engine::system::{StepStats, SystemError};
use field_core::rng::Rng;
use float_core::Simd;
use rayon::prelude::*;
use std::time::Instant;

/// Streams of random numbers.
const SAMPLES: u64 = 0x7361_6d70;
const BACKGROUND: u64 = 0x6261_636b;

impl<R: Recipe> TwoLevel<R> {
    /// See [`engine::system::System::step`].
    pub(super) fn train_step(&mut self, data: &Dataset, step: u64) -> Result<StepStats, SystemError> {
        let step = self.between_steps(data, step)?;
        let start = Instant::now();
        self.draw(data, step)?;
        let rays = self.inputs.batch.len();
        let share = 1.0 / self.inputs.batch.weight.iter().sum::<f32>().max(1.0);
        self.seconds[0] += start.elapsed().as_secs_f64();

        let start = Instant::now();
        if self.photo_model.as_ref().is_some_and(|photo_model| photo_model.judges_batch(step)) {
            self.each_chunk(data, step, share, Pass::Render);
            self.gather_seen();
            if let Some(photo_model) = &mut self.photo_model {
                photo_model.judge(&self.inputs.batch, step, &self.seen, &self.inputs.truth);
            }
        }
        self.each_chunk(data, step, share, Pass::Learn);
        self.seconds[1] += start.elapsed().as_secs_f64();

        let start = Instant::now();
        let mut stats = self.fold(rays);
        let lr = self.config.learning_rate(step);
        let mut bad = self.trained.step(Simd::best(), lr, &self.grad);
        self.pack();
        bad += self.update_photo_model(step, lr, share);
        self.seconds[2] += start.elapsed().as_secs_f64();
        if self.head.is_some() {
            stats.transient = mean_transient(&self.seen, &self.inputs.batch);
        }
        stats.nonfinite = bad as u64;
        self.trained.record(bad)?;
        Ok(stats)
    }

    /// The pixels of a step, on their backgrounds.
    fn draw(&mut self, data: &Dataset, step: u64) -> Result<(), SystemError> {
        let (seed, pixels, batch) = (self.seed, self.config.batch_rays(), &mut self.inputs.batch);
        match self.photo_model.as_ref().map_or(Drawing::Pixels, |photo_model| photo_model.drawing()) {
            Drawing::Pixels => data.draw_from(seed, step, pixels, self.config.drawn_from(step), batch)?,
            Drawing::Patches(patches, least) => {
                let count = pixels.div_ceil(patches.pixels()).max(least);
                data.draw_patches(seed, step, count, patches, batch)?;
            }
        }
        let ignored = unweighted(batch);
        if let Some(photo_model) = &mut self.photo_model {
            photo_model.begin(data, batch, step)?;
        }
        self.left_out.count(batch, ignored);
        let rng = Rng::new(seed, BACKGROUND).substream(step);
        let background = self.background;
        self.inputs.put_on(|i| background.of_ray(&rng, i));
        Ok(())
    }

    /// What the chunks of a pass share; without randomness and gradients.
    pub(super) fn context<'a>(
        &'a self,
        ops: &'a TwoLevelOps<'a, R::Position>,
        inputs: &'a Inputs,
    ) -> Context<'a, R::Position> {
        Context {
            ops,
            inputs,
            random: None,
            share: 1.0,
            photo_model: self.photo_model.as_deref(),
            appearance: self.photo_model.as_ref().and_then(|photo_model| photo_model.learning_appearance()),
            transient: self.photo_model.as_ref().and_then(|photo_model| photo_model.transient()),
            pass: Pass::Render,
            by_ray: false,
        }
    }

    /// All chunks of the batch, in parallel.
    fn each_chunk(&mut self, data: &Dataset, step: u64, share: f32, pass: Pass) {
        let mut chunks = std::mem::take(&mut self.chunks);
        let ops = self.ops();
        let random = Some(Rng::new(self.seed, SAMPLES).substream(step));
        let ctx = Context { random, share, pass, ..self.context(&ops, &self.inputs) };
        let pixels = self.inputs.batch.len();
        chunks.par_iter_mut().enumerate().for_each(|(c, chunk)| {
            self.run(&ctx, data, c * pixels / CHUNKS..(c + 1) * pixels / CHUNKS, chunk);
        });
        self.chunks = chunks;
    }

    /// The pixels the chunks rendered, in the order of the batch.
    fn gather_seen(&mut self) {
        self.seen.clear();
        self.chunks.iter().for_each(|chunk| self.seen.extend_from_slice(&chunk.seen));
    }

    /// Add up what the chunks found, in their order.
    fn fold(&mut self, rays: usize) -> StepStats {
        let mut stats = StepStats { rays: rays as u64, ..StepStats::default() };
        let mut weight = 0.0;
        self.grad.fill(0.0);
        for chunk in &self.chunks {
            stats.loss += chunk.sums.loss;
            stats.mse += chunk.sums.fine_error;
            stats.samples += chunk.sums.samples;
            weight += chunk.sums.weight;
            self.missed += chunk.sums.missed;
            self.still += chunk.sums.still;
            for (sum, g) in self.grad.iter_mut().zip(&chunk.grad) {
                *sum += g;
            }
        }
        self.cast += rays as u64;
        self.placed += stats.samples;
        if weight > 0.0 {
            stats.loss /= weight;
            stats.mse /= weight;
        }
        stats
    }

    /// The photo model's own step. Returns the count of non-finite gradients.
    fn update_photo_model(&mut self, step: u64, lr: f64, share: f32) -> usize {
        if self.photo_model.is_none() {
            return 0;
        }
        self.gather_seen();
        let bars = |of: fn(&Chunk) -> &Vec<f32>| -> Vec<f32> { self.chunks.iter().flat_map(of).copied().collect() };
        let (appearance_bar, transient_bar) = (bars(|chunk| &chunk.appearance_bar), bars(|chunk| &chunk.transient_bar));
        let Some(photo_model) = &mut self.photo_model else { return 0 };
        photo_model.learn(&Outcome {
            step,
            lr,
            simd: Simd::best(),
            batch: &self.inputs.batch,
            share,
            pixels: &self.seen,
            truth: &self.inputs.truth,
            appearance_bar: &appearance_bar,
            transient_bar: &transient_bar,
        })
    }
}
