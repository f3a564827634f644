//! Cells of the moving part in which nothing came of it: they are given back, and show the still part alone from then on.

use super::driver::RaySystem;
use crate::buffers::sized;
use crate::fields::{DensityScratch, MovingCells, When};
use rayon::prelude::*;

/// A cell is of use where the moving part shows, hides or takes away more than this at some time, of what passes through the cell.
const OF_USE: f32 = 0.03;
/// Times at which cells are asked at most, spread evenly over those of the photos.
const TIMES: usize = 32;
/// Cells of a task.
const TASK: usize = 256;

/// Buffers of a task.
#[derive(Default)]
struct Asking {
    density: DensityScratch,
    /// `[3][n]`, the middles of cells; `[outputs][n]`, what the field holds there; `[n]`, the moving part's shares.
    x: Vec<f32>,
    raw: Vec<f32>,
    share: Vec<f32>,
}

impl RaySystem {
    /// Cells of the moving part that are of use, and their neighbours among its cells; none without a moving part.
    pub(super) fn cells_of_use(&self) -> MovingCells {
        let mut of_use = MovingCells::none();
        let Some(part) = &self.field.moving else { return of_use };
        let cells: Vec<usize> = part.cells.marked().collect();
        let tasks = cells.par_chunks(TASK).map_init(Asking::default, |asking, cells| self.effects(cells, asking));
        let effects: Vec<f32> = tasks.flatten_iter().collect();
        cells.iter().zip(effects).filter(|(_, effect)| *effect > OF_USE).for_each(|(cell, _)| of_use.mark(*cell));
        of_use.grown().and(&part.cells)
    }

    /// Of each cell the most that the moving part changes in its middle at any time: what it shows of its own, and how much more or less
    /// passes through the cell than through the still part.
    fn effects(&self, cells: &[usize], asking: &mut Asking) -> Vec<f32> {
        let (field, n) = (&self.field, cells.len());
        let time_steps = field.time_steps();
        let side = self.space.kind().grid_span() / MovingCells::SIDE as f32;
        let opacity = |raw: f32| 1.0 - (-field.density_of(raw) * side).exp();
        let Asking { density, x, raw, share } = asking;
        let mut effects = vec![0.0_f32; n];
        for time in (0..time_steps.len().max(1)).step_by(time_steps.len().div_ceil(TIMES).max(1)) {
            let x = sized(x, 3 * n);
            for (i, &cell) in cells.iter().enumerate() {
                let middle = MovingCells::middle_of_cell(cell);
                (0..3).for_each(|a| x[a * n + i] = middle[a]);
            }
            // Where nothing depends on the time there are no time steps.
            let which = vec![time as u32; if time_steps.len() > 0 { n } else { 0 }];
            let raw = sized(raw, field.density.outputs() * n);
            field.outputs(x, When { time_steps, which: &which }, raw, density);
            let share = sized(share, n);
            let (points, mixed) = density.moving();
            mixed.shares(points.all(), share);
            mixed.each_still(points.all(), |i, still| {
                let (of_both, of_still) = (opacity(raw[i]), opacity(still));
                effects[i] = effects[i].max(share[i] * of_both).max((of_both - of_still).abs());
            });
        }
        effects
    }
}
