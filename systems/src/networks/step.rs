//! One training step: random pixels through both levels, the loss and all of it backwards, Adam.

use super::composite::CompositeOp;
use super::composite_two::{CompositeTwoOp, PIXEL};
use super::head::Head;
use super::network::Seen;
use super::ray_gradient::{Along, PlaceBars, RayBars};
use super::recipe::Recipe;
use super::samples::{Level, Tile, add_codes, spread_codes};
use super::two_level::{CHUNKS, TwoLevel, TwoLevelOps, recorded};
use crate::left_out::unweighted;
use crate::networks::cones::{TILE, Which, crossing};
use crate::photo_model::mean_transient;
use crate::photo_model::{Codes, Drawing, Outcome, PhotoModel, Pixel};
use crate::space::InternalRay;
use crate::survey::Surveys;
use engine::data::{Batch, Dataset};
use engine::system::{StepStats, SystemError};
use field_core::rng::Rng;
use field_core::tape::{Node, Tape, TapeError};
use float_core::Simd;
use losses::sparsity;
use rayon::prelude::*;
use std::ops::Range;
use std::time::Instant;

/// Streams of random numbers.
const SAMPLES: u64 = 0x7361_6d70;
const BACKGROUND: u64 = 0x6261_636b;

/// Pixels to render.
#[derive(Default)]
pub(super) struct Inputs {
    pub(super) batch: Batch,
    /// What is behind the scene, one colour a pixel.
    pub(super) background: Vec<[f32; 3]>,
    /// Colours on that background.
    pub(super) truth: Vec<[f32; 3]>,
}

impl Inputs {
    /// Put the pixels on backgrounds.
    pub(super) fn put_on(&mut self, background: impl Fn(u64) -> [f32; 3]) {
        let Self { batch, background: behind, truth } = self;
        behind.clear();
        behind.extend((0..batch.len() as u64).map(background));
        truth.clear();
        let colours = batch.rgb.iter().zip(&batch.alpha).zip(behind.iter());
        truth.extend(colours.map(|((rgb, a), behind)| [0, 1, 2].map(|c| rgb[c] * a + behind[c] * (1.0 - a))));
    }
}

/// What is done with pixels besides rendering them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Pass {
    /// Nothing.
    Look,
    /// Their gradient.
    Learn,
}

/// What all chunks of a pass share.
pub(super) struct Context<'a, P> {
    pub(super) ops: &'a TwoLevelOps<'a, P>,
    pub(super) inputs: &'a Inputs,
    /// Randomness of samples and densities; `None`: evenly spaced, and no noise.
    pub(super) random: Option<Rng>,
    /// One over the pixels of the batch that count.
    pub(super) share: f32,
    pub(super) photo_model: Option<&'a dyn PhotoModel>,
    pub(super) appearance: Option<Codes<'a>>,
    pub(super) transient: Option<Codes<'a>>,
    pub(super) pass: Pass,
    /// Whether the gradient goes on to the rays.
    pub(super) by_ray: bool,
}

/// Memory of a chunk, kept from step to step.
#[derive(Default)]
pub(super) struct Chunk {
    pub(super) grad: Vec<f32>,
    pub(super) tile: Tile,
    /// The chunk's pixels as they were rendered; only where a photo model asks.
    pub(super) seen: Vec<Pixel>,
    /// `[pixels][dims]`, gradients of the pixels' codes.
    appearance_bar: Vec<f32>,
    transient_bar: Vec<f32>,
    pub(super) sums: Sums,
    /// Of the pixels' rays, where they are asked for.
    pub(super) ray_bars: RayBars,
}

/// What is seen of places: an input where rays have a gradient.
fn placed(tape: &mut Tape<'_>, by_ray: bool, rows: usize, n: usize, data: &[f32]) -> Result<Node, TapeError> {
    if by_ray { tape.input(rows, n, data) } else { tape.constant(rows, n, data) }
}

/// Noise on the raw densities of the samples of a level, zero without random numbers.
fn draw_noise(samples: &mut Level, level: usize, rng: Option<&Rng>, deviation: f32) {
    samples.noise.clear();
    samples.noise.resize(samples.t.len(), 0.0);
    if let (Some(rng), true) = (rng, deviation > 0.0) {
        for (i, v) in samples.noise.iter_mut().enumerate() {
            *v = deviation * rng.normal_at((1 << 32) + (level << 24) as u64 + i as u64);
        }
    }
}

