//! Instant-NGP: a hash grid, two tiny networks, an occupancy grid.
//!
//! Müller, Evans, Schied, Keller, "Instant Neural Graphics Primitives with a Multiresolution Hash Encoding", 2022.
//!
//! A step, as in the paper's section on NeRF:
//!
//! 1. rays of random training pixels; samples only where the occupancy grid has something (`chunk.rs`);
//! 2. hash grid -> density network -> density and geometry features; with the view direction's spherical harmonics
//!    -> colour network -> colour; composited to pixels; the loss, and all of it backwards;
//! 3. the gradient of each level of the grid, scattered in sample order, and Adam on the entries it touched;
//! 4. now and then, the occupancy grid looks at the field (`occupy.rs`).
//!
//! With `sampler = "proposal"` there is no occupancy grid: proposals place the samples (`proposal.rs`), for space without end.
//!
//! What differs from the paper, and why: `docs/decisions/0003-ngp-on-a-cpu.md`.

#[cfg(test)]
mod budget_tests;
mod chunk;
mod config;
mod field;
mod grid_trainer;
mod look;
mod occupy;
mod proposal;
#[cfg(test)]
mod proposal_tests;
mod proposed;
mod render;
mod state;

pub use config::{NetworkPrecision, NgpConfig, Sampler};

use crate::data::{Batch, Dataset};
use crate::options::Background;
use crate::space::{Space, SpaceKind};
use crate::system::{Layers, Query, SkipRow, StepStats, System, SystemError, Tensor, TensorMap, Trial};
use chunk::{Chunk, StepContext};
use field::{Field, fold_gradients};
use field_core::rng::Rng;
use grid_trainer::{GridTrainer, Part};
use occupy::Occupy;
use optim::{Adam, AdamConfig, Decay, NonFiniteGuard};
use proposal::Proposals;
use rayon::prelude::*;
use render_core::budget::{Ledger, depth_limit};
use render_core::ray::Ray;
use render_core::ray_distance::{RayDistance, Warp};
use std::array;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// Chunks of a batch: fixed, so that sums do not depend on the number of threads.
const CHUNKS: usize = 16;

/// Streams of random numbers of a step.
const BACKGROUND: u64 = 0x6261_636b;
const JITTER: u64 = 0x6a69_7474;

/// Training begins with steps so many times as long, and never makes them longer.
const MAX_STRETCH: f32 = 8.0;
/// Largest change of the steps' length from one batch to the next.
const STRETCH_RATE: f32 = 1.05;

/// Rays of the first batch, before anybody knows how many samples a ray has.
const FIRST_RAYS: usize = 256;

/// Adam of the paper: sparse gradients need a small epsilon.
const ADAM: AdamConfig = AdamConfig { beta1: 0.9, beta2: 0.99, eps: 1e-15, decay: Decay::None };

/// The system.
pub struct Ngp {
    config: NgpConfig,
    seed: u64,
    background: Background,
    space: Space,
    /// What the distortion loss measures distances in.
    distance: RayDistance,
    field: Field,
    occupy: Occupy,
    /// Where samples are placed by proposals.
    proposals: Option<Proposals>,
    grid: GridTrainer,
    density_adam: Adam,
    colour_adam: Adam,
    guard: NonFiniteGuard,
    /// Rays of the next batch.
    rays: usize,
    /// Training steps are so many times as long as those of a render, `>= 1`.
    stretch: f32,
    work: Work,
    seconds: Seconds,
    skipped: Skipped,
}

/// What steps reuse.
struct Work {
    batch: Batch,
    rays: Vec<Ray>,
    background: Vec<[f32; 3]>,
    jitter: Vec<f32>,
    chunks: Vec<Chunk>,
    density_grad: Vec<f32>,
    colour_grad: Vec<f32>,
    packed_grad: Vec<f32>,
}

/// Seconds of work in each part: of all threads together where a part runs on several.
#[derive(Clone, Copy, Debug, Default)]
struct Seconds {
    draw: f64,
    march: f64,
    encode: f64,
    networks: f64,
    proposals: f64,
    scatter: f64,
    optimise: f64,
    occupancy: f64,
}

