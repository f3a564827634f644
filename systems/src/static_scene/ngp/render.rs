//! Rendering: density in rounds along the ray until it is opaque, colour only for samples that carry weight.

use super::Ngp;
use super::field::{Field, shapes_hold, sized};
use crate::space::{InternalRay, Space};
use crate::system::{Layers, Normals, Query};
use glam::DVec3;
use rayon::prelude::*;
use render_core::quadrature::normalise;
use render_core::ray::Ray;
use std::sync::atomic::Ordering;

/// Rays of one task.
const TASK: usize = 256;
/// Samples of each ray in one round.
const ROUND: usize = 24;
/// Where a pixel's first sample lies within its step.
const JITTER: f32 = 0.5;

/// Buffers of a task.
#[derive(Default)]
struct Scratch {
    t: Vec<f32>,
    dt: Vec<f32>,
    offsets: Vec<u32>,
    rays: Vec<InternalRay>,
    views: Vec<f32>,
    basis: Vec<f32>,
    alive: Vec<u32>,
    /// Sample, weight: those of the round that carry weight.
    kept: Vec<Kept>,
    p: Vec<f32>,
    x: Vec<f32>,
    features: Vec<f32>,
    acts: Vec<f32>,
    raw: Vec<f32>,
    input: Vec<f32>,
    rgb: Vec<f32>,
    mlp: Vec<f32>,
    bar: Vec<f32>,
    features_bar: Vec<f32>,
    x_bar: Vec<f32>,
    grad: Vec<f32>,
}

#[derive(Clone, Copy)]
struct Kept {
    ray: u32,
    /// Column in the round's buffers.
    column: u32,
    t: f32,
    w: f32,
    sigma: f32,
}

/// A ray on its way.
#[derive(Clone, Copy, Default)]
struct Progress {
    depth: f64,
    rgb: [f32; 3],
    opacity: f32,
    distance: f32,
    median: f32,
    normal: [f32; 3],
}

/// Layers of rays of the scene's frame.
pub(super) fn render(ngp: &Ngp, rays: &[Ray], query: &Query) -> Layers {
    let tasks: Vec<Layers> = rays
        .par_chunks(TASK)
        .map_init(Scratch::default, |scratch, rays| render_task(ngp, rays, query, scratch))
        .collect();
    let mut out = Layers::default();
    tasks.into_iter().for_each(|part| out.extend(part));
    out
}

fn render_task(ngp: &Ngp, rays: &[Ray], query: &Query, s: &mut Scratch) -> Layers {
    let (field, space) = (&ngp.field, &ngp.space);
    let marcher = ngp.occupy.marcher(&ngp.config, ngp.stretch);
    s.rays.clear();
    s.rays.extend(rays.iter().map(|r| space.internal_ray(r)));
    field.basis(&s.rays, &mut s.views, &mut s.basis);
    s.t.clear();
    s.dt.clear();
    s.offsets.clear();
    s.offsets.push(0);
    for ray in &s.rays {
        let (t, dt) = (&mut s.t, &mut s.dt);
        marcher.march(&ngp.occupy.grid, ray, JITTER, |at, step| {
            t.push(at);
            dt.push(step);
        });
        s.offsets.push(s.t.len() as u32);
    }
    let mut progress = vec![Progress { median: f32::INFINITY, ..Progress::default() }; rays.len()];
    s.alive.clear();
    s.alive.extend((0..rays.len() as u32).filter(|&r| s.offsets[r as usize + 1] > s.offsets[r as usize]));
    // Half of the error budget goes to what lies behind the last sample, half to samples of little weight.
    let (stop, mut evaluated) = (0.5 * query.error_budget, 0);
    for round in 0.. {
        if s.alive.is_empty() {
            break;
        }
        evaluated += shade_round(ngp, query, round, stop, &mut progress, s);
        let (offsets, progress) = (&s.offsets, &progress);
        s.alive.retain(|&r| {
            let r = r as usize;
            let more = (offsets[r + 1] - offsets[r]) as usize > (round + 1) * ROUND;
            more && (stop == 0.0 || (-progress[r].depth).exp() > f64::from(stop))
        });
    }
    ngp.skipped.rendered.fetch_add(evaluated, Ordering::Relaxed);
    ngp.skipped.terminated.fetch_add(s.t.len() as u64 - evaluated, Ordering::Relaxed);
    finish(space, rays, query, &progress)
}

