//! Rendering: density in rounds along the ray until it is opaque, colour only for samples that carry weight.
//!
//! # What is skipped
//! Each ray deals out the query's [`Budget`]: it stops where what is left costs no more than what it has, and leaves out
//! colours of samples that its account can pay for. Cells that the occupancy grid counts as empty hold no density: that
//! is part of the model, as training has no samples there, so passing over them is exact. A budget of 0 skips nothing: it
//! visits all samples of the lattice and asks for every density and every colour. Where proposals place the samples, these
//! are the lattice, and no cell is empty. Where the grid tells times apart, the empty cells are those of the query's time.

use super::driver::RaySystem;
use super::render_scratch::{Kept, Progress, Scratch};
use crate::buffers::sized;
use crate::fields::{Columns, Detail, Field, Places, When};
use crate::samplers::{Draw, Occupancy, RaysInSpace, Sampler};
use crate::space::Space;
use crate::warps::{Points, TimeSteps};
use engine::canonical::add_canonical;
use engine::eval::skips::bound_of;
use engine::system::{EmptyCells, Layers, Normals, Query, SkipRow, System, Trial};
use rayon::prelude::*;
use render_core::budget::{Budget, Ledger, Radiance, Skip, empty_bound};
use render_core::occupancy::OccupancyGrid;
use render_core::quadrature::normalise;
use render_core::ray::Ray;
use std::sync::{Mutex, PoisonError};

/// Rays of one task.
const TASK: usize = 256;
/// Samples of each ray in one round.
const ROUND: usize = 24;
/// Where a pixel's first sample lies within its step.
const JITTER: f32 = 0.5;

/// What all tasks of a render share.
struct Job<'a> {
    driver: &'a RaySystem,
    query: &'a Query,
    budget: Budget,
    empty: EmptyCells,
    /// What is marched through where empty cells are not passed over.
    full: Option<OccupancyGrid>,
    /// Appearance code of the query; empty where the field knows one appearance only.
    code: Vec<f32>,
    /// The query's time step.
    time_steps: TimeSteps,
}

/// Layers of rays of the scene's frame.
pub(super) fn render(driver: &RaySystem, rays: &[Ray], query: &Query) -> Layers {
    let (layers, ledger) = render_trial(driver, rays, query, &Trial::USUAL);
    driver.skipped.renders.lock().unwrap_or_else(PoisonError::into_inner).merge(&ledger);
    layers
}

/// The same with some skips only, and what they were.
pub(super) fn render_trial(driver: &RaySystem, rays: &[Ray], query: &Query, trial: &Trial) -> (Layers, Ledger) {
    let budget = Budget::new(query.error_budget, Radiance::UNIT, query.background).only(trial.skips);
    let code = driver.appearance_code(&query.appearance).unwrap_or_default();
    let time_steps = driver.field.time_steps_at(query.time);
    let job = Job {
        driver,
        query,
        budget,
        empty: trial.empty,
        full: full_grid(driver, &budget, trial.empty),
        code,
        time_steps,
    };
    let task = |scratch: &mut Scratch, rays: &[Ray]| match query.halt.raised() {
        true => (Layers::nothing(rays.len(), query), Ledger::default()),
        false => job.render(rays, scratch),
    };
    let tasks: Vec<(Layers, Ledger)> = rays.par_chunks(TASK).map_init(Scratch::default, task).collect();
    let (mut out, mut ledger) = Default::default();
    for (layers, part) in tasks {
        Layers::extend(&mut out, layers);
        Ledger::merge(&mut ledger, &part);
    }
    add_canonical(driver, rays, query, &mut out);
    (out, ledger)
}

/// What renders have skipped so far.
pub(super) fn skip_rows(ledger: &Mutex<Ledger>) -> Vec<SkipRow> {
    let ledger = *ledger.lock().unwrap_or_else(PoisonError::into_inner);
    let row = |what, skip, unit| {
        let entry = ledger.entry(skip);
        SkipRow::counted(what, entry.skipped, entry.total, unit, bound_of(&entry))
    };
    vec![
        row("render: empty space", Skip::Empty, "samples"),
        row("render: behind what is opaque", Skip::Behind, "samples"),
        row("render: colours without weight", Skip::Faint, "colours"),
    ]
}

