//! An occupancy grid: rays are marched through what is not known to be empty (Müller et al., 2022, appendix E).
//!
//! The grid probes the field now and then; what the cameras and the alpha of the photos rule out is empty from the start.

use super::occupancy_config::{MAX_SAMPLES, OccupancyConfig};
use super::probe::{Draws, Found, OCCUPIED_SHARE, Probed, Prober, Spans};
pub(crate) use super::silhouette::Moves;
use super::silhouette::{Seen, Silhouette};
use super::time_bins::{TimeBins, edges_of};
use crate::fields::Field;
use crate::free_space::{AlsoFree, free_cells};
use crate::space::{InternalRay, Space, SpaceConfig, SpaceKind};
use engine::data::Dataset;
use engine::system::{SystemError, Tensor, TensorMap, f32_tensor, take_f32, take_numbers};
use rayon::prelude::*;
use render_core::occupancy::{CellBits, GridSettings, Marched, OccupancyGrid, RaySpan, StepRule};
use std::ops::ControlFlow;
use std::sync::{Mutex, PoisonError};

/// An update probes one in this many cells, and at one in [`OCCUPIED_SHARE`] occupied ones.
const SHARE: u32 = 8;
/// The first updates probe every second cell, so that empty space is known early.
const EAGER_UPDATES: u64 = 16;
const EAGER_SHARE: u32 = 2;
/// Factor on a cell's running maximum each time it is probed. Faster than the paper's 0.95: a step of a CPU is worth
/// more, so empty space has to clear in fewer of them.
const DECAY: f32 = 0.8;
/// Cells probed together.
const TASK: usize = 4096;
/// One in this many photos whose alpha is a mask, drawn by hand or found, may be wrong about a cell.
const DOUBTED: usize = 10;
/// Tasks of an update at most.
const TASKS: usize = 32;
/// Where the sky's sample is, and how long: this many times the way to the end of the occupancy grid. There the contraction
/// leaves nothing of a ray but its direction, and any density is opaque.
const SKY: f32 = 1e3;
/// Longest step: in a cascade the step doubles with the cells.
const STEP_MAX: f32 = 1e3;

/// Training begins with steps this many times as long, and never makes them longer.
const MAX_STRETCH: f32 = 8.0;
/// Largest change of the steps' length from one batch to the next.
const STRETCH_RATE: f32 = 1.05;

/// The grid and the cells of the current update.
pub(crate) struct Occupancy {
    config: OccupancyConfig,
    cascades: usize,
    /// Optical thickness of a step through half the initial density.
    initial: f32,
    pub(crate) grid: OccupancyGrid,
    /// Training steps are this many times as long as the settings say, `>= 1`.
    pub(crate) stretch: f32,
    /// In which spans of time cells are full; `None` where the field does not depend on the time, or has too few.
    pub(super) times: Option<TimeBins>,
    cells: Vec<u32>,
    thickness: Vec<f32>,
    /// What each task of an update found full at some times.
    found: Vec<Vec<Found>>,
    /// Buffers that no task uses just now.
    probers: Mutex<Vec<Prober>>,
}

/// What a checkpoint says of an occupancy grid.
pub(crate) struct OccupancyState {
    grid: OccupancyGrid,
    stretch: f32,
    times: Option<TimeBins>,
}

/// Settings after a number of updates. The threshold begins below what the field starts with and rises to its place while
/// the field learns: cells must not be ruled out before they had their turn, nor keep a fog that nothing needs.
fn settings(config: &OccupancyConfig, cascades: usize, initial: f32, updates: u64) -> GridSettings {
    let settled = updates.saturating_mul(config.occupancy_every) as f32 / config.occupancy_settle.max(1) as f32;
    let last = config.occupancy_threshold;
    let first = initial.min(last);
    GridSettings::DEFAULT
        .with_resolution(config.occupancy as u32)
        .with_cascades(cascades as u32)
        .with_decay(DECAY)
        .with_threshold(first * (last / first).powf(settled.min(1.0)))
}

/// Step rule of a march.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Marcher {
    rule: StepRule,
    sky: bool,
}