/// Samples `round * ROUND ..` of the rays still alive. Returns how many there were.
fn shade_round(ngp: &Ngp, query: &Query, round: usize, stop: f32, progress: &mut [Progress], s: &mut Scratch) -> u64 {
    let (field, space) = (&ngp.field, &ngp.space);
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
    let features = sized(&mut s.features, field.grid.out_rows() * n);
    field.encode(x, features);
    let raw = sized(&mut s.raw, field.density.outputs() * n);
    let acts = sized(&mut s.acts, field.density.activations_len(n));
    field.density.forward(field.simd, &field.density_packed, features, n, n, raw, n, acts);

    // Weights; samples whose weights together stay below `stop` a ray carry nothing that shows.
    s.kept.clear();
    let mut column = 0;
    for &r in &s.alive {
        let r = r as usize;
        let ray = &mut progress[r];
        let count = (s.offsets[r + 1] - s.offsets[r]) as f32;
        for i in span(&s.offsets, r) {
            let sigma = field.density_of(raw[column]);
            let tau = sigma * s.dt[i];
            let before = (-ray.depth).exp() as f32;
            let w = before * -(-tau).exp_m1();
            ray.depth += f64::from(tau);
            if before > 0.5 && (-ray.depth).exp() <= 0.5 {
                // Where within the step the transmittance passes one half.
                ray.median = s.t[i] + s.dt[i] * ((2.0 * before).ln() / tau).clamp(0.0, 1.0);
            }
            ray.opacity += w;
            ray.distance += w * (s.t[i] + 0.5 * s.dt[i]);
            if w * count > stop {
                s.kept.push(Kept { ray: r as u32, column: column as u32, t: s.t[i], w, sigma });
            }
            column += 1;
        }
    }
    if query.layers.normals == Normals::Compute {
        add_normals(field, space, n, progress, s);
    }
    add_colours(ngp, n, progress, s);
    n as u64
}

/// Colours of the kept samples.
fn add_colours(ngp: &Ngp, n: usize, progress: &mut [Progress], s: &mut Scratch) {
    let (field, m) = (&ngp.field, s.kept.len());
    let geometry = field.density.outputs();
    let input = sized(&mut s.input, field.colour.inputs() * m);
    for g in 0..geometry {
        let row = &s.raw[g * n..][..n];
        for (v, kept) in input[g * m..][..m].iter_mut().zip(&s.kept) {
            *v = row[kept.column as usize];
        }
    }
    for k in 0..field.harmonics.out_rows() {
        let row = &s.basis[k * s.rays.len()..];
        for (v, kept) in input[(geometry + k) * m..][..m].iter_mut().zip(&s.kept) {
            *v = row[kept.ray as usize];
        }
    }
    let rgb = sized(&mut s.rgb, 3 * m);
    let mlp = sized(&mut s.mlp, field.colour.infer_scratch_len());
    field.colour.infer(field.simd, &field.colour_packed, input, m, m, rgb, m, mlp);
    for (j, kept) in s.kept.iter().enumerate() {
        for c in 0..3 {
            progress[kept.ray as usize].rgb[c] += kept.w * rgb[c * m + j];
        }
    }
}

