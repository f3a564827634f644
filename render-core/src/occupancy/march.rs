//! Marching a ray through the occupied cells.

use super::{CellBits, OccupancyGrid, max_abs, pow2};
use core::ops::ControlFlow;
use float_core::m32;

/// A ray and the part of it to march through.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RaySpan {
    /// Origin, grid coordinates.
    pub o: [f32; 3],
    /// Grid units for each unit of `t`: not necessarily of length 1.
    pub d: [f32; 3],
    /// Where to begin.
    pub t_min: f32,
    /// Where to stop.
    pub t_max: f32,
}

/// Distance from one sample to the next, in the unit of `t`: `clamp(t * cone, dt_min, dt_max)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepRule {
    /// Shortest step, `> 0`.
    pub dt_min: f32,
    /// Step for each unit of distance; 0 makes all steps `dt_min`.
    pub cone: f32,
    /// Longest step.
    pub dt_max: f32,
}

impl StepRule {
    /// Steps of one length.
    #[must_use]
    pub fn uniform(dt: f32) -> Self {
        Self { dt_min: dt, cone: 0.0, dt_max: dt }
    }

    /// Step of a sample at `t`.
    #[inline(always)]
    #[must_use]
    pub fn dt(&self, t: f32) -> f32 {
        (t * self.cone).min(self.dt_max).max(self.dt_min)
    }
}

/// What a march did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Marched {
    /// Samples handed to the visitor.
    pub samples: u32,
    /// Samples that a march of the same span without the grid would have taken.
    pub candidates: u32,
    /// Cells of the grid that were read.
    pub lookups: u32,
}

impl OccupancyGrid {
    /// Visit the samples of a ray that lie in occupied cells, front to back, as `visit(t, dt)`: a sample at distance `t`
    /// that stands for `[t, t + dt)`. Stops at the span's end, at the outermost cube, after `max_samples`, or when the
    /// visitor breaks.
    ///
    /// Samples lie on the lattice `t[0] = t_start + jitter * dt(t_start)`, `t[i + 1] = t[i] + dt(t[i])`, where `t_start` is
    /// the span's begin or where the ray enters the outermost cube. What is occupied does not move it: the samples are
    /// bit for bit those of a march through a full grid, less the ones in empty cells. Use a random `jitter` in `[0, 1)`
    /// to train and 0.5 to render.
    ///
    /// A span that is empty or not a number, or a zero or non-finite direction, has no samples.
    ///
    /// # Panics
    /// When a step of the rule is not positive, the longest is below the shortest, or the span is longer than `2^23` shortest
    /// steps.
    #[inline]
    pub fn march(
        &self,
        ray: &RaySpan,
        rule: &StepRule,
        jitter: f32,
        max_samples: u32,
        visit: impl FnMut(f32, f32) -> ControlFlow<()>,
    ) -> Marched {
        self.march_in(&self.occupied, ray, rule, jitter, max_samples, visit)
    }

