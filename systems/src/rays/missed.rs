//! Rays that pass through where their photo is opaque, or show something else than it: what they should meet is in cells that were told to be
//! empty too early.
//!
//! What is there for a short while, averaged over the times of a scene that moves before the field tells them apart, holds less than
//! counts as full. No ray has samples there from then on, and nothing brings it back but a look along the rays that miss it.

use super::driver::RaySystem;
use super::work::Work;
use crate::space::InternalRay;
use engine::data::Dataset;
use engine::halt::Halt;
use engine::system::{Appearance, LayerRequest, Query, System};
use render_core::ray::Ray;

/// A ray misses where its photo is at least so opaque and the field hides less than this of what is behind it.
const OPAQUE: f32 = 0.95;
const HIDES: f32 = 0.5;
/// It errs where it is off by more than this in a channel, however much the field hides: what hides that is behind what is missing.
const ERRS: f32 = 0.3;
/// Rays that are followed at one update of the grid.
const MOST: usize = 16;

impl RaySystem {
    /// Before the occupancy grid looks again, open the cells along rays of this batch that miss what their photos show: only where it tells times
    /// apart, and once it has settled.
    pub(super) fn reopen_missed(&mut self, data: &Dataset, step: u64) {
        let is_due = self.sampler.occupancy().is_some_and(|occupancy| {
            occupancy.tells_times() && occupancy.is_due(step + 1) && step >= occupancy.config().occupancy_settle
        });
        if !is_due {
            return;
        }
        self.gather_seen();
        let Work { inputs, seen, .. } = &self.work;
        let (batch, per_pixel) = (&inputs.batch, inputs.rays.len() / inputs.batch.len().max(1));
        let misses = |i: &usize| seen[*i].opacity < HIDES;
        let errs = |i: &usize| {
            let off = |c: usize| (seen[*i].rgb[c] - inputs.truth[*i][c]).abs();
            seen[*i].opacity >= HIDES && (0..3).any(|c| off(c) > ERRS)
        };
        let all = || {
            let counts = |i: &usize| batch.weight[*i] > 0.0 && batch.alpha[*i] >= OPAQUE && seen[*i].transient == 0.0;
            (0..batch.len().min(seen.len())).filter(counts)
        };
        let times = &self.field.time_steps().times;
        let along = |i: usize, before: Option<f32>| {
            let ray = &inputs.rays[i * per_pixel];
            let internal = self.space.internal_ray(ray);
            let time = *times.get(batch.view[i] as usize)?;
            let end =
                before.map_or(internal.end, |depth| internal.end.min(self.space.internal_distance(ray, depth.into())));
            Some((InternalRay { end, ..internal }, time))
        };
        let missing = all().filter(misses).filter_map(|i| along(i, None));
        let erring = all().filter(errs).filter_map(|i| {
            along(i, Some(self.depth_of(&inputs.rays[i * per_pixel], data.view(batch.view[i] as usize).time)))
        });
        let rays: Vec<(InternalRay, f32)> = missing.chain(erring).take(MOST).collect();
        if let Some(occupancy) = self.sampler.occupancy_mut().filter(|_| !rays.is_empty()) {
            occupancy.reopen_along(&rays);
        }
    }

    /// How far off is what the field shows along a ray at a time, world units.
    fn depth_of(&self, ray: &Ray, time: f64) -> f32 {
        let query = Query {
            background: [0.0; 3],
            layers: LayerRequest::default(),
            error_budget: 0.01,
            appearance: Appearance::Mean,
            time,
            halt: Halt::NEVER,
        };
        self.render(std::slice::from_ref(ray), &query).median_depth[0]
    }
}