/// What the pixels of a tile cost at a level, and the gradient `bar` of that with respect to `values`: colours `[rays][3]`, or
/// all six numbers of [`CompositeTwoOp`]. `seen` are the pixels of the chunk, the first of which is number `first` of the batch.
fn judge<P>(
    ctx: &Context<'_, P>,
    (level, factor): (usize, f32),
    ids: &[usize],
    values: &[f32],
    (seen, first): (&mut [Pixel], usize),
    sums: &mut Sums,
    bar: &mut Vec<f32>,
) {
    let count = ids.len();
    let two = values.len() == PIXEL * count;
    bar.clear();
    bar.resize(values.len(), 0.0);
    for (r, &i) in ids.iter().enumerate() {
        let (weight, truth) = (ctx.inputs.batch.weight[i], ctx.inputs.truth[i]);
        let rgb = [0, 1, 2].map(|c| values[3 * r + c]);
        let error = [0, 1, 2].map(|c| rgb[c] - truth[c]);
        if level == 1 {
            for e in error {
                sums.fine_error += f64::from(weight * e * e) / 3.0;
                sums.weight += f64::from(weight) / 3.0;
            }
        }
        let Some(photo_model) = ctx.photo_model else {
            for (c, e) in error.into_iter().enumerate() {
                sums.loss += f64::from(factor * weight * e * e) / 3.0;
                bar[3 * r + c] = factor * weight * 2.0 * e * ctx.share / 3.0;
            }
            continue;
        };
        let scale = factor * weight * ctx.share;
        let (loss, rgb_bar) = if level == 0 {
            photo_model.coarse_loss(i, rgb, truth)
        } else {
            let mut pixel = Pixel { rgb, ..Pixel::default() };
            if two {
                [pixel.beta, pixel.transient, pixel.sigma_t] = [3, 4, 5].map(|block| values[block * count + r]);
            }
            seen[i - first] = pixel;
            if ctx.pass == Pass::Look {
                continue;
            }
            let (loss, pixel_bar) = photo_model.loss(i, &pixel, truth);
            if two {
                bar[3 * count + r] = scale * pixel_bar.beta;
                bar[5 * count + r] = scale * pixel_bar.sigma_t;
            }
            (loss, pixel_bar.rgb)
        };
        sums.loss += f64::from(factor * weight * loss);
        for (c, rgb_bar) in rgb_bar.into_iter().enumerate() {
            bar[3 * r + c] = scale * rgb_bar;
        }
    }
}