    /// [`march`](Self::march), were these cells the occupied ones: the samples are those of a march through a full grid, bit for bit,
    /// less the ones outside of them. With a cell the coarser ones that it lies in must be among them, as [`lift`](Self::lift) adds
    /// them: where a coarse block has none, nothing of it is looked into.
    ///
    /// # Panics
    /// As [`march`](Self::march), and when the cells are of a smaller grid.
    #[inline]
    pub fn march_in(
        &self,
        cells: &CellBits,
        ray: &RaySpan,
        rule: &StepRule,
        jitter: f32,
        max_samples: u32,
        mut visit: impl FnMut(f32, f32) -> ControlFlow<()>,
    ) -> Marched {
        assert!(rule.dt_min > 0.0 && rule.dt_max >= rule.dt_min, "steps must be positive: {rule:?}");
        let mut marched = Marched::default();
        let Some(way) = Way::new(ray, self.half_extent()) else { return marched };
        assert!(
            way.t_end - way.t_start < MAX_STEPS * rule.dt_min,
            "steps of {} are too short for a span of {}",
            rule.dt_min,
            way.t_end - way.t_start
        );
        let mut lattice = Lattice::new(rule, way.t_start + jitter * rule.dt(way.t_start), way.t_start);
        let side = self.cell_side(0);
        while lattice.t < way.t_end && marched.samples < max_samples {
            let p: [f32; 3] = core::array::from_fn(|a| ray.o[a] + lattice.t * ray.d[a]);
            let k = self.cascade(p, lattice.dt() * way.length);
            let (id, x) = self.locate(p, k);
            marched.lookups += 1;
            // The largest block around the cell, 1, 4 or 16 cells wide, that is known to be all empty or all full.
            let (word, words) = (cells.bits[id as usize >> 6], cells.blocks[id as usize >> 12]);
            let block = 2 * (u32::from(word == 0 || word == u64::MAX) + u32::from(words == 0));
            let exit = way.exit(x, block, side * pow2(k), pow2(k)).min(way.t_end);
            if word >> (id & 63) & 1 == 0 {
                marched.candidates += lattice.skip_to(exit);
                continue;
            }
            loop {
                marched.samples += 1;
                marched.candidates += 1;
                if visit(lattice.t, lattice.dt()).is_break() {
                    return marched;
                }
                lattice.step();
                if lattice.t >= exit || marched.samples >= max_samples {
                    break;
                }
            }
        }
        marched
    }
}

/// Samples are counted in `f32`: beyond this many shortest steps they would run together.
const MAX_STEPS: f32 = (1 << 23) as f32;

/// A ray prepared for finding the exits of boxes.
struct Way {
    t_start: f32,
    t_end: f32,
    /// Length of the direction.
    length: f32,
    /// Origin, moved forward by what rounding may hide: exits come out early, never late.
    o: [f32; 3],
    /// 1 / direction; 0 where the ray runs along the faces.
    inv: [f32; 3],
    /// Infinite where the ray runs along the faces.
    never: [f32; 3],
    /// 1 where the direction is positive: which face is the exit.
    ahead: [u32; 3],
}

impl Way {
    fn new(ray: &RaySpan, half: f32) -> Option<Self> {
        let length = m32::sqrt(ray.d[0] * ray.d[0] + ray.d[1] * ray.d[1] + ray.d[2] * ray.d[2]);
        if !(length > 0.0 && length.is_finite() && ray.t_min < ray.t_max && ray.o.iter().all(|x| x.is_finite())) {
            return None;
        }
        let (mut t_start, mut t_end) = (ray.t_min, ray.t_max);
        let largest = max_abs(ray.o) + 2.0 * half;
        // Sixteen roundings of the largest number that goes into a position.
        let slack = 8.0 * f32::EPSILON * largest;
        let mut way = Self { t_start, t_end, length, o: ray.o, inv: [0.0; 3], never: [0.0; 3], ahead: [0; 3] };
        for a in 0..3 {
            let (o, d) = (ray.o[a], ray.d[a]);
            let inv = 1.0 / d;
            if !inv.is_finite() {
                // Along the faces, or so nearly that no exit can be told: inside for good, or outside.
                if o.abs() > half {
                    return None;
                }
                way.never[a] = f32::INFINITY;
                continue;
            }
            let (near, far) = ((-half * d.signum() - o) * inv, (half * d.signum() - o) * inv);
            t_start = t_start.max(near);
            t_end = t_end.min(far);
            way.inv[a] = inv;
            way.ahead[a] = u32::from(d > 0.0);
            way.o[a] = o + slack * d.signum();
        }
        (way.t_start, way.t_end) = (t_start, t_end);
        (t_start < t_end && t_start.is_finite()).then_some(way)
    }