/// All cells, or all but those that the cameras rule out; `None` where empty ones are passed over.
fn full_grid(driver: &RaySystem, budget: &Budget, empty: EmptyCells) -> Option<OccupancyGrid> {
    let grid = &driver.sampler.occupancy()?.grid;
    if empty == EmptyCells::Nothing && budget.takes(Skip::Empty) {
        return None;
    }
    let mut full = OccupancyGrid::new(grid.settings()).ok()?;
    if empty == EmptyCells::Field {
        // Asked for every cell in order: none is marked yet.
        let mut cells = grid.thickness().iter();
        full.mark_invisible(|_, _| cells.next().is_some_and(|&thickness| thickness >= 0.0));
    }
    Some(full)
}

impl Job<'_> {
    fn render(&self, rays: &[Ray], s: &mut Scratch) -> (Layers, Ledger) {
        let (field, space) = (&self.driver.field, &self.driver.space);
        s.rays.clear();
        s.rays.extend(rays.iter().map(|r| space.internal_ray(r)));
        let codes = field.basis(&s.rays, self.code.len(), &mut s.views, &mut s.basis);
        for (row, value) in codes.chunks_exact_mut(rays.len().max(1)).zip(&self.code) {
            row.fill(*value);
        }
        let mut ledger = Ledger::default();
        match &self.driver.sampler {
            Sampler::Occupancy(occupancy) => self.march(occupancy, s, &mut ledger),
            Sampler::Proposals(proposals) => {
                let time = self.time_steps.times.first().copied().unwrap_or(0.0);
                let at = RaysInSpace { simd: field.simd, space, rays: &s.rays };
                s.proposed.sample(proposals, &at, |_| true, |_| time, Draw::Render);
                s.proposed.intervals(rays.len(), &mut s.t, &mut s.dt, &mut s.offsets);
            }
        }
        let mut progress = vec![Progress::START; rays.len()];
        s.alive.clear();
        s.alive.extend((0..rays.len() as u32).filter(|&r| s.offsets[r as usize + 1] > s.offsets[r as usize]));
        let mut evaluated = 0;
        for round in 0.. {
            if s.alive.is_empty() {
                break;
            }
            evaluated += self.shade_round(round, &mut progress, s, &mut ledger);
            let offsets = &s.offsets;
            s.alive.retain(|&r| {
                let r = r as usize;
                !progress[r].stopped && (offsets[r + 1] - offsets[r]) as usize > (round + 1) * ROUND
            });
        }
        ledger.count(Skip::Behind, s.t.len() as u64 - evaluated, s.t.len() as u64);
        let spread = Radiance::UNIT.spread(self.query.background) as f32;
        for p in &progress {
            let behind = if p.stopped { self.budget.stop_cost(p.trans) } else { 0.0 };
            ledger.spend(Skip::Behind, behind);
            ledger.spend(Skip::Faint, p.account.spent() - behind);
            ledger.spend(Skip::Empty, f64::from(empty_bound(p.hidden as f32, spread)));
        }
        (finish(space, rays, self.query, &progress), ledger)
    }

    /// Place samples along the rays.
    fn march(&self, occupancy: &Occupancy, s: &mut Scratch, ledger: &mut Ledger) {
        let (grid, marcher) = (&occupancy.grid, occupancy.marcher());
        let cells = occupancy.cells_at(self.time_steps.times.first().copied());
        s.t.clear();
        s.dt.clear();
        s.empty.clear();
        s.offsets.clear();
        s.offsets.push(0);
        let mut lattice = 0;
        for ray in &s.rays {
            let (t, dt, empty, occupied) = (&mut s.t, &mut s.dt, &mut s.empty, &mut s.occupied);
            if let Some(full) = &self.full {
                // Samples lie where they would without the empty ones: what is in both is occupied.
                occupied.clear();
                marcher.march_in(grid, cells, ray, JITTER, |at, _| occupied.push(at));
                let mut next = 0;
                let marched = marcher.march(full, ray, JITTER, |at, step| {
                    let holds = occupied.get(next) == Some(&at);
                    next += usize::from(holds);
                    t.push(at);
                    dt.push(step);
                    empty.push(!holds);
                });
                debug_assert_eq!(next, occupied.len(), "every occupied sample lies on the lattice");
                lattice += u64::from(marched.candidates);
            } else {
                let marched = marcher.march_in(grid, cells, ray, JITTER, |at, step| {
                    t.push(at);
                    dt.push(step);
                });
                lattice += u64::from(marched.candidates);
            }
            s.offsets.push(s.t.len() as u32);
        }
        ledger.count(Skip::Empty, lattice - s.t.len() as u64, lattice);
    }

    /// Samples `round * ROUND ..` of the rays still alive. Returns how many there were.
    fn shade_round(&self, round: usize, progress: &mut [Progress], s: &mut Scratch, ledger: &mut Ledger) -> u64 {
        let (field, space, lead) = (&self.driver.field, &self.driver.space, self.driver.sampler.lead());
        let span = |offsets: &[u32], r: usize| {
            let first = offsets[r] as usize + round * ROUND;
            first..(first + ROUND).min(offsets[r + 1] as usize)
        };
        let n: usize = s.alive.iter().map(|&r| span(&s.offsets, r as usize).len()).sum();
        let p = sized(&mut s.p, 3 * n);
        let mut column = 0;
        for &r in &s.alive {
            for i in span(&s.offsets, r as usize) {
                let at = s.rays[r as usize].at(s.t[i]);
                (p[column], p[n + column], p[2 * n + column]) = (at[0], at[1], at[2]);
                column += 1;
            }
        }
        let x = sized(&mut s.x, 3 * n);
        space.grid_positions(field.simd, p, x);
        if field.is_timed() {
            s.which.clear();
            s.which.resize(n, 0);
        }
        if field.deform.is_some() {
            sized(&mut s.was, 3 * n).copy_from_slice(x);
        }
        let features = sized(&mut s.features, field.rows() * n);
        field.seen(x, When { time_steps: &self.time_steps, which: &s.which }, features, &mut s.placing);
        let raw = sized(&mut s.raw, field.density.outputs() * n);
        let acts = sized(&mut s.acts, field.density.activations_len(n));
        field.density.forward(field.simd, &field.density_packed, features, n, n, raw, n, acts);
        if let Some(part) = &field.moving {
            s.moving.find(part, x, When { time_steps: &self.time_steps, which: &s.which });
            s.mixed.forward(field.simd, part, s.moving.all(), raw);
        }

        s.kept.clear();
        let (mut column, mut shaded) = (0, 0);
        for &r in &s.alive {
            let r = r as usize;
            let (ray, end) = (&mut progress[r], s.offsets[r + 1]);
            let first = column;
            column += span(&s.offsets, r).len();
            for (column, i) in (first..).zip(span(&s.offsets, r)) {
                let sigma = field.density_of(raw[column]);
                let mut tau = sigma * s.dt[i];
                if s.empty.get(i) == Some(&true) {
                    match self.empty {
                        EmptyCells::Nothing => tau = 0.0,
                        EmptyCells::Field => ray.hidden += f64::from(tau),
                    }
                }
                let before = ray.trans;
                let w = before as f32 * -(-tau).exp_m1();
                ray.depth += f64::from(tau);
                ray.trans = (-ray.depth).exp();
                // The sky has no distance.
                let in_space = s.t[i] <= s.rays[r].end;
                if in_space && before > 0.5 && ray.trans <= 0.5 {
                    // Where within the step the transmittance passes one half.
                    ray.median = s.t[i] + s.dt[i] * (((2.0 * before as f32).ln() / tau).clamp(0.0, 1.0) - lead);
                }
                if in_space {
                    ray.opacity += w;
                    ray.distance += w * (s.t[i] + (0.5 - lead) * s.dt[i]);
                }
                shaded += 1;
                let left = end - i as u32;
                if !self.budget.drops(&mut ray.account, w, left) {
                    s.kept.push(Kept { ray: r as u32, column: column as u32, t: s.t[i], w, sigma });
                }
                if left > 1 && self.budget.stops(&mut ray.account, ray.trans) {
                    ray.stopped = true;
                    break;
                }
            }
        }
        ledger.count(Skip::Faint, shaded - s.kept.len() as u64, shaded);
        if self.query.layers.normals == Normals::Compute {
            add_normals(field, space, &self.time_steps, progress, n, s);
        }
        add_colours(self.driver, n, progress, s);
        n as u64
    }
}

