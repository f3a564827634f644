//! Density first: along the rays of a chunk in rounds, until each is opaque. Only what lies in front goes on to the colour
//! network and the backward pass.
//!
//! A round encodes the next samples of all rays that are not opaque yet and asks the density network alone. A ray
//! ends behind the sample at which its transmittance falls below [`super::BatchConfig::train_stop`]; what is left out
//! changes a pixel by that much at most ([`render_core::budget`]). Samples that hardly weigh anything are left out too, where
//! that is asked for: together at most [`super::BatchConfig::train_faint`] of a ray's weight.

use super::context::StepContext;
use crate::buffers::sized;
use crate::fields::{Mixed, MovingPoints, Placing, When};
use crate::samplers::{CutRoom, Intervals, Marcher, Occupancy, Proposed};
use crate::space::InternalRay;
use std::ops::Range;

/// Samples of each ray in one round.
const ROUND: usize = 16;
/// A sample is faint below this part of what a ray may lose: the first of them do not use up what is there for all.
const FAINT_SAMPLES: f32 = 32.0;

/// The samples of a chunk's rays, and which of them the rays keep.
#[derive(Default)]
pub(super) struct Prepass {
    /// `[rays + 1]`, all samples of the march.
    offsets: Vec<u32>,
    t: Vec<f32>,
    dt: Vec<f32>,
    /// Rays that are not opaque yet.
    alive: Vec<u32>,
    /// `[rays]`, optical depth so far.
    depth: Vec<f64>,
    /// `[rays]`, samples evaluated.
    evaluated: Vec<u32>,
    /// `[rays]`, samples to keep among them, and the weight that is lost with the others.
    kept: Vec<u32>,
    lost: Vec<f32>,
    rounds: Vec<Round>,
    p: Vec<f32>,
    raw: Vec<f32>,
    mlp: Vec<f32>,
    placing: Placing,
    /// Samples of a round at which something moves.
    moving: MovingPoints,
    mixed: Mixed,
    cut: CutRoom,
    /// Samples a march without the occupancy grid would have placed.
    pub(super) dense: u64,
}

/// What one round saw.
#[derive(Default)]
struct Round {
    /// Columns.
    n: usize,
    runs: Vec<Run>,
    /// Columns that are kept, in order.
    columns: Vec<u32>,
    /// `[3][n]`, positions in the grid: canonical ones, and those at the rays' own time where something moves.
    x: Vec<f32>,
    was: Vec<f32>,
    /// `[n]`, views; only where something moves.
    which: Vec<u32>,
    /// `[rows][n]`
    features: Vec<f32>,
}

/// A ray's columns in a round.
#[derive(Clone, Copy)]
struct Run {
    ray: u32,
    /// The first column and their number.
    first: u32,
    len: u32,
    /// The first of its samples among all that were placed.
    from: u32,
    /// Those kept: the first in [`Round::columns`], their number, and where they go among the ray's.
    kept: u32,
    count: u32,
    place: u32,
}

impl Run {
    /// Where what is kept of it goes; `offsets` are those of the rays.
    fn target(&self, offsets: &[u32]) -> Range<usize> {
        let to = (offsets[self.ray as usize] + self.place) as usize;
        to..to + self.count as usize
    }
}

impl Round {
    fn bytes(&self) -> usize {
        let numbers = self.columns.capacity() + self.which.capacity();
        4 * (numbers + self.x.capacity() + self.was.capacity() + self.features.capacity())
    }

    /// Columns of a run that are kept.
    fn kept(&self, run: &Run) -> &[u32] {
        &self.columns[run.kept as usize..][..run.count as usize]
    }
}

/// Where the kept samples go, ray after ray.
pub(super) struct Kept<'a> {
    /// `[rays + 1]`
    pub(super) offsets: &'a mut Vec<u32>,
    /// `[n]`, distances and steps.
    pub(super) t: &'a mut Vec<f32>,
    pub(super) dt: &'a mut Vec<f32>,
    /// `[3][n]`, positions in the grid, as in [`Round`].
    pub(super) x: &'a mut Vec<f32>,
    pub(super) was: &'a mut Vec<f32>,
    /// `[n]`, views; only where something moves.
    pub(super) which: &'a mut Vec<u32>,
    /// `[rows][n]`
    pub(super) features: &'a mut Vec<f32>,
}