/// What a chunk adds up besides gradients.
#[derive(Clone, Copy, Default)]
pub(super) struct Sums {
    pub(super) loss: f64,
    fine_error: f64,
    weight: f64,
    samples: u64,
    missed: u64,
}

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
            self.each_chunk(data, step, share, Pass::Look);
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
            Drawing::Pixels => data.draw(seed, step, pixels, batch)?,
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
            pass: Pass::Look,
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

    /// The pixels `ids` of a batch.
    pub(super) fn run(&self, ctx: &Context<'_, R::Position>, data: &Dataset, ids: Range<usize>, chunk: &mut Chunk) {
        // A photo model that looks may want to see pixels that do not count between their neighbours.
        let looks = ctx.photo_model.is_some() && ctx.pass == Pass::Look;
        let which = if looks { Which::All } else { Which::Counted };
        let (rays, hit) = crossing(&self.space, (data, &ctx.inputs.batch), ids.clone(), R::FOOTPRINT, which);
        self.run_rays(ctx, ids, (&rays, &hit), chunk);
    }

    /// The pixels `ids` of a batch, `hit` those of them whose `rays` cross the space.
    pub(super) fn run_rays(
        &self,
        ctx: &Context<'_, R::Position>,
        ids: Range<usize>,
        (rays, hit): (&[InternalRay], &[usize]),
        chunk: &mut Chunk,
    ) {
        chunk.sums = Sums::default();
        if ctx.pass == Pass::Learn {
            chunk.grad.clear();
            chunk.grad.resize(self.trained.params.len(), 0.0);
        }
        chunk.ray_bars.begin(if ctx.by_ray { ids.len() } else { 0 });
        chunk.sums.missed = (ids.len() - hit.len()) as u64;
        chunk.seen.clear();
        if ctx.photo_model.is_some() {
            let nothing = |&rgb| Pixel { rgb, ..Pixel::default() };
            chunk.seen.extend(ctx.inputs.background[ids.clone()].iter().map(nothing));
        }
        for (bar, codes) in [(&mut chunk.appearance_bar, ctx.appearance), (&mut chunk.transient_bar, ctx.transient)] {
            bar.clear();
            bar.resize(codes.map_or(0, |codes| codes.dims * ids.len()), 0.0);
        }
        for (rays, hit) in rays.chunks(TILE).zip(hit.chunks(TILE)) {
            recorded(self.tile(ctx, rays, hit, ids.start, chunk));
        }
    }

    /// One tile of rays, forward and, to learn, backward; `ids` are their places in the batch, `first` is that of the chunk.
    fn tile(
        &self,
        ctx: &Context<'_, R::Position>,
        rays: &[InternalRay],
        ids: &[usize],
        first: usize,
        chunk: &mut Chunk,
    ) -> Result<(), TapeError> {
        let Inputs { batch, background, .. } = ctx.inputs;
        // Rays are told apart by their place in the batch, whatever tile they are in.
        let rng = ctx.random.map(|rng| rng.substream(ids[0] as u64));
        let count = rays.len();
        chunk.tile.background.clear();
        chunk.tile.background.extend(ids.iter().flat_map(|&i| background[i]));
        self.config.fill_coarse(&self.space, rays, rng.as_ref(), &mut chunk.tile);
        let mut raw = Vec::new();
        for level in 0..2 {
            if level == 1 {
                chunk.tile.weigh(raw.iter().map(|&raw| self.config.density_of(raw)), count);
                self.config.fill_fine(&self.space, rays, rng.as_ref(), &mut chunk.tile);
            }
            let Tile { coarse, fine, background, bar, appearance, transient, .. } = &mut chunk.tile;
            let samples = if level == 0 { coarse } else { fine };
            draw_noise(samples, level, rng.as_ref(), self.config.density_noise());
            let Level { arena, offsets, t, dt, x, d, noise, .. } = samples;
            let (n, offsets, dt, simd) = (dt.len(), &offsets[..], &dt[..], Simd::best());
            let codes = |codes: Option<Codes<'_>>, rows: &mut Vec<f32>| {
                let codes = codes?;
                spread_codes(ids.iter().map(|&i| codes.of(batch.view[i] as usize)), codes.dims, offsets, rows);
                Some(codes.dims)
            };
            let appearance_dims = codes(ctx.appearance, appearance);
            let head = self.head.as_ref().filter(|_| level == 1);
            let transient_dims = head.and_then(|_| codes(ctx.transient, transient));

            let one = CompositeOp { simd, offsets, dt, background };
            let two = head.map(|head| CompositeTwoOp { simd, mixture: head.mixture, offsets, dt, background });
            let mut tape = Tape::new(arena, self.network(level));
            let seen = Seen {
                x: placed(&mut tape, ctx.by_ray, x.len() / n.max(1), n, x)?,
                d: placed(&mut tape, ctx.by_ray, 3, n, d)?,
                code: appearance_dims.map(|dims| tape.input(dims, n, appearance)).transpose()?,
            };
            let out = ctx.ops.levels[level].record(&mut tape, seen)?;
            let noise = tape.constant(1, n, noise)?;
            let noisy = tape.add(out.raw_density, noise)?;
            chunk.sums.samples += n as u64;
            if level == 0 {
                raw.extend_from_slice(tape.value(noisy)?.data);
                if ctx.pass == Pass::Look {
                    continue;
                }
            }
            let sigma = self.config.density(&mut tape, noisy)?;
            let mut transient_code = None;
            let pixels = match (&ctx.ops.head, &two, transient_dims) {
                (Some(op), Some(two), Some(dims)) => {
                    let code = tape.input(dims, n, transient)?;
                    let part = Head::record(op, &mut tape, out.trunk, code)?;
                    transient_code = Some(code);
                    tape.custom(two, &[sigma, out.rgb, part.sigma, part.rgb, part.beta])?
                }
                _ => tape.custom(&one, &[sigma, out.rgb])?,
            };

            let values = tape.value(pixels)?.data;
            let factor = self.config.level_weight(level);
            judge(ctx, (level, factor), ids, values, (&mut chunk.seen, first), &mut chunk.sums, bar);
            if ctx.pass == Pass::Look {
                return Ok(());
            }
            let prior = self.config.sparsity();
            let mut sigma_bar = Vec::new();
            if level == 0 && prior > 0.0 {
                // The mean over the samples of each ray, as the mean over rays is taken outside.
                let sigmas = tape.value(sigma)?.data;
                let factor = f64::from(prior) * count as f64;
                chunk.sums.loss += factor * sparsity::density(sigmas);
                sigma_bar.resize(n, 0.0);
                sparsity::density_backward(sigmas, factor * f64::from(ctx.share), &mut sigma_bar).expect("as many");
            }
            let seeds = [(pixels, &bar[..]), (sigma, &sigma_bar[..])];
            let seeds = if sigma_bar.is_empty() { &seeds[..1] } else { &seeds[..] };
            tape.backward(seeds, &mut chunk.grad[self.range(level)])?;
            let places = || ids.iter().map(|i| i - first);
            if ctx.by_ray {
                let bars = PlaceBars { x: tape.gradient(seen.x)?, d: tape.gradient(seen.d)? };
                chunk.ray_bars.add(&self.config, &self.space, &Along { rays, offsets, t, dt }, &bars, places());
            }
            if let Some(code) = seen.code {
                add_codes(tape.gradient(code)?, offsets, places(), &mut chunk.appearance_bar);
            }
            if let Some(code) = transient_code {
                add_codes(tape.gradient(code)?, offsets, places(), &mut chunk.transient_bar);
            }
        }
        Ok(())
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
            for (sum, g) in self.grad.iter_mut().zip(&chunk.grad) {
                *sum += g;
            }
        }
        self.cast += rays as u64;
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