/// Colours of the kept samples.
fn add_colours(driver: &RaySystem, n: usize, progress: &mut [Progress], s: &mut Scratch) {
    let (field, m) = (&driver.field, s.kept.len());
    let geometry = field.density.outputs();
    let input = sized(&mut s.input, field.colour.inputs() * m);
    for g in 0..geometry {
        let row = &s.raw[g * n..][..n];
        for (v, kept) in input[g * m..][..m].iter_mut().zip(&s.kept) {
            *v = row[kept.column as usize];
        }
    }
    for k in 0..field.colour.inputs() - geometry {
        let row = &s.basis[k * s.rays.len()..];
        for (v, kept) in input[(geometry + k) * m..][..m].iter_mut().zip(&s.kept) {
            *v = row[kept.ray as usize];
        }
    }
    // What is kept of a ray is together.
    s.runs.clear();
    s.runs.extend((0..m).filter(|&j| j == 0 || s.kept[j].ray != s.kept[j - 1].ray).chain([m]).map(|j| j as u32));
    let rgb = sized(&mut s.rgb, 3 * m);
    let mlp = sized(&mut s.mlp, field.colour.infer_scratch_len());
    field.colour.infer(field.simd, &field.colour_packed, input, m, Columns::Rays(&s.runs), rgb, mlp);
    for (j, kept) in s.kept.iter().enumerate() {
        for c in 0..3 {
            progress[kept.ray as usize].rgb[c] += f64::from(kept.w) * f64::from(rgb[c * m + j]);
        }
    }
}