    /// Where the ray leaves the block of `2^block` cells of side `side` that holds the cell `x` of the cube of half side
    /// `half`; never later than it really does.
    #[inline(always)]
    fn exit(&self, x: [u32; 3], block: u32, side: f32, half: f32) -> f32 {
        let mut exit = f32::INFINITY;
        for (a, x) in x.into_iter().enumerate() {
            let face = ((x >> block) + self.ahead[a]) << block;
            let t = (face as f32 * side - half - self.o[a]) * self.inv[a] + self.never[a];
            if t < exit {
                exit = t;
            }
        }
        exit
    }
}

/// The sample positions: equal steps, then growing ones, then equal ones again.
struct Lattice {
    t: f32,
    /// Position of sample 0 of this stretch, and how far along it we are. While steps grow only `t` counts.
    base: f32,
    n: f32,
    step: f32,
    inv_step: f32,
    /// Sample of the stretch from which steps grow.
    n_grow: f32,
    /// Whether steps grow here.
    grows: bool,
    /// Distance from which they are longest.
    t_long: f32,
    cone: f32,
    dt_max: f32,
}

impl Lattice {
    fn new(rule: &StepRule, t: f32, t_start: f32) -> Self {
        // A step that does not change the distance would never end.
        let cone = if rule.cone > 1e-6 && rule.dt_max > rule.dt_min { rule.cone } else { 0.0 };
        let t_grow = if cone > 0.0 { rule.dt_min / cone } else { f32::INFINITY };
        let mut lattice = Self {
            t,
            base: t,
            n: 0.0,
            step: rule.dt_min,
            inv_step: 1.0 / rule.dt_min,
            n_grow: f32::INFINITY,
            grows: false,
            t_long: if cone > 0.0 { rule.dt_max / cone } else { f32::INFINITY },
            cone,
            dt_max: rule.dt_max,
        };
        if cone == 0.0 {
            lattice.step = rule.dt(t_start);
            lattice.inv_step = 1.0 / lattice.step;
        } else if t >= lattice.t_long {
            lattice.lengthen();
        } else if t >= t_grow {
            lattice.grows = true;
        } else {
            lattice.n_grow = m32::ceil((t_grow - t) * lattice.inv_step);
        }
        lattice
    }

    #[inline(always)]
    fn dt(&self) -> f32 {
        if self.grows { (self.t * self.cone).min(self.dt_max) } else { self.step }
    }

    /// Steps are longest from here on.
    fn lengthen(&mut self) {
        self.grows = false;
        self.base = self.t;
        self.n = 0.0;
        self.n_grow = f32::INFINITY;
        self.step = self.dt_max;
        self.inv_step = 1.0 / self.dt_max;
    }

    /// Go to the next sample.
    #[inline(always)]
    fn step(&mut self) {
        if self.grows {
            self.grow();
        } else {
            self.go_to(self.n + 1.0);
        }
    }

    #[inline(always)]
    fn grow(&mut self) {
        self.t += self.dt();
        if self.t >= self.t_long {
            self.lengthen();
        }
    }

    /// To sample `n` of the stretch, which must not lie past its end.
    #[inline(always)]
    fn go_to(&mut self, n: f32) {
        self.n = n;
        self.t = self.base + n * self.step;
        if n >= self.n_grow {
            self.grows = true;
        }
    }

    /// Go to the first sample at or behind `target`, by one step at least; how many steps that were.
    #[inline(always)]
    fn skip_to(&mut self, target: f32) -> u32 {
        let mut steps = 0;
        loop {
            if self.grows {
                self.grow();
                steps += 1;
            } else {
                // 0.99: rather one sample too early, whose cell is read again, than one too late.
                let n = ((target - self.base) * self.inv_step + 0.99) as u32 as f32;
                let n = n.max(self.n + 1.0).min(self.n_grow);
                steps += (n - self.n) as u32;
                self.go_to(n);
                if !self.grows {
                    return steps;
                }
            }
            if self.t >= target {
                return steps;
            }
        }
    }
}
