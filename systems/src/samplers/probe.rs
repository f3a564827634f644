//! Cells of an occupancy grid, probed: densities at random points and, where something moves, at several times.

use crate::buffers::sized;
use crate::fields::{DensityScratch, Field, When};
use crate::space::Space;
use field_core::rng::Rng;
use render_core::occupancy::OccupancyGrid;

/// Streams of the points probed, and of their times.
const POINTS: u64 = 0x6f63_6375;
const TIMES: u64 = 0x6d6f_6d65;
/// An update probes at one in this many occupied cells.
pub(super) const OCCUPIED_SHARE: u32 = 4;
/// Times at which a cell is probed where things move: it is full now and then.
const TIMES_OF_A_PROBE: u32 = 4;
/// From one time to the next that a cell is probed, as a share of all: the golden ratio leaves no gap for long.
const NEXT_TIME: f64 = 0.618_033_988_749_894_9;

/// Buffers of a task of an update.
#[derive(Default)]
pub(super) struct Prober {
    densities: DensityScratch,
    p: Vec<f32>,
    x: Vec<f32>,
    /// Views whose times are probed, and what is seen in one of them; only where something moves.
    which: Vec<u32>,
    now: Vec<f32>,
    /// Cells at points where something moves: which they are, of which time step, where, and what is there.
    moving: Vec<u32>,
    moving_which: Vec<u32>,
    was: Vec<f32>,
    moved: Vec<f32>,
}

/// Where in its cell, and at which times, an update probes.
pub(super) struct Draws {
    points: Rng,
    times: Rng,
    /// Number of the update.
    phase: u32,
}

impl Draws {
    /// Of the update before `step`, number `phase`.
    pub(super) fn new(seed: u64, step: u64, phase: u32) -> Self {
        Self { points: Rng::new(seed, POINTS).substream(step), times: Rng::new(seed, TIMES), phase }
    }

    /// Which of `steps` time steps a cell is probed in: what is empty has to be so at all times. Those of successive probes are
    /// far from each other and leave no gap for long, so that what is there for a twentieth of the time is seen every few probes.
    fn time_step(&self, id: u32, round: u32, steps: usize) -> u32 {
        let probe = u64::from(id.wrapping_add(self.phase) / OCCUPIED_SHARE);
        let probes = (probe * u64::from(TIMES_OF_A_PROBE) + u64::from(round)) as f64;
        let at = (f64::from(self.times.uniform_at(id.into())) + probes * NEXT_TIME).fract();
        ((at * steps as f64) as u32).min(steps as u32 - 1)
    }
}

/// What is probed, and where.
pub(super) struct Probed<'a> {
    pub(super) grid: &'a OccupancyGrid,
    pub(super) field: &'a Field,
    pub(super) space: &'a Space,
    pub(super) draws: Draws,
}

impl Prober {
    /// Densities of cells, each at a random point, written over `out`.
    ///
    /// Where something moves, a cell is probed at several times, and its fullest counts: what is there for a short while
    /// must not be taken for empty.
    pub(super) fn probe(&mut self, of: &Probed<'_>, cells: &[u32], out: &mut [f32]) {
        if !of.field.time_steps().differ() {
            return self.probe_once(of, 0, cells, out);
        }
        out.fill(0.0);
        for round in 0..TIMES_OF_A_PROBE {
            let mut now = std::mem::take(&mut self.now);
            self.probe_once(of, round, cells, sized(&mut now, cells.len()));
            out.iter_mut().zip(&now).for_each(|(out, now)| *out = out.max(*now));
            self.now = now;
        }
    }

    fn probe_once(&mut self, of: &Probed<'_>, round: u32, cells: &[u32], out: &mut [f32]) {
        let (Probed { grid, field, space, draws }, n) = (of, cells.len());
        let time_steps = field.time_steps();
        let points = if time_steps.differ() { draws.points.substream(1 + u64::from(round)) } else { draws.points };
        let p = sized(&mut self.p, 3 * n);
        for (i, &id) in cells.iter().enumerate() {
            let u = [0, 1, 2].map(|a| points.uniform_at(3 * u64::from(id) + a));
            let point = grid.cell_point(id, u);
            (p[i], p[n + i], p[2 * n + i]) = (point[0], point[1], point[2]);
        }
        let x = sized(&mut self.x, 3 * n);
        space.grid_positions(field.simd, p, x);
        self.which.clear();
        if let 1.. = time_steps.len() {
            self.which.extend(cells.iter().map(|&id| draws.time_step(id, round, time_steps.len())));
        }
        let Some(part) = field.moving.as_ref().filter(|_| round > 0) else {
            return field.densities(x, When { time_steps, which: &self.which }, out, &mut self.densities);
        };
        // What stands still was probed in the first round.
        part.cells.columns(x, &mut self.moving);
        let m = self.moving.len();
        let (was, moved) = (sized(&mut self.was, 3 * m), sized(&mut self.moved, m));
        for (row, was) in x.chunks_exact(n.max(1)).zip(was.chunks_exact_mut(m.max(1))) {
            was.iter_mut().zip(&self.moving).for_each(|(was, &i)| *was = row[i as usize]);
        }
        self.moving_which.clear();
        self.moving_which.extend(self.moving.iter().map(|&i| self.which[i as usize]));
        field.densities(was, When { time_steps, which: &self.moving_which }, moved, &mut self.densities);
        out.fill(0.0);
        self.moving.iter().zip(&*moved).for_each(|(&i, moved)| out[i as usize] = *moved);
    }

    pub(super) fn bytes(&self) -> usize {
        4 * (self.p.capacity() + self.x.capacity() + self.was.capacity()) + self.densities.bytes()
    }
}