/// Minus the density's gradient, weighted, in the scene's frame.
fn add_normals(
    field: &Field,
    space: &Space,
    time_steps: &TimeSteps,
    progress: &mut [Progress],
    n: usize,
    s: &mut Scratch,
) {
    let bar = sized(&mut s.bar, field.density.outputs() * n);
    bar.fill(0.0);
    for kept in &s.kept {
        // d sigma / d raw = sigma.
        bar[kept.column as usize] = kept.sigma;
    }
    let features_bar = sized(&mut s.features_bar, field.rows() * n);
    features_bar.fill(0.0);
    let grad = sized(&mut s.grad, field.density.packed_grad_len());
    grad.fill(0.0);
    let scratch = sized(&mut s.mlp, field.density.backward_scratch_len());
    let (simd, packed, acts) = (field.simd, &field.density_packed, &s.acts);
    if let Some(part) = &field.moving {
        s.moving_bars.begin(part, s.moving.columns.len());
        let bars = &mut s.moving_bars;
        s.mixed.backward(simd, part, s.moving.all(), bar, n, None, &mut bars.features, &mut bars.network);
    }
    field.density.backward(simd, packed, acts, bar, n, features_bar, n, grad, scratch);
    let x_bar = sized(&mut s.x_bar, 3 * n);
    x_bar.fill(0.0);
    let (x, features) = (&s.x[..3 * n], &s.features[..field.rows() * n]);
    let (raw_bar, seen_bar) = field.pull(features, n, features_bar, &mut s.raw_bar);
    field.fill_times(When { time_steps, which: &s.which }, &mut s.times);
    field.features.pull_positions(Places { x, times: &s.times }, raw_bar, Detail::All, x_bar);
    if let Some(deform) = &field.deform {
        // The gradient where the point is, not where it is canonical.
        let (grad, scratch) = &mut s.deform;
        grad.begin_at(deform, time_steps);
        deform.learn(Points { x: &s.was[..3 * n], which: &s.which, time_steps }, x_bar, seen_bar, grad, scratch);
    }
    if let Some(part) = field.moving.as_ref().filter(|_| !s.moving.columns.is_empty()) {
        let (moving_bar, seen_bar) = s.moving_bars.pull(part, &s.moving, Detail::All);
        if let Some(deform) = &part.deform {
            let (grad, scratch) = &mut s.deform;
            grad.begin_at(deform, time_steps);
            deform.learn(s.moving.points(time_steps), moving_bar, seen_bar, grad, scratch);
        }
        s.moving_bars.add_to(&s.moving, x_bar);
    }
    for kept in &s.kept {
        let (i, ray) = (kept.column as usize, &s.rays[kept.ray as usize]);
        let gradient = space.world_gradient(ray.at(kept.t), [x_bar[i], x_bar[n + i], x_bar[2 * n + i]]);
        if let Some(direction) = gradient.try_normalize() {
            let out = &mut progress[kept.ray as usize].normal;
            for (out, g) in out.iter_mut().zip(direction.to_array()) {
                *out -= kept.w * g as f32;
            }
        }
    }
}

fn finish(space: &Space, rays: &[Ray], query: &Query, progress: &[Progress]) -> Layers {
    let mut out = Layers::default();
    for (ray, p) in rays.iter().zip(progress) {
        out.rgb.push([0, 1, 2].map(|c| (p.rgb[c] + p.trans * f64::from(query.background[c])) as f32));
        out.opacity.push((1.0 - p.trans) as f32);
        let world = |t: f32| space.world_distance(ray, t) as f32;
        out.depth.push(if p.opacity > 1e-3 { world(p.distance / p.opacity) } else { f32::INFINITY });
        out.median_depth.push(if p.median.is_finite() { world(p.median) } else { f32::INFINITY });
        if query.layers.normals == Normals::Compute {
            let mut normal = p.normal;
            normalise(&mut normal);
            out.normal.push(normal);
        }
    }
    out
}