/// Counts for the table of skips.
#[derive(Debug, Default)]
struct Skipped {
    /// Training samples kept, placed, and those a march without the occupancy grid would have placed.
    kept: AtomicU64,
    placed: AtomicU64,
    dense: AtomicU64,
    /// Intervals that proposals weighed.
    proposed: AtomicU64,
    /// What renders skipped.
    renders: Mutex<Ledger>,
}

/// Normalised distance of a ray: even across a box, half linear and half inverse where space has no end.
fn normalised_distance(space: &Space, near: f32) -> RayDistance {
    let near = f64::from(near);
    let (warp, far) = match space.kind() {
        SpaceKind::Contracted => (Warp::Piecewise, f64::INFINITY),
        // Further than any ray from a camera nearby goes through a box of half side 1.
        SpaceKind::Box | SpaceKind::Ndc => (Warp::Linear, near + 8.0),
    };
    RayDistance::new(warp, near, far).expect("`near` is positive and finite, and checked before")
}

impl Ngp {
    /// A new field for a space.
    ///
    /// # Errors
    /// [`SystemError::Config`] for settings that cannot work.
    pub fn new(config: NgpConfig, space: Space, background: Background, seed: u64) -> Result<Self, SystemError> {
        config.check()?;
        let field = Field::new(&config, seed)?;
        let occupy = Occupy::new(&config)?;
        let networks = AdamConfig { decay: Decay::L2(f64::from(config.weight_decay)), ..ADAM };
        let work = Work {
            batch: Batch::default(),
            rays: Vec::new(),
            background: Vec::new(),
            jitter: Vec::new(),
            chunks: (0..CHUNKS).map(|_| Chunk::new(&field)).collect(),
            density_grad: vec![0.0; field.density_params.len()],
            colour_grad: vec![0.0; field.colour_params.len()],
            packed_grad: Vec::new(),
        };
        Ok(Self {
            proposals: (config.sampler == Sampler::Proposal).then(|| Proposals::new(&config, seed)).transpose()?,
            grid: GridTrainer::new(&field.grid),
            density_adam: Adam::new(field.density_params.len(), networks),
            colour_adam: Adam::new(field.colour_params.len(), networks),
            guard: NonFiniteGuard::default(),
            rays: FIRST_RAYS.min(config.batch_rays),
            stretch: MAX_STRETCH,
            distance: normalised_distance(&space, config.near),
            config,
            seed,
            background,
            space,
            field,
            occupy,
            work,
            seconds: Seconds::default(),
            skipped: Skipped::default(),
        })
    }

    /// Cells that no training view sees, or that a view with alpha sees through, are empty for good.
    ///
    /// # Errors
    /// [`SystemError::Scene`] when an image cannot be read.
    pub fn carve(&mut self, data: &Dataset) -> Result<(), SystemError> {
        self.occupy.carve(&self.space, data)
    }

    /// Share of the occupancy grid's cells that are empty for good.
    #[must_use]
    pub fn carved(&self) -> f64 {
        1.0 - self.occupy.grid.visible_cells() as f64 / self.occupy.grid.cells() as f64
    }

    /// Part of a sample's interval that lies in front of it: a march samples where a step begins, proposals in the middle.
    fn lead(&self) -> f32 {
        if self.proposals.is_some() { 0.5 } else { 0.0 }
    }

    /// Random backgrounds and first samples of a step's rays.
    fn draw_randoms(&mut self, step: u64) {
        let (n, work) = (self.work.batch.len(), &mut self.work);
        let rounds = self.proposals.as_ref().map_or(0, |p| p.fields.len());
        work.jitter.resize((1 + rounds) * work.rays.len(), 0.0);
        Rng::new(self.seed, JITTER).substream(step).fill_uniform(0, &mut work.jitter);
        work.background.resize(n, [0.0; 3]);
        let rng = Rng::new(self.seed, BACKGROUND).substream(step);
        for (i, b) in work.background.iter_mut().enumerate() {
            *b = match self.background {
                Background::Random => [0, 1, 2].map(|c| rng.uniform_at(3 * i as u64 + c)),
                fixed => fixed.colour(),
            };
        }
    }

