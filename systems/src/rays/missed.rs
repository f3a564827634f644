//! Rays that pass through where their photo is opaque: what they should meet is in cells that were told to be empty too early.
//!
//! What is there for a short while, averaged over the times of a scene that moves before the field tells them apart, holds less than
//! counts as full. No ray has samples there from then on, and nothing brings it back but a look along the rays that miss it.

use super::driver::RaySystem;
use super::work::Work;
use crate::space::InternalRay;

/// A ray misses where its photo is at least so opaque and the field hides less than this of what is behind it.
const OPAQUE: f32 = 0.95;
const HIDES: f32 = 0.5;
/// Rays that are followed at one update of the grid.
const MOST: usize = 16;

impl RaySystem {
    /// Before the occupancy grid looks again, open the cells along rays of this batch that miss what their photos show: only where it tells times
    /// apart, and once it has settled.
    pub(super) fn reopen_missed(&mut self, step: u64) {
        let is_due = self.sampler.occupancy().is_some_and(|occupancy| {
            occupancy.tells_times() && occupancy.is_due(step + 1) && step >= occupancy.config().occupancy_settle
        });
        if !is_due {
            return;
        }
        self.gather_seen();
        let Work { inputs, seen, .. } = &self.work;
        let (batch, per_pixel) = (&inputs.batch, inputs.rays.len() / inputs.batch.len().max(1));
        let misses = |i: &usize| {
            batch.weight[*i] > 0.0 && batch.alpha[*i] >= OPAQUE && seen[*i].opacity < HIDES && seen[*i].transient == 0.0
        };
        let times = &self.field.time_steps().times;
        let along = |i: usize| {
            let ray: InternalRay = self.space.internal_ray(&inputs.rays[i * per_pixel]);
            Some((ray, *times.get(batch.view[i] as usize)?))
        };
        let rays: Vec<(InternalRay, f32)> =
            (0..batch.len().min(seen.len())).filter(misses).take(MOST).filter_map(along).collect();
        if let Some(occupancy) = self.sampler.occupancy_mut().filter(|_| !rays.is_empty()) {
            occupancy.reopen_along(&rays);
        }
    }
}
