//! Cells of an occupancy grid, probed: how thick they are at random points and, where something moves, at several times.

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

/// Updates in which an occupied cell is probed at so many times.
pub(super) fn updates_of(times: u64) -> u64 {
    (times * u64::from(OCCUPIED_SHARE)).div_ceil(u64::from(TIMES_OF_A_PROBE))
}

/// A cell that a probe found full, and in which bins of time: a bit each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Found {
    pub(super) cell: u32,
    pub(super) bins: u64,
}

/// The bins of time that a probe tells apart.
#[derive(Clone, Copy)]
pub(super) struct Spans<'a> {
    /// `[time steps]`, the bit of the bin that each is in.
    pub(super) bins: &'a [u64],
    /// The bits of all bins.
    pub(super) all: u64,
    /// A cell is full above this optical thickness.
    pub(super) level: f32,
}

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
    /// `[n]`, bins in which cells were found full; only where bins are told apart.
    bins: Vec<u64>,
    /// The cells of a round, and their places among all.
    cells: Vec<u32>,
    again: Vec<u32>,
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
    /// The smallest step of the finest cascade.
    pub(super) step_min: f32,
    /// `None` where bins of time are not told apart.
    pub(super) spans: Option<Spans<'a>>,
}

impl Probed<'_> {
    /// The smallest step in a cell.
    fn step(&self, id: u32) -> f32 {
        self.step_min * (1_u32 << self.grid.coordinates(id).0) as f32
    }
}

impl Prober {
    /// Optical thickness of a smallest step in cells, each at a random point, written over `out`; cells that are full in some bins of
    /// time are added to `found`.
    ///
    /// Where something moves, a cell is probed at several times, and its fullest counts: what is there for a short while
    /// must not be taken for empty.
    pub(super) fn probe(&mut self, of: &Probed<'_>, cells: &[u32], out: &mut [f32], found: &mut Vec<Found>) {
        self.probe_once(of, 0, cells, out);
        if of.field.time_steps().differ() {
            self.bins.clear();
            self.bins.resize(cells.len(), 0);
            self.again.clear();
            self.again.extend(0..cells.len() as u32);
            self.find(of, 0, cells, out);
            self.probe_again(of, cells, out);
            let full = cells.iter().zip(&self.bins).filter(|(_, bins)| **bins != 0);
            found.extend(full.map(|(&cell, &bins)| Found { cell, bins }));
        }
        out.iter_mut().zip(cells).for_each(|(out, &id)| *out *= of.step(id));
    }

    /// All rounds after the first. Where a part of the field is for what moves, only of cells whose first point moves: what stands still
    /// was seen in the first round.
    fn probe_again(&mut self, of: &Probed<'_>, cells: &[u32], out: &mut [f32]) {
        if of.field.moving.is_some() {
            self.again.clone_from(&self.moving);
        }
        let mut some = std::mem::take(&mut self.cells);
        some.clear();
        some.extend(self.again.iter().map(|&i| cells[i as usize]));
        let mut now = std::mem::take(&mut self.now);
        let now_there = sized(&mut now, some.len());
        for round in 1..TIMES_OF_A_PROBE {
            self.probe_once(of, round, &some, now_there);
            self.find(of, round, &some, now_there);
            self.again.iter().zip(&*now_there).for_each(|(&i, now)| out[i as usize] = out[i as usize].max(*now));
        }
        (self.cells, self.now) = (some, now);
    }

    /// Mark the bins in which the cells of a round are full by its densities.
    fn find(&mut self, of: &Probed<'_>, round: u32, cells: &[u32], densities: &[f32]) {
        let Some(spans) = of.spans else { return };
        // What stands still is asked for in the first round alone, and is so at all times.
        let has_still = of.field.moving.is_some() && round == 0;
        let mut moving = self.moving.iter().peekable();
        for (i, (&id, &density)) in cells.iter().zip(densities).enumerate() {
            let moves = moving.next_if(|&&column| column as usize == i).is_some();
            if density * of.step(id) > spans.level {
                let bins = if has_still && !moves { spans.all } else { spans.bins[self.which[i] as usize] };
                self.bins[self.again[i] as usize] |= bins;
            }
        }
    }

    fn probe_once(&mut self, of: &Probed<'_>, round: u32, cells: &[u32], out: &mut [f32]) {
        let (Probed { grid, field, space, draws, .. }, n) = (of, cells.len());
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
        if let Some(part) = &field.moving {
            part.cells.columns(x, &mut self.moving);
        }
        if field.moving.is_none() || round == 0 {
            return field.densities(x, When { time_steps, which: &self.which }, out, &mut self.densities);
        }
        // What stands still was probed in the first round.
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
        let floats: usize = [&self.p, &self.x, &self.now, &self.was, &self.moved].iter().map(|v| v.capacity()).sum();
        let indices = [&self.which, &self.moving, &self.moving_which, &self.cells, &self.again];
        let indices: usize = indices.iter().map(|v| v.capacity()).sum();
        4 * (floats + indices) + 8 * self.bins.capacity() + self.densities.bytes()
    }
}
