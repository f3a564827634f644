//! An occupancy grid: rays are marched through what is not known to be empty (Müller et al., 2022, appendix E).
//!
//! The grid probes the field now and then; what the cameras and the alpha of the photos rule out is empty from the start.

use super::probe::{Draws, OCCUPIED_SHARE, Probed, Prober};
pub(crate) use super::silhouette::Moves;
use super::silhouette::{Seen, Silhouette};
use crate::fields::{Field, MovingCells};
use crate::free_space::{NearPlanes, free_cells};
use crate::space::{InternalRay, Space, SpaceConfig, SpaceKind};
use engine::data::Dataset;
use engine::system::{SystemError, Tensor, TensorMap, f32_tensor, take_f32, take_numbers};
use float_core::Simd;
use rayon::prelude::*;
use render_core::occupancy::{GridSettings, Marched, OccupancyGrid, RaySpan, StepRule};
use serde::{Deserialize, Serialize};
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
/// Samples of a ray at most: [`OccupancyConfig::check`] sees to it that no march ends early.
pub(crate) const MAX_SAMPLES: u32 = 1 << 16;
/// Where the sky's sample is, and how long: this many times the way to the end of the occupancy grid. There the contraction
/// leaves nothing of a ray but its direction, and any density is opaque.
const SKY: f32 = 1e3;
/// Thickness of a cell that is opened again, in thresholds: some probes may find nothing there before it counts as empty.
const REOPENED: f32 = 8.0;
/// Longest step: in a cascade the step doubles with the cells.
const STEP_MAX: f32 = 1e3;

/// Training begins with steps this many times as long, and never makes them longer.
const MAX_STRETCH: f32 = 8.0;
/// Largest change of the steps' length from one batch to the next.
const STRETCH_RATE: f32 = 1.05;

/// Settings of an occupancy grid. Lengths are internal.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OccupancyConfig {
    /// Cells along an axis of the occupancy grid.
    pub occupancy: usize,
    /// A cell is empty below this optical thickness at the smallest step.
    pub occupancy_threshold: f32,
    /// Steps in which that threshold rises to its place, from half the thickness of a step through the initial field.
    pub occupancy_settle: u64,
    /// Steps between updates of the occupancy grid.
    pub occupancy_every: u64,
    /// Smallest step along the ray.
    pub step_min: f32,
    /// Step per distance from the camera; 0 keeps the step constant.
    pub step_cone: f32,
    /// Samples a ray may have on average in training: where there are more, steps grow until empty space is known.
    pub samples_per_ray: f32,
    /// What lies before the points that photos show is empty from the start.
    pub free_space: bool,
    /// Every ray ends in one more sample, at infinity: the sky, which is a colour for each direction. Only where space is
    /// contracted.
    pub sky: bool,
}

impl OccupancyConfig {
    /// Check the ranges, in a space of `cascades` cubes.
    ///
    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    pub fn check(&self, cascades: usize) -> Result<(), SystemError> {
        let refuse =
            |field, value: String, problem: &str| Err(SystemError::Config { field, value, problem: problem.into() });
        for (field, value) in [
            ("step_min", f64::from(self.step_min)),
            ("samples_per_ray", f64::from(self.samples_per_ray)),
            ("occupancy_every", self.occupancy_every as f64),
            ("occupancy_threshold", f64::from(self.occupancy_threshold)),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return refuse(field, value.to_string(), "must be positive and finite");
            }
        }
        if !(0.0..=1.0).contains(&self.step_cone) {
            return refuse("step_cone", self.step_cone.to_string(), "must be in 0..=1");
        }
        if !(8..=512).contains(&self.occupancy) {
            return refuse("occupancy", self.occupancy.to_string(), "must be in 8..=512");
        }
        // Along the diagonal of the outermost cube: equal steps, then steps that grow with the distance.
        let diagonal = 3.0_f32.sqrt() * 2.0_f32.powi(cascades as i32);
        let equal = diagonal.min(self.step_min / self.step_cone);
        let steps = equal / self.step_min + (diagonal / equal).ln() / self.step_cone.max(f32::MIN_POSITIVE);
        let shortest = diagonal / 4e6;
        if !(shortest..=100.0).contains(&self.step_min) || steps > MAX_SAMPLES as f32 {
            let problem =
                format!("must be in {shortest:e}..=100, and make at most {MAX_SAMPLES} steps of a ray, not {steps:e}");
            return refuse("step_min", self.step_min.to_string(), &problem);
        }
        Ok(())
    }
}

