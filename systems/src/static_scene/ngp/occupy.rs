//! The occupancy grid of the field: what it looks at, when, and what the alpha of the photos rules out at the start.

use super::NgpConfig;
use super::field::{DensityScratch, Field, When};
use crate::buffers::sized;
use crate::free_space::{NearPlanes, free_cells};
use crate::space::{InternalRay, Space, SpaceKind};
use engine::data::Dataset;
use engine::system::SystemError;
use field_core::rng::Rng;
use glam::DVec3;
use rayon::prelude::*;
use render_core::camera::Prepared;
use render_core::occupancy::{Marched, OccupancyGrid, RaySpan, Settings, StepRule};
use std::ops::ControlFlow;
use std::sync::{Mutex, PoisonError};

/// Stream of the points looked at, and of their moments within it.
const POINTS: u64 = 0x6f63_6375;
const MOMENTS: u64 = 0x6d6f_6d65;
/// Each update looks at one of so many cells, and at one of so many occupied ones.
const SHARE: u32 = 8;
const OCCUPIED_SHARE: u32 = 4;
/// The first updates look at every second cell, so that empty space is known early.
const EAGER_UPDATES: u64 = 16;
const EAGER_SHARE: u32 = 2;
/// Factor on a cell's running maximum each time it is looked at. Faster than the paper's 0.95: a step of a CPU is worth
/// more, so empty space has to clear in fewer of them.
const DECAY: f32 = 0.8;
/// Moments in which a cell is looked at where things move: it is full now and then.
const MOMENTS_OF_A_LOOK: u32 = 4;
/// From one moment to the next that a cell is looked at in, as a share of all: the golden ratio leaves no gap for long.
const NEXT_MOMENT: f64 = 0.618_033_988_749_894_9;
/// Cells looked at together.
const TASK: usize = 4096;
/// One in so many photos whose alpha is a mask, drawn by hand or found, may be wrong about a cell.
const DOUBTED: usize = 10;
/// Tasks of an update at most.
const TASKS: usize = 32;
/// Samples of a ray at most: [`super::NgpConfig::check`] sees to it that no march ends early.
pub(super) const MAX_SAMPLES: u32 = 1 << 16;
/// Where the sky's sample is, and how long: so many times the way to the end of the occupancy grid. There the contraction
/// leaves nothing of a ray but its direction, and any density is opaque.
const SKY: f32 = 1e3;
/// Longest step: in a cascade the step doubles with the cells.
const STEP_MAX: f32 = 1e3;

/// The grid and the cells of the current update.
pub(super) struct Occupy {
    pub(super) grid: OccupancyGrid,
    step_min: f32,
    cells: Vec<u32>,
    thickness: Vec<f32>,
    /// Buffers that no task uses just now.
    lookers: Mutex<Vec<Looker>>,
}

/// Buffers of a task of an update.
#[derive(Default)]
struct Looker {
    densities: DensityScratch,
    p: Vec<f32>,
    x: Vec<f32>,
    /// Views whose moments are looked at, and what is seen in one of them; only where something moves.
    which: Vec<u32>,
    now: Vec<f32>,
}

/// Where in its cell, and in which moments, an update looks.
struct Draws {
    points: Rng,
    moments: Rng,
    /// Number of the update.
    phase: u32,
}

impl Draws {
    /// Which of so many moments a cell is looked at in: what is empty has to be so at all times. Moments of successive looks are
    /// far from each other and leave no gap for long, so that what is there for a twentieth of the time is seen every few looks.
    fn moment(&self, id: u32, round: u32, moments: usize) -> u32 {
        let look = u64::from(id.wrapping_add(self.phase) / OCCUPIED_SHARE);
        let steps = (look * u64::from(MOMENTS_OF_A_LOOK) + u64::from(round)) as f64;
        let at = (f64::from(self.moments.uniform_at(id.into())) + steps * NEXT_MOMENT).fract();
        ((at * moments as f64) as u32).min(moments as u32 - 1)
    }
}

/// Step rule of a march.
#[derive(Clone, Copy, Debug)]
pub(super) struct Marcher {
    rule: StepRule,
    sky: bool,
}

impl Marcher {
    /// Length of the shortest step.
    pub(super) fn shortest(&self) -> f32 {
        self.rule.dt_min
    }

    /// Visit the samples of a ray.
    pub(super) fn march(
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
            marched.lattice += 1;
        }
        marched
    }
}

impl Occupy {
    pub(super) fn new(config: &NgpConfig) -> Result<Self, SystemError> {
        let settings = Self::settings(config, 0);
        let grid = OccupancyGrid::new(settings).map_err(|e| SystemError::Config {
            field: "occupancy",
            value: config.occupancy.to_string(),
            problem: e.to_string(),
        })?;
        // Room for all that can be at work, so that none is allocated for later.
        let lookers = Mutex::new(Vec::with_capacity(TASKS));
        Ok(Self { grid, step_min: config.step_min, cells: Vec::new(), thickness: Vec::new(), lookers })
    }