    /// Gradients of the grid, level by level, and Adam on what they touched. Returns the count of non-finite gradients.
    fn update_grid(&mut self, lr: f64) -> usize {
        let field = &mut self.field;
        let parts: [Part<'_>; CHUNKS] = array::from_fn(|c| self.work.chunks[c].part());
        self.grid.step(field.simd, &field.grid, &mut field.grid_params, lr, &parts)
    }

    /// Fold the chunks' network gradients in order, and Adam. Returns the count of non-finite gradients.
    fn update_networks(&mut self, lr: f64) -> usize {
        let field = &mut self.field;
        let Work { chunks, packed_grad, density_grad, colour_grad, .. } = &mut self.work;
        fold_gradients(&field.density, chunks.iter().map(|c| &c.density_grad[..]), packed_grad, density_grad);
        fold_gradients(&field.colour, chunks.iter().map(|c| &c.colour_grad[..]), packed_grad, colour_grad);
        let bad = self.density_adam.step(field.simd, lr, &mut field.density_params, density_grad)
            + self.colour_adam.step(field.simd, lr, &mut field.colour_params, colour_grad);
        field.pack();
        bad
    }

    /// One step of each proposal. Returns the count of non-finite gradients.
    fn update_proposals(&mut self, lr: f64) -> usize {
        let Some(proposals) = &mut self.proposals else { return 0 };
        let Work { chunks, packed_grad, .. } = &mut self.work;
        let mut bad = 0;
        for (round, field) in proposals.fields.iter_mut().enumerate() {
            let parts: [Part<'_>; CHUNKS] = array::from_fn(|c| chunks[c].proposed.part(round));
            let grads = chunks.iter().map(|c| c.proposed.mlp_grad(round));
            bad += field.step(self.field.simd, lr, &parts, grads, packed_grad);
        }
        bad
    }
}

fn since(start: Instant) -> f64 {
    start.elapsed().as_secs_f64()
}

impl System for Ngp {
    fn name(&self) -> &'static str {
        "ngp"
    }

    fn step(&mut self, data: &Dataset, step: u64) -> Result<StepStats, SystemError> {
        let start = Instant::now();
        if self.proposals.is_none() && step.is_multiple_of(self.config.occupancy_every) {
            self.occupy.update(&self.config, &self.field, &self.space, self.seed, step);
        }
        self.seconds.occupancy += since(start);

        let start = Instant::now();
        let per_pixel = (self.config.rays_per_side * self.config.rays_per_side) as usize;
        let Work { batch, rays, .. } = &mut self.work;
        data.draw(self.seed, step, self.rays.div_ceil(per_pixel), batch)?;
        data.spread(self.seed, step, self.config.rays_per_side, batch, rays);
        self.draw_randoms(step);
        let (pixels, rays) = (self.work.batch.len(), self.work.rays.len());
        let counted: f32 = self.work.batch.weight.iter().sum();
        self.seconds.draw += since(start);

        let mut chunks = std::mem::take(&mut self.work.chunks);
        let ctx = StepContext {
            field: &self.field,
            space: &self.space,
            occupancy: &self.occupy.grid,
            marcher: self.occupy.marcher(&self.config, self.stretch),
            proposals: self.proposals.as_ref(),
            exponent: Proposals::exponent(step),
            lead: self.lead(),
            batch: &self.work.batch,
            per_pixel,
            rays: &self.work.rays,
            background: &self.work.background,
            jitter: &self.work.jitter,
            kernel: self.config.kernel(),
            distortion: self.config.distortion,
            distance: self.distance,
            depth_limit: depth_limit(self.config.train_stop),
            share: 1.0 / counted.max(1.0),
        };
        chunks.par_iter_mut().enumerate().for_each(|(c, chunk)| {
            chunk.run(&ctx, c * pixels / CHUNKS..(c + 1) * pixels / CHUNKS);
        });
        self.work.chunks = chunks;

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
        }
        if weight > 0.0 {
            stats.loss /= weight;
            stats.mse /= weight;
        }

        let lr = f64::from(self.config.learning_rate(step));
        let start = Instant::now();
        let bad = self.update_grid(lr) + self.update_proposals(lr);
        self.seconds.scatter += since(start);
        let start = Instant::now();
        let bad = bad + self.update_networks(lr);
        self.seconds.optimise += since(start);
        stats.nonfinite = bad as u64;
        self.guard.record(bad)?;

        // As many rays as make the samples the batch aims at; at most twice as many as before, as the count is noisy.
        let per_ray = (stats.samples as f64 / rays.max(1) as f64).max(1.0);
        let aim = (self.config.batch_samples as f64 / per_ray) as usize;
        self.rays = aim.clamp(CHUNKS, (2 * rays).max(CHUNKS)).min(self.config.batch_rays);
        let change = (per_ray as f32 / self.config.samples_per_ray).clamp(1.0 / STRETCH_RATE, STRETCH_RATE);
        self.stretch = (self.stretch * change).clamp(1.0, MAX_STRETCH);
        Ok(stats)
    }

