//! What the engine asks of the system: steps, renders, checkpoints.

use super::driver::{CHUNKS, MipNerf360, Sums, fits};
use super::tile::Pass;
use crate::networks::cones::{self, Cones, Footprint, TILE, Which, crossing};
use engine::canonical::add_canonical;
use engine::data::Dataset;
use engine::system::{Layers, Query, SkipRow, StepStats, System, SystemError, Tensor, TensorMap};
use float_core::Simd;
use optim::clip;
use rayon::prelude::*;
use render_core::ray::Ray;
use std::time::Instant;

impl System for MipNerf360 {
    fn name(&self) -> &'static str {
        "mip-nerf-360"
    }

    fn step(&mut self, data: &Dataset, step: u64) -> Result<StepStats, SystemError> {
        let start = Instant::now();
        let mut batch = std::mem::take(&mut self.batch);
        data.draw(self.seed, step, self.config.step.batch_rays, &mut batch)?;
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
            let (hit, ids) = crossing(&self.space, data, &self.batch, range.clone(), Footprint::Cone, Which::Counted);
            chunk.sums.missed = (range.len() - hit.len()) as u64;
            for (rays, ids) in hit.chunks(TILE).zip(ids.chunks(TILE)) {
                fits(self.train_tile(&ops, Pass { step, per_ray }, rays, ids, chunk));
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
            clip::clip_by_global_norm(simd, self.config.step.clip.into(), &mut [network]);
        }
        let bad = bad + self.trained.step(simd, self.config.step.learning_rate(step), &self.grad);
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
        let into = |cones: Cones<'_>, tile: &mut _, out: &mut Layers| {
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
        // Parameters, packed copies, gradient, two moments of Adam; a gradient a chunk.
        4 * self.trained.params.len() * (6 + CHUNKS) + arenas
    }

    fn skips(&self) -> Vec<SkipRow> {
        vec![cones::missed_row(self.missed, self.cast)]
    }

    fn timings(&self) -> Vec<(&'static str, f64)> {
        vec![("draw rays", self.seconds[0]), ("networks", self.seconds[1]), ("gradient fold and Adam", self.seconds[2])]
    }
}
