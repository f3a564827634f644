//! The gradient of the loss with respect to the rays themselves, for samples that stay at their distances. See [`ByRay`].

use super::chunk::{Chunk, Context, Inputs, Pass};
use super::cones::Footprint;
use super::ray_bars::RayGeometryBars;
use super::recipe::Recipe;
use super::two_level::TwoLevel;
use crate::gradients::{ByRay, RayGradients, RayTargets, by_tasks, check, to_world};
use crate::photo_model::Codes;
use engine::data::Batch;
use engine::system::SystemError;
use render_core::ray::RayBar;
use std::ops::Range;

impl<R: Recipe> TwoLevel<R> {
    /// Training views that codes and times are known of.
    fn known_views(&self) -> usize {
        let codes = self.photo_model.iter().flat_map(|photo_model| [photo_model.appearance(), photo_model.transient()]);
        let times = self.shapes.displaces().then(|| self.config.view_times().len());
        codes.flatten().map(Codes::len).chain(times).min().unwrap_or(usize::MAX)
    }

    /// The loss of the rays of one task, and their gradients.
    fn task(
        &self,
        ctx: &Context<'_, R::Position>,
        radii: &[f32],
        which: Range<usize>,
        chunk: &mut Chunk,
    ) -> (f64, Vec<RayBar>) {
        let world = &ctx.inputs.batch.rays[which.clone()];
        let (mut rays, mut hit) = (Vec::new(), Vec::new());
        for (i, ray) in which.clone().zip(world) {
            let radius = if R::FOOTPRINT == Footprint::Cone { radii.get(i).copied() } else { None };
            let ray = self.space.internal_cone(ray, f64::from(radius.unwrap_or(0.0)));
            if ray.end > ray.start {
                rays.push(ray);
                hit.push(i);
            }
        }
        self.run_rays(ctx, which, &rays, &hit, chunk);
        let RayGeometryBars { internal, view } = &chunk.ray_bars;
        let map = self.space.map();
        let bars = world.iter().zip(internal).zip(view);
        let bars = bars.map(|((ray, internal), view)| to_world(&map, ray, internal, *view));
        (chunk.sums.loss, bars.collect())
    }
}

impl<R: Recipe> ByRay for TwoLevel<R> {
    fn ray_gradients(&mut self, targets: &RayTargets<'_>) -> Result<RayGradients, SystemError> {
        check(targets, self.known_views())?;
        let mut inputs = Inputs { batch: Batch::of_rays(targets.rays, targets.rgb), ..Inputs::default() };
        inputs.batch.view.copy_from_slice(targets.view);
        inputs.put_on(|_| targets.background);
        let (n, ops) = (targets.rays.len(), self.ops());
        let share = 1.0 / n.max(1) as f32;
        let appearance = self.photo_model.as_ref().and_then(|photo_model| photo_model.appearance());
        let plain = self.context(&ops, &inputs);
        let ctx = Context { share, photo_model: None, appearance, pass: Pass::Learn, by_ray: true, ..plain };
        let sums = by_tasks(n, |which, chunk| self.task(&ctx, targets.radii, which, chunk));
        Ok(RayGradients { loss: sums.loss * f64::from(share), ..sums })
    }
}