impl Prepass {
    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        let rounds: usize = self.rounds.iter().map(Round::bytes).sum();
        let counts = self.offsets.capacity() + self.alive.capacity() + self.evaluated.capacity() + self.kept.capacity();
        let floats = self.t.capacity() + self.dt.capacity() + self.p.capacity() + self.raw.capacity();
        rounds
            + 4 * (counts + floats + self.lost.capacity())
            + self.placing.bytes()
            + self.moving.bytes()
            + self.mixed.bytes()
    }

    /// Samples the march placed.
    pub(super) fn placed(&self) -> u64 {
        self.t.len() as u64
    }

    /// Samples that the rays evaluated before they were opaque or ended.
    pub(super) fn evaluated(&self) -> u64 {
        self.evaluated.iter().map(|&n| u64::from(n)).sum()
    }

    /// Place samples along the rays, skipping what the occupancy grid knows to be empty at the time of each. `rays` are the
    /// batch's `range`.
    pub(super) fn march(
        &mut self,
        ctx: &StepContext<'_>,
        occupancy: &Occupancy,
        marcher: Marcher,
        rays: &[InternalRay],
        range: Range<usize>,
    ) {
        self.dense = 0;
        self.t.clear();
        self.dt.clear();
        self.offsets.clear();
        self.offsets.push(0);
        for (ray, i) in rays.iter().zip(range) {
            let pixel = i / ctx.per_pixel;
            if ctx.batch.weight[pixel] > 0.0 {
                if ctx.head.is_some() && ray.start < ray.end {
                    // The veil: see `super::head`.
                    self.t.push(ray.start);
                    self.dt.push(marcher.shortest());
                }
                let first = self.t.len();
                let (all_t, all_dt) = (&mut self.t, &mut self.dt);
                let visit = |t, dt| {
                    all_t.push(t);
                    all_dt.push(dt);
                };
                let cells = occupancy.cells_at(ctx.time_of(pixel));
                let marched = marcher.march_in(&occupancy.grid, cells, ray, ctx.jitter[i], visit);
                self.dense += u64::from(marched.candidates);
                if let Some(cues) = ctx.cues {
                    let (start, end, measured) = (ray.start, ray.end, ctx.measured(pixel));
                    let intervals = Intervals { t: &mut self.t, dt: &mut self.dt, first };
                    self.dense += u64::from(cues.cut(start, end, measured, ctx.jitter[i], intervals, &mut self.cut));
                }
            }
            self.offsets.push(self.t.len() as u32);
        }
    }

    /// Take the intervals that proposals cut.
    pub(super) fn take(&mut self, proposed: &Proposed, rays: usize) {
        proposed.intervals(rays, &mut self.t, &mut self.dt, &mut self.offsets);
        self.dense = self.placed();
    }

    /// Follow the rays until they are opaque or end; what they keep is written over `out`. Returns its number of samples.
    /// `views` are those of the rays.
    pub(super) fn follow(
        &mut self,
        ctx: &StepContext<'_>,
        rays: &[InternalRay],
        views: impl Fn(usize) -> u32,
        out: Kept<'_>,
    ) -> usize {
        self.depth.clear();
        self.depth.resize(rays.len(), 0.0);
        for counts in [&mut self.evaluated, &mut self.kept] {
            counts.clear();
            counts.resize(rays.len(), 0);
        }
        self.lost.clear();
        self.lost.resize(rays.len(), 0.0);
        self.alive.clear();
        self.alive.extend(0..rays.len() as u32);
        let mut count = 0;
        loop {
            let (offsets, evaluated) = (&self.offsets, &self.evaluated);
            // Rays that are opaque have been taken out; this takes out those at their end.
            self.alive.retain(|&r| offsets[r as usize] + evaluated[r as usize] < offsets[r as usize + 1]);
            if self.alive.is_empty() {
                break;
            }
            if self.rounds.len() == count {
                self.rounds.push(Round::default());
            }
            self.round(ctx, rays, &views, count);
            count += 1;
        }
        self.gather(ctx, count, out)
    }

    fn round(&mut self, ctx: &StepContext<'_>, rays: &[InternalRay], views: &impl Fn(usize) -> u32, index: usize) {
        let (field, round) = (ctx.field, &mut self.rounds[index]);
        round.runs.clear();
        let mut n = 0;
        for &ray in &self.alive {
            let from = self.offsets[ray as usize] + self.evaluated[ray as usize];
            let len = (self.offsets[ray as usize + 1] - from).min(ROUND as u32);
            round.runs.push(Run { ray, first: n, len, from, kept: 0, count: 0, place: 0 });
            n += len;
        }
        let n = n as usize;
        round.n = n;
        let p = sized(&mut self.p, 3 * n);
        for run in &round.runs {
            let ray = &rays[run.ray as usize];
            for k in 0..run.len {
                let (i, at) = ((run.first + k) as usize, ray.at(self.t[(run.from + k) as usize]));
                (p[i], p[n + i], p[2 * n + i]) = (at[0], at[1], at[2]);
            }
        }
        let x = sized(&mut round.x, 3 * n);
        ctx.space.grid_positions(field.simd, p, x);
        round.which.clear();
        if field.deform.is_some() {
            sized(&mut round.was, 3 * n).copy_from_slice(x);
        }
        if field.is_timed() {
            for run in &round.runs {
                round.which.extend(std::iter::repeat_n(views(run.ray as usize), run.len as usize));
            }
        }
        let features = sized(&mut round.features, field.rows() * n);
        let when = When { time_steps: ctx.time_steps, which: &round.which };
        field.seen(x, when, features, &mut self.placing);
        let raw = sized(&mut self.raw, field.density.outputs() * n);
        let mlp = sized(&mut self.mlp, field.density.infer_scratch_len());
        field.density.infer(field.simd, &field.density_packed, features, n, n, raw, n, mlp);
        if let Some(part) = &field.moving {
            self.moving.find(part, x, when);
            self.mixed.infer(field.simd, part, self.moving.all(), raw);
        }

        let mut still = 0;
        round.columns.clear();
        for run in &mut round.runs {
            let (r, from) = (run.ray as usize, run.from as usize);
            let mut opaque = false;
            (run.kept, run.place) = (round.columns.len() as u32, self.kept[r]);
            // Nothing static is where the veil is.
            let veil = usize::from(ctx.head.is_some() && self.evaluated[r] == 0);
            round.columns.extend(run.first..run.first + veil as u32);
            let mut transmittance = (-self.depth[r]).exp() as f32;
            for k in veil..run.len as usize {
                let column = run.first + k as u32;
                self.depth[r] += f64::from(field.density_of(raw[column as usize]) * self.dt[from + k]);
                let w = if ctx.faint > 0.0 {
                    let before = std::mem::replace(&mut transmittance, (-self.depth[r]).exp() as f32);
                    before - transmittance
                } else {
                    1.0
                };
                if w * FAINT_SAMPLES < ctx.faint && self.lost[r] + w <= ctx.faint {
                    self.lost[r] += w;
                } else {
                    round.columns.push(column);
                }
                if self.depth[r] > ctx.depth_limit {
                    // This sample still counts, those behind it do not.
                    run.len = k as u32 + 1;
                    opaque = true;
                    break;
                }
            }
            run.count = round.columns.len() as u32 - run.kept;
            self.evaluated[r] += run.len;
            self.kept[r] += run.count;
            if !opaque {
                self.alive[still] = run.ray;
                still += 1;
            }
        }
        self.alive.truncate(still);
    }

    /// Bring the rounds' columns into the order of the rays.
    fn gather(&self, ctx: &StepContext<'_>, rounds: usize, out: Kept<'_>) -> usize {
        let rows = ctx.field.rows();
        out.offsets.clear();
        out.offsets.push(0);
        let mut n = 0;
        for &kept in &self.kept {
            n += kept;
            out.offsets.push(n);
        }
        let n = n as usize;
        let (t, dt) = (sized(out.t, n), sized(out.dt, n));
        let (x, features) = (sized(out.x, 3 * n), sized(out.features, rows * n));
        let (moves, timed) = (ctx.field.deform.is_some(), ctx.field.is_timed());
        let was = sized(out.was, if moves { 3 * n } else { 0 });
        out.which.clear();
        out.which.resize(if timed { n } else { 0 }, 0);
        for round in &self.rounds[..rounds] {
            for run in &round.runs {
                let to = run.target(out.offsets);
                for (to, &column) in to.clone().zip(round.kept(run)) {
                    let from = (run.from + column - run.first) as usize;
                    (t[to], dt[to]) = (self.t[from], self.dt[from]);
                }
                if timed {
                    out.which[to].fill(round.which[run.first as usize]);
                }
            }
            let parts = [
                (3, &round.x[..], &mut *x),
                (if moves { 3 } else { 0 }, &round.was[..], &mut *was),
                (rows, &round.features[..], &mut *features),
            ];
            for (rows, from, to) in parts {
                for row in 0..rows {
                    let (from, to) = (&from[row * round.n..][..round.n], &mut to[row * n..][..n]);
                    for run in &round.runs {
                        let to = &mut to[run.target(out.offsets)];
                        if run.count == run.len {
                            to.copy_from_slice(&from[run.first as usize..][..to.len()]);
                        } else {
                            to.iter_mut().zip(round.kept(run)).for_each(|(to, &column)| *to = from[column as usize]);
                        }
                    }
                }
            }
        }
        n
    }
}