    fn render(&self, rays: &[Ray], query: &Query) -> Layers {
        render::render(self, rays, query)
    }

    fn rays_per_side(&self) -> u32 {
        self.config.rays_per_side
    }

    fn render_trial(&self, rays: &[Ray], query: &Query, trial: &Trial) -> Option<(Layers, Ledger)> {
        Some(render::render_trial(self, rays, query, trial))
    }

    fn density(&self, points: &[[f64; 3]], out: &mut [f32]) {
        render::density(self, points, out);
    }

    fn colour(&self, points: &[[f64; 3]], d: &[[f32; 3]], out: &mut [[f32; 3]]) {
        render::colour(self, points, d, out);
    }

    fn bounds(&self) -> [[f64; 3]; 2] {
        self.space.world_bounds()
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        state::save(self)
    }

    fn load_state(&mut self, tensors: &TensorMap) -> Result<(), SystemError> {
        state::load(self, tensors)
    }

    fn parameter_count(&self) -> usize {
        let f = &self.field;
        let proposals = self.proposals.as_ref().map_or(0, Proposals::parameter_count);
        f.grid_params.len() + f.density_params.len() + f.colour_params.len() + proposals
    }

    fn memory_bytes(&self) -> usize {
        let chunks: usize = self.work.chunks.iter().map(Chunk::bytes).sum();
        // Gradient and two moments of each parameter.
        let proposals = self.proposals.as_ref().map_or(0, |p| 4 * p.parameter_count());
        self.field.bytes() + proposals + 12 * self.parameter_count() + chunks + self.occupy.bytes()
    }

    fn skips(&self) -> Vec<SkipRow> {
        let read = |a: &AtomicU64| a.load(Ordering::Relaxed);
        let (placed, dense) = (read(&self.skipped.placed), read(&self.skipped.dense));
        let space = if self.proposals.is_some() {
            let proposed = read(&self.skipped.proposed);
            SkipRow::counted(
                "training: weighed by proposals alone",
                (proposed, proposed + placed),
                "samples",
                "weights that the proposals bound (interlevel loss)".into(),
            )
        } else {
            SkipRow::counted(
                "training: empty space",
                (dense.saturating_sub(placed), dense),
                "samples",
                format!(
                    "optical thickness < {} per cell at the smallest step, as last seen",
                    self.config.occupancy_threshold
                ),
            )
        };
        let mut rows = vec![
            space,
            SkipRow::counted(
                "training: behind what is opaque",
                (placed.saturating_sub(read(&self.skipped.kept)), placed),
                "samples",
                format!("transmittance < {}", self.config.train_stop),
            ),
        ];
        rows.extend(render::skip_rows(&self.skipped.renders));
        rows
    }

    fn timings(&self) -> Vec<(&'static str, f64)> {
        let s = &self.seconds;
        vec![
            ("draw rays", s.draw),
            (if self.proposals.is_some() { "proposals (all threads)" } else { "march (all threads)" }, s.march),
            ("encode (all threads)", s.encode),
            ("networks and compositing (all threads)", s.networks),
            ("grid gradient and Adam", s.scatter),
            ("network Adam", s.optimise),
            if self.proposals.is_some() {
                ("proposals backwards (all threads)", s.proposals)
            } else {
                ("occupancy", s.occupancy)
            },
        ]
    }
}