impl Marcher {
    /// Length of the shortest step.
    pub(crate) fn shortest(&self) -> f32 {
        self.rule.dt_min
    }

    /// Visit the samples of a ray in what the grid counts as occupied.
    pub(crate) fn march(
        &self,
        grid: &OccupancyGrid,
        ray: &InternalRay,
        jitter: f32,
        visit: impl FnMut(f32, f32),
    ) -> Marched {
        self.march_in(grid, grid.occupied_set(), ray, jitter, visit)
    }

    /// Visit the samples of a ray in these cells of the grid.
    pub(crate) fn march_in(
        &self,
        grid: &OccupancyGrid,
        cells: &CellBits,
        ray: &InternalRay,
        jitter: f32,
        mut visit: impl FnMut(f32, f32),
    ) -> Marched {
        let span = RaySpan { o: ray.o, d: ray.d, t_min: ray.start, t_max: ray.end };
        let mut marched = grid.march_in(cells, &span, &self.rule, jitter, MAX_SAMPLES, |t, dt| {
            visit(t, dt);
            ControlFlow::Continue(())
        });
        if self.sky && ray.start < ray.end {
            visit(SKY * ray.end, SKY * ray.end);
            marched.samples += 1;
            marched.candidates += 1;
        }
        marched
    }
}

impl Occupancy {
    /// A grid of which nothing is known to be empty, for a field that begins with density `e^density_bias`.
    ///
    /// # Errors
    /// [`SystemError::Config`] for a grid that cannot be.
    pub(crate) fn new(config: OccupancyConfig, space: &SpaceConfig, density_bias: f32) -> Result<Self, SystemError> {
        let sky = config.sky && space.space == SpaceKind::Contracted;
        let config = OccupancyConfig { sky, ..config };
        let initial = 0.5 * density_bias.clamp(-80.0, 80.0).exp() * config.step_min;
        let settings = settings(&config, space.cascades, initial, 0);
        let grid = OccupancyGrid::new(settings).map_err(|e| SystemError::Config {
            field: "occupancy",
            value: config.occupancy.to_string(),
            problem: e.to_string(),
        })?;
        // Room for all that can be at work, so that none is allocated for later.
        let probers = Mutex::new(Vec::with_capacity(TASKS));
        Ok(Self {
            config,
            cascades: space.cascades,
            initial,
            grid,
            stretch: MAX_STRETCH,
            times: None,
            cells: Vec::new(),
            thickness: Vec::new(),
            found: Vec::with_capacity(TASKS),
            probers,
        })
    }

    /// The march of training and of renders.
    pub(crate) fn marcher(&self) -> Marcher {
        self.stretched(1.0)
    }

    /// The same with steps `times` as long.
    pub(crate) fn stretched(&self, times: f32) -> Marcher {
        let (stretch, config) = (self.stretch * times, &self.config);
        Marcher {
            rule: StepRule { dt_min: stretch * config.step_min, cone: stretch * config.step_cone, dt_max: STEP_MAX },
            sky: config.sky,
        }
    }

    /// The settings.
    pub(crate) fn config(&self) -> &OccupancyConfig {
        &self.config
    }

    /// The cells that may hold anything at a time in `[-1, 1]`; those of all times where it is not known which, or no time is given.
    pub(crate) fn cells_at(&self, time: Option<f32>) -> &CellBits {
        let visible = self.times.as_ref().zip(time).and_then(|(times, time)| times.visible_at(time));
        visible.unwrap_or(self.grid.occupied_set())
    }

    /// Whether anything may be at a point of the grid at such a time.
    pub(crate) fn holds(&self, p: [f32; 3], time: Option<f32>) -> bool {
        self.grid.holds(self.cells_at(time), p, 0.0)
    }

    /// Whether it is known at which times cells are full.
    pub(crate) fn tells_times(&self) -> bool {
        self.times.is_some()
    }

    /// Whether the grid probes the field before this step.
    pub(crate) fn is_due(&self, step: u64) -> bool {
        step.is_multiple_of(self.config.occupancy_every)
    }

