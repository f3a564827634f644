//! The gradient of the loss with respect to the rays themselves, for samples that stay at their distances. See [`ByRay`].

use super::chunk::Chunk;
use super::context::StepContext;
use super::driver::RaySystem;
use super::step::Plan;
use super::work::{CHUNKS, Inputs};
use crate::buffers::sized;
use crate::fields::{Detail, Places};
use crate::gradients::{ByRay, RayGradients, RayTargets, check};
use crate::photo_model::Codes;
use crate::warps::Points;
use engine::data::Batch;
use engine::system::SystemError;
use glam::DVec3;
use rayon::prelude::*;
use render_core::ray::{Ray, RayBar, SamplePositionsGrads, sample_positions, sample_positions_backward};
use std::ops::Range;

impl Chunk {
    /// Bring the gradients of the features and of the directions' basis back to the chunk's rays, the batch's `rays`.
    pub(super) fn rays_back(&mut self, ctx: &StepContext<'_>, rays: Range<usize>) {
        let (field, n) = (ctx.field, self.n);
        let bars = &mut self.features_bar[..field.rows() * n];
        let (raw_bar, seen_bar) = field.pull(&self.features[..field.rows() * n], n, bars, &mut self.raw_bar);
        let x_bar = sized(&mut self.x_bar, 3 * n);
        x_bar.fill(0.0);
        let places = Places { x: &self.x[..3 * n], times: &self.times };
        field.features.pull_positions(places, raw_bar, Detail::All, x_bar);
        if let Some(deform) = &field.deform {
            self.deform_grad.begin(deform);
            let points = Points { x: &self.was[..3 * n], which: &self.which, time_steps: deform.time_steps() };
            deform.learn(points, x_bar, seen_bar, &mut self.deform_grad, &mut self.deform);
        }
        if let Some(part) = &field.moving {
            let (moving_bar, seen_bar) = self.moving_bars.pull(part, &self.moving, Detail::All);
            if let Some(deform) = &part.deform {
                self.deform_grad.begin(deform);
                let points = self.moving.points(deform.time_steps());
                deform.learn(points, moving_bar, seen_bar, &mut self.deform_grad, &mut self.deform);
            }
            self.moving_bars.add_to(&self.moving, x_bar);
        }

        let map = ctx.space.map();
        let wide = |v: [f32; 3]| DVec3::from(v.map(f64::from));
        let internal: Vec<Ray> = self.rays.iter().map(|ray| Ray { o: wide(ray.o), d: wide(ray.d) }).collect();
        let (t, mut p, mut p_bar) = (&self.t[..n], vec![0.0; 3 * n], vec![0.0; 3 * n]);
        sample_positions(&internal, &self.offsets, t, &mut p);
        map.unit_backward(&p, x_bar, &mut p_bar);
        let mut internal_bars = vec![RayBar::default(); internal.len()];
        let grads = SamplePositionsGrads { rays: &mut internal_bars, t: None };
        sample_positions_backward(&internal, &self.offsets, t, &p_bar, grads);
        let count = internal.len();
        let d_bar = self.ray_bars.directions(field.simd, field, &self.views[..3 * count]);
        self.ray_bars.bars.clear();
        self.ray_bars.bars.extend(ctx.rays[rays].iter().zip(&internal_bars).enumerate().map(|(r, (ray, internal))| {
            let mut bar = RayBar { o: DVec3::ZERO, d: wide([0, 1, 2].map(|a| d_bar[a * count + r])) };
            map.internal_ray_backward(ray, internal, &mut bar);
            bar
        }));
    }
}

impl RaySystem {
    /// Training views that codes and times are known of.
    fn known_views(&self) -> usize {
        let codes = self.photo_model.iter().flat_map(|photo_model| [photo_model.appearance(), photo_model.transient()]);
        let times = self.is_timed().then(|| self.field.time_steps().times.len());
        codes.flatten().map(Codes::len).chain(times).min().unwrap_or(usize::MAX)
    }

    /// Targets as a batch, and how it is gone through.
    pub(super) fn batch_of(&self, targets: &RayTargets<'_>) -> (Inputs, Plan) {
        let mut batch = Batch::of_rays(targets.rays, targets.rgb);
        batch.view.copy_from_slice(targets.view);
        let share = 1.0 / targets.rays.len().max(1) as f32;
        (self.not_random(batch, targets.background), Plan { share, by_ray: true, ..Plan::PICTURE })
    }

    /// What the loss of rays depends on: no photo model judges them, and nothing is measured of them.
    pub(super) fn ray_context<'a>(&'a self, plan: &Plan, inputs: &'a Inputs) -> StepContext<'a> {
        let appearance = self.photo_model.as_ref().and_then(|photo_model| photo_model.appearance());
        StepContext { photo_model: None, cues: None, appearance, ..self.context(plan, inputs) }
    }
}

impl ByRay for RaySystem {
    fn ray_gradients(&mut self, targets: &RayTargets<'_>) -> Result<RayGradients, SystemError> {
        check(targets, self.known_views())?;
        let (inputs, plan) = self.batch_of(targets);
        let mut chunks = std::mem::take(&mut self.work.chunks);
        let ctx = self.ray_context(&plan, &inputs);
        let n = targets.rays.len();
        chunks.par_iter_mut().enumerate().for_each(|(c, chunk)| {
            let span = c * n / CHUNKS..(c + 1) * n / CHUNKS;
            chunk.sample(&ctx, span.clone());
            chunk.learn(&ctx, span);
        });
        let loss = chunks.iter().map(|chunk| chunk.stats.loss).sum::<f64>() * f64::from(plan.share);
        let bars = chunks.iter().flat_map(|chunk| &chunk.ray_bars.bars).copied().collect();
        self.work.chunks = chunks;
        Ok(RayGradients { loss, bars })
    }
}
