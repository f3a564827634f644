//! mip-NeRF 360: proposals, contracted Gaussians, and a loss against floaters.
//!
//! Barron, Mildenhall, Verbin, Srinivasan, Hedman, "Mip-NeRF 360: Unbounded Anti-Aliased Neural Radiance Fields", 2022.
//!
//! A step:
//!
//! 1. each ray is looked at in rounds: a small network says where density may be, and the next round's intervals gather
//!    there; the last round asks the final network (`looks.rs`);
//! 2. an interval of a pixel's cone is a Gaussian; it is contracted into a ball, and encoded along 21 directions;
//! 3. the final weights teach the proposals (interlevel loss) and are kept together (distortion loss); the pixel's error
//!    teaches the final network; gradients stop at the intervals' ends;
//! 4. the gradient of each network is clipped by its own norm; Adam.
//!
//! What differs from the paper, and why: `docs/decisions/0009-mip-nerf-360-parts.md`.

mod config;
mod looks;
mod network;
mod quadrature;
mod render;

pub use config::{LastSample, MipNerf360Config};

use crate::claims::Claim;
use crate::networks::Trained;
use crate::networks::cones::{self, Footprint, TILE, Which, crossing};
use crate::plan::{Ask, Built, planned, space};
use crate::space::{InternalRay, Space};
use engine::canonical::add_canonical;
use engine::data::{Batch, Dataset};
use engine::memory::room_for;
use engine::options::Background;
use engine::system::{Layers, Query, SkipRow, StepStats, System, SystemError, Tensor, TensorMap};
use field_core::rng::Rng;
use field_core::tape::{Tape, TapeError};
use float_core::Simd;
use looks::{Level, Looks};
use losses::interlevel::{self, Levels, interlevel_backward};
use losses::kernel::Kernel;
use losses::{Edges, RayIntervals, Reduction, distortion};
use network::{Ops, PackedNetworks, Shapes};
use optim::{AdamConfig, clip};
use quadrature::QuadratureOp;
use rayon::prelude::*;
use render_core::proposal::Resampler;
use render_core::ray::Ray;
use std::time::Instant;

/// Chunks of a batch: fixed, so that sums do not depend on the number of threads. Each holds a gradient.
const CHUNKS: usize = 4;
/// Streams of random numbers.
const INIT: u64 = 0x6d33_3630;
const SAMPLES: u64 = 0x7361_6d70;
const BACKGROUND: u64 = 0x6261_636b;
/// Adam of the paper.
const ADAM: AdamConfig = AdamConfig::DEFAULT.with_eps(1e-6);

/// The system.
pub struct MipNerf360 {
    config: MipNerf360Config,
    seed: u64,
    background: Background,
    space: Space,
    shapes: Shapes,
    /// Proposal network, then the final one.
    trained: Trained,
    packed: PackedNetworks,
    batch: Batch,
    chunks: Vec<Chunk>,
    grad: Vec<f32>,
    seconds: [f64; 3],
    missed: u64,
    cast: u64,
}

/// Memory of a tile.
#[derive(Default)]
struct Tile {
    /// Proposals, then the final look.
    levels: Vec<Level>,
    resampler: Resampler,
    interlevel: interlevel::Scratch,
    background: Vec<f32>,
}

/// Memory of a chunk, kept from step to step.
#[derive(Default)]
struct Chunk {
    grad: Vec<f32>,
    tile: Tile,
    sums: Sums,
}

/// What a chunk adds up besides gradients.
#[derive(Clone, Copy, Default)]
struct Sums {
    loss: f64,
    squared_error: f64,
    samples: u64,
    missed: u64,
}

/// What a tile of training rays needs to know.
struct TrainTile<'a> {
    ops: &'a Ops<'a>,
    looks: Looks<'a>,
    /// Places of the rays in the batch.
    ids: &'a [usize],
    /// `[rays][3]`
    background: &'a [f32],
    /// One over the rays of the batch that count.
    per_ray: f64,
}