    /// Settings after so many updates. The threshold begins below what the field starts with and rises to its place while
    /// the field learns: cells must not be ruled out before they had their turn, nor keep a fog that nobody needs.
    pub(super) fn settings(config: &NgpConfig, updates: u64) -> Settings {
        let settled = updates.saturating_mul(config.occupancy_every) as f32 / config.occupancy_settle.max(1) as f32;
        let last = config.occupancy_threshold;
        let first = (0.5 * config.density_bias.clamp(-80.0, 80.0).exp() * config.step_min).min(last);
        Settings {
            resolution: config.occupancy as u32,
            cascades: config.cascades as u32,
            decay: DECAY,
            threshold: first * (last / first).powf(settled.min(1.0)),
        }
    }

    /// March with steps `stretch` times as long as the settings say.
    pub(super) fn marcher(&self, config: &NgpConfig, stretch: f32) -> Marcher {
        Marcher {
            rule: StepRule { dt_min: stretch * config.step_min, cone: stretch * config.step_cone, dt_max: STEP_MAX },
            sky: config.sky && config.space == SpaceKind::Contracted,
        }
    }

    pub(super) fn bytes(&self) -> usize {
        let lookers = self.lookers.lock().unwrap_or_else(PoisonError::into_inner);
        let lookers: usize = lookers.iter().map(Looker::bytes).sum();
        self.grid.memory_bytes() + 4 * (self.cells.capacity() + self.thickness.capacity()) + lookers
    }

    /// Look at a share of the cells, each at a random point.
    pub(super) fn update(&mut self, config: &NgpConfig, field: &Field, space: &Space, seed: u64, step: u64) {
        self.grid.set_threshold(Self::settings(config, self.grid.updates() + 1).threshold);
        let update = self.grid.updates();
        let share = if update < EAGER_UPDATES { EAGER_SHARE } else { SHARE };
        let (phase, bits, thickness) = (update as u32, self.grid.bits(), self.grid.thickness());
        self.cells.clear();
        self.cells.extend((0..self.grid.cells() as u32).filter(|&id| {
            // Neighbours in number are neighbours in space: taking every eighth looks everywhere.
            let turn = id.wrapping_add(phase);
            let occupied = bits[id as usize / 64] >> (id % 64) & 1 == 1;
            let share = if occupied { share.min(OCCUPIED_SHARE) } else { share };
            thickness[id as usize] >= 0.0 && turn.is_multiple_of(share)
        }));
        let draws = Draws { points: Rng::new(seed, POINTS).substream(step), moments: Rng::new(seed, MOMENTS), phase };
        self.thickness.resize(self.cells.len(), 0.0);
        let (grid, step_min) = (&self.grid, self.step_min);
        // Whole blocks of `TASK` to each task.
        let share = TASK * self.cells.len().div_ceil(TASK * TASKS).max(1);
        let tasks = self.thickness.par_chunks_mut(share).zip(self.cells.par_chunks(share));
        // As many as there are threads, not tasks: what a looker holds from the task before says nothing about the next.
        let lookers = &self.lookers;
        let idle = || lookers.lock().unwrap_or_else(PoisonError::into_inner);
        tasks.for_each(|(out, cells)| {
            let mut looker = idle().pop().unwrap_or_default();
            for (out, cells) in out.chunks_mut(TASK).zip(cells.chunks(TASK)) {
                looker.look(grid, field, space, &draws, cells, out);
                for (out, &id) in out.iter_mut().zip(cells) {
                    *out *= step_min * (1_u32 << grid.coordinates(id).0) as f32;
                }
            }
            idle().push(looker);
        });
        self.grid.update(&self.cells, &self.thickness);
    }