/// The grid and the cells of the current update.
pub(crate) struct Occupancy {
    config: OccupancyConfig,
    cascades: usize,
    /// Optical thickness of a step through half the initial density.
    initial: f32,
    pub(crate) grid: OccupancyGrid,
    /// Training steps are this many times as long as the settings say, `>= 1`.
    pub(crate) stretch: f32,
    cells: Vec<u32>,
    thickness: Vec<f32>,
    /// Buffers that no task uses just now.
    probers: Mutex<Vec<Prober>>,
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

    /// Visit the samples of a ray.
    pub(crate) fn march(
        &self,
        grid: &OccupancyGrid,
        ray: &InternalRay,
        jitter: f32,
        mut visit: impl FnMut(f32, f32),
    ) -> Marched {
        let span = RaySpan { o: ray.o, d: ray.d, t_min: ray.start, t_max: ray.end };
        let mut marched = grid.march(&span, &self.rule, jitter, MAX_SAMPLES, |t, dt| {
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
            cells: Vec::new(),
            thickness: Vec::new(),
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
    }

    /// Grid and stretch of a checkpoint after `updates` updates.
    ///
    /// # Errors
    /// [`SystemError::State`] naming the array that is missing or does not fit.
    pub(crate) fn read_state(&self, state: &TensorMap, updates: u64) -> Result<(OccupancyGrid, f32), SystemError> {
        let thickness = take_f32(state, "occupancy.thickness", self.grid.cells())?;
        let stretch = take_numbers(state, "step.stretch", 1)?[0];
        if !(1.0..=MAX_STRETCH).contains(&stretch) {
            let problem = format!("{stretch}; 1 to {MAX_STRETCH} expected");
            return Err(SystemError::State { name: "step.stretch".into(), problem });
        }
        let grid = OccupancyGrid::from_state(self.settings(updates), &thickness, updates)
            .map_err(|e| SystemError::State { name: "occupancy.thickness".into(), problem: e.to_string() })?;
        Ok((grid, stretch))
    }

    fn settings(&self, updates: u64) -> GridSettings {
        settings(&self.config, self.cascades, self.initial, updates)
    }

    pub(crate) fn bytes(&self) -> usize {
        let probers = self.probers.lock().unwrap_or_else(PoisonError::into_inner);
        let probers: usize = probers.iter().map(Prober::bytes).sum();
        self.grid.memory_bytes() + 4 * (self.cells.capacity() + self.thickness.capacity()) + probers
    }

    /// Probe a share of the cells, each at a random point.
    pub(crate) fn update(&mut self, field: &Field, space: &Space, seed: u64, step: u64) {
        self.grid.set_threshold(self.settings(self.grid.updates() + 1).threshold);
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
        let (grid, step_min) = (&self.grid, self.config.step_min);
        // Whole blocks of `TASK` to each task.
        let share = TASK * self.cells.len().div_ceil(TASK * TASKS).max(1);
        let tasks = self.thickness.par_chunks_mut(share).zip(self.cells.par_chunks(share));
        // As many as there are threads, not tasks: what a prober holds from the task before says nothing about the next.
        let probers = &self.probers;
        let probed = Probed { grid, field, space, draws };
        let idle = || probers.lock().unwrap_or_else(PoisonError::into_inner);
        tasks.for_each(|(out, cells)| {
            let mut prober = idle().pop().unwrap_or_default();
            for (out, cells) in out.chunks_mut(TASK).zip(cells.chunks(TASK)) {
                prober.probe(&probed, cells, out);
                for (out, &id) in out.iter_mut().zip(cells) {
                    *out *= step_min * (1_u32 << grid.coordinates(id).0) as f32;
                }
            }
            idle().push(prober);
        });
        self.grid.update(&self.cells, &self.thickness);
    }

    /// Cells in which something moves may be full at other times: they are probed anew before they count as empty.
    pub(crate) fn reopen(&mut self, moving: &MovingCells, space: &Space) {
        let (settings, updates) = (self.settings(self.grid.updates()), self.grid.updates());
        let mut thickness = self.grid.thickness().to_vec();
        let (simd, mut x) = (Simd::best(), [0.0; 3]);
        for (id, thickness) in thickness.iter_mut().enumerate().filter(|(_, thickness)| **thickness >= 0.0) {
            space.grid_positions(simd, &self.grid.cell_point(id as u32, [0.5; 3]), &mut x);
            if moving.holds(x) {
                *thickness = thickness.max(REOPENED * settings.threshold);
            }
        }
        if let Ok(grid) = OccupancyGrid::from_state(settings, &thickness, updates) {
            self.grid = grid;
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
        let free =
            (self.config.free_space && scene == Moves::No).then(|| free_cells(grid, space, data, NearPlanes::Count));
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