/// Minus the density's gradient, weighted, in the scene's frame.
fn add_normals(field: &Field, space: &Space, n: usize, progress: &mut [Progress], s: &mut Scratch) {
    let bar = sized(&mut s.bar, field.density.outputs() * n);
    bar.fill(0.0);
    for kept in &s.kept {
        // d sigma / d raw = sigma.
        bar[kept.column as usize] = kept.sigma;
    }
    let features_bar = sized(&mut s.features_bar, field.grid.out_rows() * n);
    features_bar.fill(0.0);
    let grad = sized(&mut s.grad, field.density.packed_grad_len());
    grad.fill(0.0);
    let scratch = sized(&mut s.mlp, field.density.backward_scratch_len());
    let (simd, packed, acts) = (field.simd, &field.density_packed, &s.acts);
    field.density.backward(simd, packed, acts, bar, n, n, Some((features_bar, n)), grad, scratch);
    let x_bar = sized(&mut s.x_bar, 3 * n);
    x_bar.fill(0.0);
    let x = &s.x[..3 * n];
    shapes_hold(field.grid.encode_backward_x(field.simd, &field.grid_params, x, features_bar, x_bar));
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
        let rest = (-p.depth).exp() as f32;
        out.rgb.push([0, 1, 2].map(|c| p.rgb[c] + rest * query.background[c]));
        out.opacity.push(1.0 - rest);
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

/// Grid positions of points of the scene's frame, and which of them the space reaches.
fn place(ngp: &Ngp, points: &[[f64; 3]]) -> (Vec<f32>, Vec<bool>) {
    let n = points.len();
    let (mut p, mut x) = (vec![0.0; 3 * n], vec![0.0; 3 * n]);
    let inside = points
        .iter()
        .enumerate()
        .map(|(i, &point)| {
            let at = ngp.space.internal_point(DVec3::from(point));
            let q = at.unwrap_or([0.0; 3]);
            (p[i], p[n + i], p[2 * n + i]) = (q[0], q[1], q[2]);
            at.is_some_and(|q| ngp.occupy.grid.occupied(q, 0.0))
        })
        .collect();
    ngp.space.grid_positions(ngp.field.simd, &p, &mut x);
    (x, inside)
}

/// Density at points of the scene's frame, 1 / world unit; 0 where the occupancy grid is empty.
pub(super) fn density(ngp: &Ngp, points: &[[f64; 3]], out: &mut [f32]) {
    out.par_chunks_mut(TASK).zip(points.par_chunks(TASK)).for_each(|(out, points)| {
        let (x, inside) = place(ngp, points);
        ngp.field.densities(&x, out, &mut Default::default());
        for ((out, point), inside) in out.iter_mut().zip(points).zip(inside) {
            let scale = ngp.space.per_world_unit(DVec3::from(*point)) as f32;
            *out = if inside { *out * scale } else { 0.0 };
        }
    });
}

/// Colour at points of the scene's frame seen along `d`.
pub(super) fn colour(ngp: &Ngp, points: &[[f64; 3]], d: &[[f32; 3]], out: &mut [[f32; 3]]) {
    let tasks = out.par_chunks_mut(TASK).zip(points.par_chunks(TASK)).zip(d.par_chunks(TASK));
    tasks.for_each(|((out, points), d)| {
        let (field, n) = (&ngp.field, points.len());
        let (x, _) = place(ngp, points);
        let mut features = vec![0.0; field.grid.out_rows() * n];
        field.encode(&x, &mut features);
        let mut input = vec![0.0; field.colour.inputs() * n];
        let mut scratch = vec![0.0; field.density.infer_scratch_len().max(field.colour.infer_scratch_len())];
        field.density.infer(field.simd, &field.density_packed, &features, n, n, &mut input, n, &mut scratch);
        let views: Vec<f32> = (0..3).flat_map(|a| d.iter().map(move |d| d[a])).collect();
        shapes_hold(field.harmonics.encode(field.simd, &views, &mut input[field.density.outputs() * n..]));
        let mut rgb = vec![0.0; 3 * n];
        field.colour.infer(field.simd, &field.colour_packed, &input, n, n, &mut rgb, n, &mut scratch);
        for (i, out) in out.iter_mut().enumerate() {
            *out = [rgb[i], rgb[n + i], rgb[2 * n + i]];
        }
    });
}