impl MipNerf360 {
    /// New networks for a space.
    ///
    /// # Errors
    /// [`SystemError::Config`] for settings that cannot work.
    pub fn new(config: MipNerf360Config, space: Space, background: Background, seed: u64) -> Result<Self, SystemError> {
        config.check()?;
        let shapes = Shapes::new(&config)?;
        let n = shapes.param_count();
        room_for("width", config.width, n)?;
        let mut params = vec![0.0; n];
        shapes.init(Rng::new(seed, INIT), &mut params);
        let mut system = Self {
            trained: Trained::new(params, ADAM),
            batch: Batch::default(),
            chunks: (0..CHUNKS).map(|_| Chunk::default()).collect(),
            grad: vec![0.0; n],
            packed: PackedNetworks::default(),
            seconds: [0.0; 3],
            missed: 0,
            cast: 0,
            config,
            seed,
            background,
            space,
            shapes,
        };
        system.pack();
        Ok(system)
    }

    fn pack(&mut self) {
        self.shapes.pack(&self.trained.params, &mut self.packed);
    }

    fn ops(&self) -> Ops<'_> {
        self.shapes.ops(Simd::best(), &self.packed)
    }

    /// Forward and backward of one tile of training rays.
    fn train_tile(
        &self,
        ops: &Ops<'_>,
        (rays, ids): (&[InternalRay], &[usize]),
        (step, per_ray): (u64, f64),
        chunk: &mut Chunk,
    ) -> Result<(), TapeError> {
        let behind = Rng::new(self.seed, BACKGROUND).substream(step);
        let Chunk { grad, tile, sums } = chunk;
        let Tile { levels, resampler, interlevel, background } = tile;
        background.clear();
        for &i in ids {
            background.extend(self.background.of_ray(&behind, i as u64));
        }
        let random = Rng::new(self.seed, SAMPLES).substream(step);
        let fraction = (step as f64 / self.config.steps as f64) as f32;
        let looks = Looks { rays, random: Some((random, ids)), fraction };
        levels.resize_with(self.config.proposals + 1, Level::default);
        self.fill(&looks, 0, None, resampler, &mut levels[0]);
        let tile = TrainTile { ops, looks, ids, background, per_ray };
        self.look(&tile, 0, levels, (resampler, interlevel), sums, grad)
    }

    /// Look number `round`, whose level is the first of `levels`, those behind it, and the way back.
    fn look(
        &self,
        tile: &TrainTile<'_>,
        round: usize,
        levels: &mut [Level],
        (resampler, scratch): (&mut Resampler, &mut interlevel::Scratch),
        sums: &mut Sums,
        grad: &mut [f32],
    ) -> Result<(), TapeError> {
        let (level, behind) = levels.split_first_mut().expect("a level for each look");
        let Some(next) = behind.first_mut() else {
            return self.final_look(tile, level, sums, grad);
        };
        let n = level.dt.len();
        sums.samples += n as u64;
        // The tape's memory, while the next level is filled from this one.
        let mut arena = std::mem::take(&mut level.arena);
        {
            let last = self.config.last();
            let op = QuadratureOp { simd: Simd::best(), offsets: &level.offsets, dt: &level.dt, last, background: &[] };
            let mut tape = Tape::new(&mut arena, &self.trained.params);
            let x = tape.constant(level.x.len() / n, n, &level.x)?;
            let sigma = tile.ops.proposal(&mut tape, x)?;
            let out = tape.custom(&op, &[sigma])?;
            level.w.copy_from_slice(tape.value(out)?.data);
            self.fill(&tile.looks, round + 1, Some(level), resampler, next);
            self.look(tile, round + 1, behind, (resampler, scratch), sums, grad)?;

            let fine = behind.last().expect("the final level is behind every proposal");
            let levels = Levels {
                fine: RayIntervals { offsets: &fine.offsets, edges: Edges::Joined(&fine.s) },
                w: &fine.w,
                proposal: RayIntervals { offsets: &level.offsets, edges: Edges::Joined(&level.s) },
                w_proposal: &level.w,
            };
            // Over rays and final intervals.
            let factor = f64::from(self.config.interlevel) * tile.per_ray / self.config.samples as f64;
            level.bar.clear();
            level.bar.resize(n, 0.0);
            let loss = interlevel::interlevel(levels, Reduction::Sum, scratch);
            sums.loss += factor * fits(loss);
            fits(interlevel_backward(levels, Reduction::Sum, factor, &mut level.bar, scratch));
            tape.backward(&[(out, &level.bar)], grad)?;
        }
        level.arena = arena;
        Ok(())
    }

    /// The final network: colours, the loss on them and on the weights.
    fn final_look(
        &self,
        tile: &TrainTile<'_>,
        level: &mut Level,
        sums: &mut Sums,
        grad: &mut [f32],
    ) -> Result<(), TapeError> {
        let Level { arena, offsets, s, dt, w, x, d, bar, .. } = level;
        let (n, rays) = (dt.len(), tile.ids.len());
        sums.samples += n as u64;
        let last = self.config.last();
        let op = QuadratureOp { simd: Simd::best(), offsets, dt, last, background: tile.background };
        let mut tape = Tape::new(arena, &self.trained.params);
        let (x, d) = (tape.constant(x.len() / n, n, x)?, tape.constant(3, n, d)?);
        let (sigma, rgb) = tile.ops.record(&mut tape, x, d)?;
        let out = tape.custom(&op, &[sigma, rgb])?;
        let values = tape.value(out)?.data;
        let pixels = &values[..3 * rays];
        w.copy_from_slice(&values[3 * rays..]);

        bar.clear();
        bar.resize(3 * rays + n, 0.0);
        let (pixel_bar, w_bar) = bar.split_at_mut(3 * rays);
        let kernel = Kernel::Charbonnier { c: self.config.charbonnier };
        for (r, &i) in tile.ids.iter().enumerate() {
            let (alpha, weight) = (self.batch.alpha[i], f64::from(self.batch.weight[i]));
            for c in 0..3 {
                let truth = self.batch.rgb[i][c] * alpha + tile.background[3 * r + c] * (1.0 - alpha);
                let value = pixels[3 * r + c];
                let e = f64::from(value - truth);
                sums.loss += weight * f64::from(kernel.value(value, truth)) * tile.per_ray / 3.0;
                sums.squared_error += weight * e * e * tile.per_ray / 3.0;
                pixel_bar[3 * r + c] =
                    (weight * f64::from(kernel.derivative(value, truth)) * tile.per_ray / 3.0) as f32;
            }
        }
        if self.config.distortion > 0.0 {
            let intervals = RayIntervals { offsets, edges: Edges::Joined(s) };
            let factor = f64::from(self.config.distortion) * tile.per_ray;
            sums.loss += factor * fits(distortion::distortion(intervals, w, Reduction::Sum));
            fits(distortion::distortion_backward(intervals, w, Reduction::Sum, factor, w_bar));
        }
        tape.backward(&[(out, bar)], grad)
    }
}

