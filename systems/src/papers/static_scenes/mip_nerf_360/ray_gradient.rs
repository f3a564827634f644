//! The gradient of the loss with respect to the rays themselves, for intervals that stay at their distances. See [`ByRay`].

use super::driver::{Chunk, MipNerf360, Sums, Tile, fits};
use super::level::Level;
use super::network::Ops;
use super::tile::Pixels;
use crate::gradients::{ByRay, RayGradients, RayTargets, by_tasks, check, to_world};
use crate::networks::GaussianBar;
use crate::networks::cones::TILE;
use crate::space::{InternalRay, SpaceKind};
use engine::data::Batch;
use engine::system::SystemError;
use field_core::tape::TapeError;
use glam::DVec3;
use render_core::contract::Norm;
use render_core::frustum::Moments;
use render_core::ray::{Ray, RayBar};
use std::ops::Range;

/// What all rays have in common.
pub(super) struct Aim<'a> {
    pub(super) ops: &'a Ops<'a>,
    pub(super) batch: &'a Batch,
    /// What is behind the scene.
    pub(super) background: [f32; 3],
    pub(super) per_ray: f64,
}

impl MipNerf360 {
    /// The final round of a tile whose intervals are placed: the loss into the chunk's sums, the gradients into the level.
    pub(super) fn judge_placed(&self, aim: &Aim<'_>, ids: &[usize], chunk: &mut Chunk) -> Result<(), TapeError> {
        let Chunk { grad, tile: Tile { levels, background, .. }, sums } = chunk;
        background.clear();
        ids.iter().for_each(|_| background.extend(aim.background));
        let &Aim { ops, batch, per_ray, .. } = aim;
        let pixels = Pixels { ops, batch, ids, background, per_ray, by_ray: true };
        self.final_round(&pixels, levels.last_mut().expect("the final round"), sums, grad)
    }

    /// Gradients of the rays of a tile in internal coordinates, and of their viewing directions, from those of a level.
    fn pull_rays(&self, rays: &[InternalRay], level: &Level) -> Vec<(RayBar, DVec3)> {
        let (n, projection) = (level.dt.len(), &self.shapes.projection);
        let (mut mean_bar, mut cov_bar) = (vec![0.0; 3 * n], vec![0.0; 6 * n]);
        let (along_bar, var_bar) = level.x_bar.split_at(projection.len() * n);
        fits(projection.project_backward(&level.cov[..6 * n], along_bar, var_bar, &mut mean_bar, &mut cov_bar));
        let contraction = (self.space.kind() == SpaceKind::Contracted).then_some(Norm::L2);
        let wide = |v: [f32; 3]| v.map(f64::from);
        let of = |r: usize, ray: &InternalRay| {
            let map = self.distance(ray);
            let line = Ray { o: wide(ray.o).into(), d: wide(ray.d).into() };
            let (mut bar, mut view_bar) = (RayBar::default(), DVec3::ZERO);
            for i in level.offsets[r] as usize..level.offsets[r + 1] as usize {
                // A ray has one fencepost more than intervals.
                let [t0, t1] = [0, 1].map(|end| map.t_of(level.s[i + r + end].into()));
                let moments = Moments::conical(t0, t1, f64::from(ray.radius));
                let gaussian = GaussianBar {
                    mean: [0, 1, 2].map(|a| f64::from(mean_bar[a * n + i])),
                    cov: [0, 1, 2, 3, 4, 5].map(|a| f64::from(cov_bar[a * n + i])),
                };
                gaussian.pull(contraction, &moments, &line, &mut bar);
                view_bar += DVec3::from(wide([0, 1, 2].map(|a| level.d_bar[a * n + i])));
            }
            (bar, view_bar)
        };
        rays.iter().enumerate().map(|(r, ray)| of(r, ray)).collect()
    }

    /// The loss of some of the rays, and their gradients.
    fn task(&self, aim: &Aim<'_>, radii: &[f32], which: Range<usize>, chunk: &mut Chunk) -> (f64, Vec<RayBar>) {
        chunk.sums = Sums::default();
        chunk.grad.clear();
        chunk.grad.resize(self.trained.params.len(), 0.0);
        let (mut rays, mut hit) = (Vec::new(), Vec::new());
        for i in which.clone() {
            let ray = self.space.internal_cone(&aim.batch.rays[i], f64::from(radii.get(i).copied().unwrap_or(0.0)));
            if ray.end > ray.start {
                rays.push(ray);
                hit.push(i);
            }
        }
        let (map, mut bars) = (self.space.map(), vec![RayBar::default(); which.len()]);
        for (rays, ids) in rays.chunks(TILE).zip(hit.chunks(TILE)) {
            fits(self.render_rounds(aim.ops, rays, &mut chunk.tile));
            fits(self.judge_placed(aim, ids, chunk));
            let level = chunk.tile.levels.last().expect("the final round");
            for (&i, (internal, view)) in ids.iter().zip(self.pull_rays(rays, level)) {
                bars[i - which.start] = to_world(&map, &aim.batch.rays[i], &internal, view);
            }
        }
        (chunk.sums.loss, bars)
    }
}

/// The loss is the error of the colours and the distortion; the interlevel loss teaches the proposals, which are held fixed.
impl ByRay for MipNerf360 {
    fn ray_gradients(&mut self, targets: &RayTargets<'_>) -> Result<RayGradients, SystemError> {
        check(targets, usize::MAX)?;
        let (ops, batch) = (self.ops(), Batch::of_rays(targets.rays, targets.rgb));
        let n = batch.len();
        let aim = Aim { ops: &ops, batch: &batch, background: targets.background, per_ray: 1.0 / n.max(1) as f64 };
        Ok(by_tasks(n, |which, chunk| self.task(&aim, targets.radii, which, chunk)))
    }
}