    /// See [`super::Ngp::carve`].
    pub(super) fn carve(
        &mut self,
        config: &NgpConfig,
        space: &Space,
        data: &Dataset,
        scene: Moves,
    ) -> Result<(), SystemError> {
        let views: Vec<Silhouette> =
            (0..data.len()).into_par_iter().map(|i| Silhouette::new(data, i, scene)).collect::<Result<_, _>>()?;
        let grid = &self.grid;
        let doubted = if data.is_cut_out() { data.len() / DOUBTED } else { 0 };
        let free = (config.free_space && scene == Moves::No).then(|| free_cells(grid, space, data, NearPlanes::Count));
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
                    match view.look(centre, reach) {
                        Sight::Background => {
                            empty += 1;
                            if empty > doubted {
                                return false;
                            }
                        }
                        Sight::Something => seen = true,
                        Sight::Outside => {}
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

impl Looker {
    /// Densities of cells, each at a random point, written over `out`.
    ///
    /// Where something moves, a cell is looked at in several moments, and its fullest counts: what is there for a short while
    /// must not be taken for empty.
    fn look(
        &mut self,
        grid: &OccupancyGrid,
        field: &Field,
        space: &Space,
        draws: &Draws,
        cells: &[u32],
        out: &mut [f32],
    ) {
        if !field.moments().differ() {
            return self.look_once((grid, field, space), (draws, 0), cells, out);
        }
        out.fill(0.0);
        for round in 0..MOMENTS_OF_A_LOOK {
            let mut now = std::mem::take(&mut self.now);
            self.look_once((grid, field, space), (draws, round), cells, sized(&mut now, cells.len()));
            out.iter_mut().zip(&now).for_each(|(out, now)| *out = out.max(*now));
            self.now = now;
        }
    }

    fn look_once(
        &mut self,
        (grid, field, space): (&OccupancyGrid, &Field, &Space),
        (draws, round): (&Draws, u32),
        cells: &[u32],
        out: &mut [f32],
    ) {
        let n = cells.len();
        let moments = field.moments();
        let points = if moments.differ() { draws.points.substream(1 + u64::from(round)) } else { draws.points };
        let p = sized(&mut self.p, 3 * n);
        for (i, &id) in cells.iter().enumerate() {
            let u = [0, 1, 2].map(|a| points.uniform_at(3 * u64::from(id) + a));
            let point = grid.cell_point(id, u);
            (p[i], p[n + i], p[2 * n + i]) = (point[0], point[1], point[2]);
        }
        let x = sized(&mut self.x, 3 * n);
        space.grid_positions(field.simd, p, x);
        self.which.clear();
        if let 1.. = moments.len() {
            self.which.extend(cells.iter().map(|&id| draws.moment(id, round, moments.len())));
        }
        field.densities(x, When { moments, which: &self.which }, out, &mut self.densities);
    }

    fn bytes(&self) -> usize {
        4 * (self.p.capacity() + self.x.capacity()) + self.densities.bytes()
    }
}

/// Whether a scene moves: what one photo sees through may be full in the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Moves {
    No,
    Yes,
}

/// What a view says about a ball.
enum Sight {
    /// All of it lies before transparent pixels: nothing is there.
    Background,
    /// Part of it is seen.
    Something,
    /// It is not in the picture.
    Outside,
}

/// A camera and the pixels of its image that are not fully transparent, summed up.
struct Silhouette {
    camera: Prepared,
    size: [i64; 2],
    focal: f64,
    axis: DVec3,
    centre: DVec3,
    /// `[height + 1][width + 1]` pixels with alpha before and above; empty without alpha.
    sums: Vec<u32>,
}

impl Silhouette {
    fn new(data: &Dataset, i: usize, scene: Moves) -> Result<Self, SystemError> {
        let image = data.image(i)?;
        let (w, h) = (image.width as usize, image.height as usize);
        let mut sums = Vec::new();
        if image.channels == 4 && scene == Moves::No {
            sums.resize((w + 1) * (h + 1), 0);
            for y in 0..h {
                let mut row = 0;
                for x in 0..w {
                    row += u32::from(image.data[4 * (y * w + x) + 3] > 0);
                    sums[(y + 1) * (w + 1) + x + 1] = sums[y * (w + 1) + x + 1] + row;
                }
            }
        }
        let camera = data.view(i).camera;
        Ok(Self {
            camera: camera.prepare(),
            size: [w as i64, h as i64],
            focal: camera.fx.max(camera.fy),
            axis: camera.optical_axis(),
            centre: camera.pose.c,
            sums,
        })
    }

    fn has_alpha(&self) -> bool {
        !self.sums.is_empty()
    }

    /// A ball of radius `reach` about `x`.
    fn look(&self, x: DVec3, reach: f64) -> Sight {
        let depth = (x - self.centre).dot(self.axis);
        if depth < -reach {
            return Sight::Outside;
        }
        if depth <= 2.0 * reach {
            // So near that the ball fills the view.
            return Sight::Something;
        }
        let Some(p) = self.camera.project(x) else { return Sight::Outside };
        // A pixel more for interpolation and rounding; 1.5 for what perspective and lens add off the axis.
        let radius = 1.5 * reach * self.focal / (depth - reach) + 1.0;
        let range = |c: f64, size: i64| {
            let (low, high) = ((c - radius).floor(), (c + radius).ceil());
            (low.max(0.0) as i64, (high.min(size as f64)) as i64, low < 0.0 || high > size as f64)
        };
        let (x0, x1, cut_x) = range(p.x, self.size[0]);
        let (y0, y1, cut_y) = range(p.y, self.size[1]);
        if x0 >= x1 || y0 >= y1 {
            return Sight::Outside;
        }
        if !self.has_alpha() || cut_x || cut_y {
            return Sight::Something;
        }
        let at = |x: i64, y: i64| u64::from(self.sums[(y * (self.size[0] + 1) + x) as usize]);
        if at(x1, y1) + at(x0, y0) == at(x0, y1) + at(x1, y0) { Sight::Background } else { Sight::Something }
    }
}
