//! Cells of an occupancy grid that are opened again: something may be there that its probes did not find.

use super::occupancy::Occupancy;
use super::occupancy_config::MAX_SAMPLES;
use super::probe::Found;
use crate::fields::MovingCells;
use crate::space::{InternalRay, Space};
use float_core::Simd;
use render_core::occupancy::{CellBits, OccupancyGrid, RaySpan, StepRule};
use std::ops::ControlFlow;

/// Thickness of a cell that is opened again, in thresholds: some probes may find nothing there before it counts as empty.
const REOPENED: f32 = 8.0;

impl Occupancy {
    /// Cells in which something moves may be full at other times: they are probed anew before they count as empty.
    pub(crate) fn reopen(&mut self, moving: &MovingCells, space: &Space) {
        let (simd, mut x, mut opened) = (Simd::best(), [0.0; 3], vec![0_u64; self.grid.bits().len()]);
        for id in 0..self.grid.cells() {
            space.grid_positions(simd, &self.grid.cell_point(id as u32, [0.5; 3]), &mut x);
            if moving.holds(x) {
                opened[id / 64] |= 1 << (id % 64);
            }
        }
        self.open(&opened);
        if let Some(times) = &mut self.times {
            times.open(&opened);
            times.refresh(&self.grid);
        }
    }

    /// Cells along these rays, each of a time in `[-1, 1]`, are opened around their times: something must be there that the grid lost.
    pub(crate) fn reopen_along(&mut self, rays: &[(InternalRay, f32)]) {
        let half_a_cell = 0.5 * self.grid.cell_side(0);
        let everywhere = CellBits::new(vec![u64::MAX; self.grid.bits().len()]);
        let mut found: Vec<Found> = Vec::new();
        for (ray, time) in rays {
            let span = RaySpan { o: ray.o, d: ray.d, t_min: ray.start, t_max: ray.end };
            // To the end of the largest space, if need be in longer steps.
            let along = StepRule::uniform(half_a_cell.max((ray.end - ray.start) / MAX_SAMPLES as f32));
            let bins = self.times.as_ref().map_or(0, |times| times.bits_of(&[*time])[0]);
            self.grid.march_in(&everywhere, &span, &along, 0.0, MAX_SAMPLES, |t, _| {
                found.extend(self.grid.cell_of(ray.at(t), 0.0).map(|cell| Found { cell, bins }));
                ControlFlow::Continue(())
            });
        }
        let mut opened = vec![0_u64; self.grid.bits().len()];
        found.iter().for_each(|found| opened[found.cell as usize / 64] |= 1 << (found.cell % 64));
        self.open(&opened);
        if let Some(times) = &mut self.times {
            times.note(&found);
            times.refresh(&self.grid);
        }
    }

    /// These cells, a bit each, count as full until some probes find nothing there; those that are empty for good stay so.
    fn open(&mut self, opened: &[u64]) {
        let (settings, updates) = (self.settings(self.grid.updates()), self.grid.updates());
        let mut thickness = self.grid.thickness().to_vec();
        for (id, thickness) in thickness.iter_mut().enumerate().filter(|(_, thickness)| **thickness >= 0.0) {
            if opened[id / 64] >> (id % 64) & 1 == 1 {
                *thickness = thickness.max(REOPENED * settings.threshold);
            }
        }
        if let Ok(grid) = OccupancyGrid::from_state(settings, &thickness, updates) {
            self.grid = grid;
        }
    }
}