/// Lengths are cut to fit: an error is a mistake in this module.
fn fits<T, E: std::fmt::Display>(result: Result<T, E>) -> T {
    result.unwrap_or_else(|e| panic!("mip-nerf-360: the record does not fit: {e}"))
}

impl System for MipNerf360 {
    fn name(&self) -> &'static str {
        "mip-nerf-360"
    }

    fn step(&mut self, data: &Dataset, step: u64) -> Result<StepStats, SystemError> {
        let start = Instant::now();
        let mut batch = std::mem::take(&mut self.batch);
        data.draw(self.seed, step, self.config.batch_rays, &mut batch)?;
        self.batch = batch;
        let rays = self.batch.len();
        let per_ray = 1.0 / f64::from(self.batch.weight.iter().sum::<f32>().max(1.0));
        self.seconds[0] += start.elapsed().as_secs_f64();

        let start = Instant::now();
        let mut chunks = std::mem::take(&mut self.chunks);
        let ops = self.ops();
        chunks.par_iter_mut().enumerate().for_each(|(c, chunk)| {
            chunk.grad.clear();
            chunk.grad.resize(self.trained.params.len(), 0.0);
            chunk.sums = Sums::default();
            let range = c * rays / CHUNKS..(c + 1) * rays / CHUNKS;
            let (hit, ids) = crossing(&self.space, (data, &self.batch), range.clone(), Footprint::Cone, Which::Counted);
            chunk.sums.missed = (range.len() - hit.len()) as u64;
            for tile in hit.chunks(TILE).zip(ids.chunks(TILE)) {
                fits(self.train_tile(&ops, tile, (step, per_ray), chunk));
            }
        });
        self.chunks = chunks;
        self.seconds[1] += start.elapsed().as_secs_f64();

        let start = Instant::now();
        let mut stats = StepStats { rays: rays as u64, ..StepStats::default() };
        self.grad.fill(0.0);
        for chunk in &self.chunks {
            stats.loss += chunk.sums.loss;
            stats.mse += chunk.sums.squared_error;
            stats.samples += chunk.sums.samples;
            self.missed += chunk.sums.missed;
            for (sum, g) in self.grad.iter_mut().zip(&chunk.grad) {
                *sum += g;
            }
        }
        self.cast += rays as u64;
        let simd = Simd::best();
        let bad = clip::sanitise(simd, &mut self.grad);
        let (proposal, last) = self.grad.split_at_mut(self.shapes.proposal_params());
        for network in [proposal, last] {
            clip::clip_by_global_norm(simd, self.config.clip.into(), &mut [network]);
        }
        let bad = bad + self.trained.step(simd, self.config.learning_rate(step), &self.grad);
        self.pack();
        self.seconds[2] += start.elapsed().as_secs_f64();
        stats.nonfinite = bad as u64;
        self.trained.record(bad)?;
        Ok(stats)
    }

    fn render(&self, rays: &[Ray], query: &Query) -> Layers {
        self.render_cones(rays, &vec![0.0; rays.len()], query)
    }

    fn render_cones(&self, rays: &[Ray], radii: &[f32], query: &Query) -> Layers {
        let ops = self.ops();
        let into = |cones: (&[Ray], &[f32]), tile: &mut _, out: &mut Layers| {
            fits(self.render_into(&ops, cones, query, tile, out));
        };
        let mut layers = cones::render_tiles(rays, radii, query, into);
        add_canonical(self, rays, query, &mut layers);
        layers
    }

    fn density(&self, points: &[[f64; 3]], _time: f64, out: &mut [f32]) {
        let d = vec![[0.0, 0.0, 1.0]; points.len()];
        self.evaluate(points, &d, |i, sigma, _| out[i] = sigma);
    }

    fn colour(&self, points: &[[f64; 3]], d: &[[f32; 3]], _time: f64, out: &mut [[f32; 3]]) {
        self.evaluate(points, d, |i, _, rgb| out[i] = rgb);
    }

    fn first_sample(&self, ray: &Ray) -> f64 {
        self.space.world_distance(ray, self.space.internal_ray(ray).start)
    }

    fn bounds(&self) -> [[f64; 3]; 2] {
        self.space.world_bounds()
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        self.trained.state()
    }

    fn load_state(&mut self, tensors: &TensorMap) -> Result<(), SystemError> {
        self.trained = self.trained.restored(tensors)?;
        self.pack();
        Ok(())
    }

    fn parameter_count(&self) -> usize {
        self.trained.params.len()
    }

    fn memory_bytes(&self) -> usize {
        let levels = self.chunks.iter().flat_map(|c| &c.tile.levels);
        let arenas: usize = levels.map(|l| l.arena.memory_bytes()).sum();
        // Parameters, packed copies, gradient, two moments; a gradient a chunk.
        4 * self.trained.params.len() * (6 + CHUNKS) + arenas
    }

    fn skips(&self) -> Vec<SkipRow> {
        vec![cones::missed_row(self.missed, self.cast)]
    }

    fn timings(&self) -> Vec<(&'static str, f64)> {
        vec![("draw rays", self.seconds[0]), ("networks", self.seconds[1]), ("gradient fold and Adam", self.seconds[2])]
    }
}