    /// A batch had `per_ray` samples a ray: steps become longer or shorter, slowly.
    pub(crate) fn adapt(&mut self, per_ray: f32) {
        let change = (per_ray / self.config.samples_per_ray).clamp(1.0 / STRETCH_RATE, STRETCH_RATE);
        self.stretch = (self.stretch * change).clamp(1.0, MAX_STRETCH);
    }

    /// Share of the cells that are empty for good.
    pub(crate) fn carved(&self) -> f64 {
        1.0 - self.grid.visible_cells() as f64 / self.grid.cells() as f64
    }

    /// Everything the next step depends on, besides the number of updates.
    pub(crate) fn push_state<'a>(&'a self, out: &mut Vec<Tensor<'a>>) {
        out.push(f32_tensor("occupancy.thickness", self.grid.thickness()));
        out.push(f32_tensor("step.stretch", std::slice::from_ref(&self.stretch)));
        if let Some(times) = &self.times {
            times.push_state(out);
        }
    }

    /// What a checkpoint says after `updates` updates.
    ///
    /// # Errors
    /// [`SystemError::State`] naming the array that is missing or does not fit.
    pub(crate) fn read_state(&self, state: &TensorMap, updates: u64) -> Result<OccupancyState, SystemError> {
        let thickness = take_f32(state, "occupancy.thickness", self.grid.cells())?;
        let stretch = take_numbers(state, "step.stretch", 1)?[0];
        if !(1.0..=MAX_STRETCH).contains(&stretch) {
            let problem = format!("{stretch}; 1 to {MAX_STRETCH} expected");
            return Err(SystemError::State { name: "step.stretch".into(), problem });
        }
        let grid = OccupancyGrid::from_state(self.settings(updates), &thickness, updates)
            .map_err(|e| SystemError::State { name: "occupancy.thickness".into(), problem: e.to_string() })?;
        let times = TimeBins::of_state(state, &grid)?;
        Ok(OccupancyState { grid, stretch, times })
    }

    /// Go on from what [`Occupancy::read_state`] gave.
    pub(crate) fn restore(&mut self, state: OccupancyState) {
        OccupancyState { grid: self.grid, stretch: self.stretch, times: self.times } = state;
    }

    pub(super) fn settings(&self, updates: u64) -> GridSettings {
        settings(&self.config, self.cascades, self.initial, updates)
    }

    pub(crate) fn bytes(&self) -> usize {
        let probers = self.probers.lock().unwrap_or_else(PoisonError::into_inner);
        let probers: usize = probers.iter().map(Prober::bytes).sum();
        let times = self.times.as_ref().map_or(0, TimeBins::bytes);
        let found: usize = self.found.iter().map(|found| found.capacity() * size_of::<Found>()).sum();
        self.grid.memory_bytes() + 4 * (self.cells.capacity() + self.thickness.capacity()) + found + probers + times
    }

    /// Bytes by which it grows once bins of time are told apart, and a period of them is over.
    pub(crate) fn growth_bytes(&self) -> usize {
        let (bins, held) = match &self.times {
            Some(times) => (times.bins(), times.bytes()),
            None => (self.config.occupancy_times, 0),
        };
        TimeBins::bytes_of(bins, &self.grid).saturating_sub(held)
    }

    /// Bins of time as the field's time steps ask for them. What is known of them stays where they are the same.
    fn follow_times(&mut self, field: &Field) {
        let edges = edges_of(&field.time_steps().times, self.config.occupancy_times);
        if self.times.as_ref().map(TimeBins::edges) != edges.as_deref() {
            self.times = edges.map(|edges| TimeBins::new(edges, &self.grid));
        }
    }

    /// Probe a share of the cells, each at a random point.
    pub(crate) fn update(&mut self, field: &Field, space: &Space, seed: u64, step: u64) {
        self.grid.set_threshold(self.settings(self.grid.updates() + 1).threshold);
        self.follow_times(field);
        let update = self.grid.updates();
        let share = if update < EAGER_UPDATES { EAGER_SHARE } else { SHARE };
        let (phase, bits, thickness) = (update as u32, self.grid.bits(), self.grid.thickness());
        self.cells.clear();
        self.cells.extend((0..self.grid.cells() as u32).filter(|&id| {
            // Neighbours in number are neighbours in space: taking every eighth probes everywhere.
            let turn = id.wrapping_add(phase);
            let occupied = bits[id as usize / 64] >> (id % 64) & 1 == 1;
            let share = if occupied { share.min(OCCUPIED_SHARE) } else { share };
            thickness[id as usize] >= 0.0 && turn.is_multiple_of(share)
        }));
        let draws = Draws::new(seed, step, phase);
        self.thickness.resize(self.cells.len(), 0.0);
        let grid = &self.grid;
        let bins = self.times.as_ref().map(|times| times.bits_of(&field.time_steps().times));
        let spans = self.times.as_ref().zip(bins.as_deref());
        let spans = spans.map(|(times, bins)| Spans { bins, all: times.all(), level: grid.level() });
        // Whole blocks of `TASK` to each task.
        let share = TASK * self.cells.len().div_ceil(TASK * TASKS).max(1);
        // Never fewer: what an update does not need has its place at the next.
        let found = self.found.len().max(self.cells.len().div_ceil(share));
        self.found.resize_with(found, Vec::new);
        self.found.iter_mut().for_each(Vec::clear);
        let tasks = self.thickness.par_chunks_mut(share).zip(self.cells.par_chunks(share)).zip(&mut self.found);
        // As many as there are threads, not tasks: what a prober holds from the task before says nothing about the next.
        let probers = &self.probers;
        let probed = Probed { grid, field, space, draws, step_min: self.config.step_min, spans };
        let idle = || probers.lock().unwrap_or_else(PoisonError::into_inner);
        tasks.for_each(|((out, cells), found)| {
            let mut prober = idle().pop().unwrap_or_default();
            for (out, cells) in out.chunks_mut(TASK).zip(cells.chunks(TASK)) {
                prober.probe(&probed, cells, out, found);
            }
            idle().push(prober);
        });
        self.grid.update(&self.cells, &self.thickness);
        if let Some(times) = &mut self.times {
            times.learn(&self.found);
            times.refresh(&self.grid);
        }
    }

    /// Cells that no training view sees, or that a view with alpha sees through, are empty for good.
    ///
    /// # Errors
    /// [`SystemError::Scene`] when an image cannot be read.
    pub(crate) fn carve(&mut self, space: &Space, data: &Dataset, scene: Moves) -> Result<(), SystemError> {
        let views: Vec<Silhouette> =
            (0..data.len()).into_par_iter().map(|i| Silhouette::new(data, i, scene)).collect::<Result<_, _>>()?;
        let grid = &self.grid;
        let doubted = if data.is_cut_out() { data.len() / DOUBTED } else { 0 };
        let free = (self.config.free_space && scene == Moves::No)
            .then(|| free_cells(grid, space, data, AlsoFree::BeforePoints));
        let visible: Vec<bool> = (0..grid.cells() as u32)
            .into_par_iter()
            .map(|id| {
                if free.as_ref().is_some_and(|free| free[id as usize]) {
                    return false;
                }
                let (corner, side) = grid.cell_box(id);
                let centre = space.world_point(corner.map(|c| c + 0.5 * side));
                let reach = [0, 1, 2, 3, 4, 5, 6, 7]
                    .map(|k| space.world_point([0, 1, 2].map(|a| corner[a] + (k >> a & 1) as f32 * side)))
                    .map(|x| (x - centre).length())
                    .into_iter()
                    .fold(0.0, f64::max);
                let (mut seen, mut empty) = (false, 0);
                for view in &views {
                    match view.judge(centre, reach) {
                        Seen::Background => {
                            empty += 1;
                            if empty > doubted {
                                return false;
                            }
                        }
                        Seen::Something => seen = true,
                        Seen::Outside => {}
                    }
                    if seen && !view.has_alpha() {
                        return true;
                    }
                }
                seen
            })
            .collect();
        let mut cells = visible.iter();
        // Asked for every cell in order: none is marked yet.
        self.grid.mark_invisible(|_, _| cells.next().copied().unwrap_or(true));
        Ok(())
    }
}
