//! Systems that look twice along each ray: coarsely everywhere, then finely where the first look saw something.
//!
//! What `nerf` and `mip-nerf` share: networks of one form, the quadrature on the tape, batches, the optimiser, renders,
//! checkpoints. What tells them apart is a [`Recipe`]: where to sample, what the position encoding sees, the density's
//! activation, losses and rates. Gradients stop at the samples' positions.

mod composite;
mod network;
mod recipe;
mod render;
mod samples;

pub use network::NetworkConfig;
pub(crate) use network::refuse;
pub use recipe::{Footprint, Recipe};
pub(crate) use samples::ray_random;
pub use samples::{Level, Tile};

use crate::data::{Batch, Dataset};
use crate::options::Background;
use crate::space::{InternalRay, Space};
use crate::system::{
    Layers, Query, SkipRow, StepStats, System, SystemError, Tensor, TensorMap, f32_tensor, take_f32, take_u64,
    u64_tensor,
};
use composite::CompositeOp;
use field_core::rng::Rng;
use field_core::tape::{Tape, TapeError};
use float_core::Simd;
use network::{Ops, PackedNetwork, Shapes};
use optim::{Adam, NonFiniteGuard};
use rayon::prelude::*;
use render_core::ray::Ray;
use std::time::Instant;

/// Chunks of a batch: fixed, so that sums do not depend on the number of threads. Each holds a gradient.
const CHUNKS: usize = 8;
/// Rays that go through the networks together.
const TILE: usize = 4;
/// Rays of one task of a render.
const RENDER_TASK: usize = 32;
/// Streams of random numbers.
const INIT: u64 = 0x6e65_7266;
const SAMPLES: u64 = 0x7361_6d70;
const BACKGROUND: u64 = 0x6261_636b;

/// A system made by a recipe.
pub struct TwoLevel<R: Recipe> {
    config: R,
    seed: u64,
    background: Background,
    space: Space,
    shapes: Shapes<R::Position>,
    /// Coarse network, then fine; or one for both.
    params: Vec<f32>,
    packed: Vec<PackedNetwork>,
    adam: Adam,
    guard: NonFiniteGuard,
    batch: Batch,
    chunks: Vec<Chunk>,
    grad: Vec<f32>,
    seconds: [f64; 3],
    missed: u64,
    cast: u64,
}

/// Memory of a chunk, kept from step to step.
#[derive(Default)]
struct Chunk {
    grad: Vec<f32>,
    tile: Tile,
    loss: f64,
    fine_error: f64,
    weight: f64,
    samples: u64,
    missed: u64,
}

impl<R: Recipe> TwoLevel<R> {
    /// New networks for a space.
    ///
    /// # Errors
    /// [`SystemError::Config`] for settings that cannot work.
    pub fn new(config: R, space: Space, background: Background, seed: u64) -> Result<Self, SystemError> {
        config.check()?;
        let shapes = Shapes::new(&config.network()?)?;
        let n = shapes.param_count();
        let total = R::NETWORKS * n;
        let mut params = vec![0.0; total];
        let rng = Rng::new(seed, INIT);
        for (i, params) in params.chunks_exact_mut(n).enumerate() {
            shapes.init(rng.substream(i as u64), params);
        }
        let mut system = Self {
            adam: Adam::new(total, R::ADAM),
            guard: NonFiniteGuard::default(),
            batch: Batch::default(),
            chunks: (0..CHUNKS).map(|_| Chunk::default()).collect(),
            grad: vec![0.0; total],
            packed: (0..R::NETWORKS).map(|_| PackedNetwork::default()).collect(),
            seconds: [0.0; 3],
            missed: 0,
            cast: 0,
            config,
            seed,
            background,
            space,
            shapes,
            params,
        };
        system.pack();
        Ok(system)
    }

    fn pack(&mut self) {
        for (params, packed) in self.params.chunks_exact(self.shapes.param_count()).zip(&mut self.packed) {
            self.shapes.pack(params, packed);
        }
    }

    /// The operations of both levels.
    fn ops(&self) -> [Ops<'_, R::Position>; 2] {
        let simd = Simd::best();
        [0, 1].map(|level| self.shapes.ops(simd, &self.packed[network_of::<R>(level)]))
    }

    /// Where the parameters of a level's network lie.
    fn range(&self, level: usize) -> std::ops::Range<usize> {
        let (n, i) = (self.shapes.param_count(), network_of::<R>(level));
        i * n..(i + 1) * n
    }

    /// Parameters of the network of the coarse (0) or fine (1) level.
    fn network(&self, level: usize) -> &[f32] {
        &self.params[self.range(level)]
    }