/// What differs from the paper.
pub(crate) const CLAIM: Claim = Claim {
    name: "mip-nerf-360",
    paper: "Barron et al., 2022",
    differs: "Networks and losses of open scenes are the published ones, batches are of 64 rays instead of 16384; objects \
              have a squared error and no distortion loss. Annealing and learning rate are spread over the published 250 000 \
              steps: a run of minutes stays at the start of both.",
    mark: "64 rays, start of 250 000-step schedules",
};

/// The published settings; objects and open scenes have different ones: those of the space asked for.
pub(crate) fn build(mut ask: Ask<'_>) -> Built {
    let ground = ask.ground()?;
    let layout = &ground.layout;
    let asked = ask.run.set.get("space").and_then(|word| word.clone().try_into().ok());
    let config: MipNerf360Config = ask.settings.of(&MipNerf360Config {
        centre: layout.centre.to_array(),
        radius: layout.radius,
        ..MipNerf360Config::published(asked.unwrap_or(layout.kind))
    })?;
    let all = ask.settings.all()?;
    config.check()?;
    let place = (config.centre, config.radius, f64::from(config.far));
    let space = space(layout, ask.data, config.space, place, config.near)?;
    let system = MipNerf360::new(config, space, ground.background, ask.run.seed)?;
    Ok((Box::new(system), planned(ground, all)))
}