    /// Forward and backward of one tile of training rays; `ids` are their places in the batch.
    fn train_tile(
        &self,
        ops: &[Ops<'_, R::Position>; 2],
        rays: &[InternalRay],
        ids: &[usize],
        (step, per_ray): (u64, f32),
        chunk: &mut Chunk,
    ) -> Result<(), TapeError> {
        let rng = Rng::new(self.seed, SAMPLES).substream(step);
        // Rays are told apart by their place in the batch, whatever tile they are in.
        let rng = rng.substream(ids[0] as u64);
        let background = Rng::new(self.seed, BACKGROUND).substream(step);
        let tile = &mut chunk.tile;
        tile.background.clear();
        for &i in ids {
            tile.background.extend(match self.background {
                Background::Random => [0, 1, 2].map(|c| background.uniform_at(3 * i as u64 + c)),
                fixed => fixed.colour(),
            });
        }
        self.config.fill_coarse(&self.space, rays, Some(&rng), tile);
        let mut raw = Vec::new();
        for (level, ops) in ops.iter().enumerate() {
            if level == 1 {
                tile.weigh(raw.iter().map(|&raw| self.config.density_of(raw)), rays.len());
                self.config.fill_fine(&self.space, rays, Some(&rng), tile);
            }
            let factor = self.config.level_weight(level);
            let samples = if level == 0 { &mut tile.coarse } else { &mut tile.fine };
            samples.noise.resize(samples.t.len(), 0.0);
            let deviation = self.config.density_noise();
            if deviation > 0.0 {
                for (i, v) in samples.noise.iter_mut().enumerate() {
                    *v = deviation * rng.normal_at((1 << 32) + (level << 24) as u64 + i as u64);
                }
            }
            let Level { arena, offsets, dt, x, d, noise, .. } = samples;
            let composite = CompositeOp { simd: Simd::best(), offsets, dt, background: &tile.background };
            let mut tape = Tape::new(arena, self.network(level));
            let n = dt.len();
            let (x, d) = (tape.constant(x.len() / n.max(1), n, x)?, tape.constant(3, n, d)?);
            let out = ops.record(&mut tape, x, d)?;
            let noise = tape.constant(1, n, noise)?;
            let noisy = tape.add(out.raw_density, noise)?;
            let sigma = self.config.density(&mut tape, noisy)?;
            let pixel = tape.custom(&composite, &[sigma, out.rgb])?;
            if level == 0 {
                raw.extend_from_slice(tape.value(noisy)?.data);
            }
            chunk.samples += n as u64;
            tile.bar.clear();
            for (r, &i) in ids.iter().enumerate() {
                let (alpha, weight) = (self.batch.alpha[i], self.batch.weight[i]);
                for c in 0..3 {
                    let behind = tile.background[3 * r + c];
                    let truth = self.batch.rgb[i][c] * alpha + behind * (1.0 - alpha);
                    let e = tape.value(pixel)?.data[3 * r + c] - truth;
                    chunk.loss += f64::from(factor * weight * e * e) / 3.0;
                    if level == 1 {
                        chunk.fine_error += f64::from(weight * e * e) / 3.0;
                        chunk.weight += f64::from(weight) / 3.0;
                    }
                    tile.bar.push(factor * weight * 2.0 * e * per_ray / 3.0);
                }
            }
            tape.backward(&[(pixel, &tile.bar)], &mut chunk.grad[self.range(level)])?;
        }
        Ok(())
    }
}

/// The network of a level: its own, or the only one.
fn network_of<R: Recipe>(level: usize) -> usize {
    level.min(R::NETWORKS - 1)
}

/// The tape is built of shapes that fit: an error is a mistake in this file.
fn recorded<T>(result: Result<T, TapeError>) -> T {
    result.unwrap_or_else(|e| panic!("the record does not fit: {e}"))
}

impl<R: Recipe> System for TwoLevel<R> {
    fn name(&self) -> &'static str {
        R::NAME
    }

    fn step(&mut self, data: &Dataset, step: u64) -> Result<StepStats, SystemError> {
        let start = Instant::now();
        let mut batch = std::mem::take(&mut self.batch);
        data.draw(self.seed, step, self.config.batch_rays(), &mut batch)?;
        self.batch = batch;
        let rays = self.batch.len();
        let per_ray = 1.0 / self.batch.weight.iter().sum::<f32>().max(1.0);
        self.seconds[0] += start.elapsed().as_secs_f64();

        let start = Instant::now();
        let mut chunks = std::mem::take(&mut self.chunks);
        let ops = self.ops();
        chunks.par_iter_mut().enumerate().for_each(|(c, chunk)| {
            chunk.grad.clear();
            chunk.grad.resize(self.params.len(), 0.0);
            (chunk.loss, chunk.fine_error, chunk.weight, chunk.samples, chunk.missed) = (0.0, 0.0, 0.0, 0, 0);
            let ids: Vec<usize> = (c * rays / CHUNKS..(c + 1) * rays / CHUNKS).collect();
            let (mut hit, mut hit_ids) = (Vec::new(), Vec::new());
            for &i in &ids {
                let radius = match R::FOOTPRINT {
                    Footprint::Point => 0.0,
                    Footprint::Cone => {
                        let [x, y] = self.batch.pixel[i];
                        data.view(self.batch.view[i] as usize).cone_radius(x.into(), y.into()).unwrap_or(0.0)
                    }
                };
                let ray = self.space.internal_cone(&self.batch.rays[i], radius);
                if ray.end > ray.start && self.batch.weight[i] > 0.0 {
                    hit.push(ray);
                    hit_ids.push(i);
                } else {
                    chunk.missed += 1;
                }
            }
            for (rays, ids) in hit.chunks(TILE).zip(hit_ids.chunks(TILE)) {
                recorded(self.train_tile(&ops, rays, ids, (step, per_ray), chunk));
            }
        });
        self.chunks = chunks;
        self.seconds[1] += start.elapsed().as_secs_f64();

        let start = Instant::now();
        let mut stats = StepStats { rays: rays as u64, ..StepStats::default() };
        let mut weight = 0.0;
        self.grad.fill(0.0);
        for chunk in &self.chunks {
            stats.loss += chunk.loss;
            stats.mse += chunk.fine_error;
            stats.samples += chunk.samples;
            weight += chunk.weight;
            self.missed += chunk.missed;
            for (sum, g) in self.grad.iter_mut().zip(&chunk.grad) {
                *sum += g;
            }
        }
        self.cast += rays as u64;
        if weight > 0.0 {
            stats.loss /= weight;
            stats.mse /= weight;
        }
        let bad = self.adam.step(Simd::best(), self.config.learning_rate(step), &mut self.params, &self.grad);
        self.pack();
        self.seconds[2] += start.elapsed().as_secs_f64();
        stats.nonfinite = bad as u64;
        self.guard.record(bad)?;
        Ok(stats)
    }

    fn render(&self, rays: &[Ray], query: &Query) -> Layers {
        self.render_cones(rays, &vec![0.0; rays.len()], query)
    }

    fn render_cones(&self, rays: &[Ray], radii: &[f32], query: &Query) -> Layers {
        let ops = self.ops();
        let parts: Vec<Layers> = rays
            .par_chunks(RENDER_TASK)
            .zip(radii.par_chunks(RENDER_TASK))
            .map_init(Tile::default, |tile, (rays, radii)| {
                let mut out = Layers::default();
                for (rays, radii) in rays.chunks(TILE).zip(radii.chunks(TILE)) {
                    self.render_into(&ops, (rays, radii), query, tile, &mut out);
                }
                out
            })
            .collect();
        let mut out = Layers::default();
        parts.into_iter().for_each(|part| out.extend(part));
        out
    }

    fn density(&self, points: &[[f64; 3]], out: &mut [f32]) {
        let d = vec![[0.0, 0.0, 1.0]; points.len()];
        self.evaluate(points, &d, |i, sigma, _| out[i] = sigma);
    }

    fn colour(&self, points: &[[f64; 3]], d: &[[f32; 3]], out: &mut [[f32; 3]]) {
        self.evaluate(points, d, |i, _, rgb| out[i] = rgb);
    }

    fn bounds(&self) -> [[f64; 3]; 2] {
        self.space.world_bounds()
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        vec![
            f32_tensor("networks", &self.params),
            f32_tensor("adam.m", self.adam.first_moment()),
            f32_tensor("adam.v", self.adam.second_moment()),
            u64_tensor(
                "counters",
                vec![self.adam.steps(), self.guard.steps(), self.guard.bad_steps(), self.guard.entries()],
            ),
        ]
    }

    fn load_state(&mut self, tensors: &TensorMap) -> Result<(), SystemError> {
        let n = self.params.len();
        let params = take_f32(tensors, "networks", n)?;
        let (m, v) = (take_f32(tensors, "adam.m", n)?, take_f32(tensors, "adam.v", n)?);
        let counters = take_u64(tensors, "counters", 4)?;
        self.adam = Adam::restore(R::ADAM, m, v, counters[0])
            .map_err(|e| SystemError::State { name: "adam".into(), problem: e.to_string() })?;
        self.guard = NonFiniteGuard::default().resumed(counters[1], counters[2], counters[3]);
        self.params = params;
        self.pack();
        Ok(())
    }

    fn parameter_count(&self) -> usize {
        self.params.len()
    }

    fn memory_bytes(&self) -> usize {
        let arenas: usize =
            self.chunks.iter().map(|c| c.tile.coarse.arena.memory_bytes() + c.tile.fine.arena.memory_bytes()).sum();
        // Parameters, packed copies, gradient, two moments; a gradient a chunk.
        4 * self.params.len() * (6 + CHUNKS) + arenas
    }

    fn skips(&self) -> Vec<SkipRow> {
        vec![SkipRow::counted(
            "training: rays that miss the scene's box or are masked",
            (self.missed, self.cast),
            "rays",
            "0: nothing is there to sample".into(),
        )]
    }

    fn timings(&self) -> Vec<(&'static str, f64)> {
        vec![("draw rays", self.seconds[0]), ("networks", self.seconds[1]), ("gradient fold and Adam", self.seconds[2])]
    }
}
