//! Density and colour at points of the scene's frame, for surfaces, slices and tests; and where points are canonical.

use super::driver::RaySystem;
use crate::buffers::shapes_hold;
use crate::fields::{Columns, MovingCells, When};
use crate::warps::{DeformScratch, Points};
use engine::system::{Appearance, System};
use glam::DVec3;
use rayon::prelude::*;

/// Points of one task.
const TASK: usize = 256;

/// Grid positions of points of the scene's frame, and which of them the space reaches at a time in `[-1, 1]`, if there is one.
fn place(driver: &RaySystem, points: &[[f64; 3]], time: Option<f32>) -> (Vec<f32>, Vec<bool>) {
    let n = points.len();
    let (mut p, mut x) = (vec![0.0; 3 * n], vec![0.0; 3 * n]);
    let inside = points
        .iter()
        .enumerate()
        .map(|(i, &point)| {
            let at = driver.space.internal_point(DVec3::from(point));
            let q = at.unwrap_or([0.0; 3]);
            (p[i], p[n + i], p[2 * n + i]) = (q[0], q[1], q[2]);
            at.is_some_and(|q| driver.sampler.occupancy().is_none_or(|occupancy| occupancy.holds(q, time)))
        })
        .collect();
    driver.space.grid_positions(driver.field.simd, &p, &mut x);
    (x, inside)
}

/// Density at points of the scene's frame, 1 / world unit; 0 where the occupancy grid, if it is used, is empty at that time.
pub(super) fn density(driver: &RaySystem, points: &[[f64; 3]], time: f64, out: &mut [f32]) {
    let time_steps = driver.field.time_steps_at(time);
    out.par_chunks_mut(TASK).zip(points.par_chunks(TASK)).for_each(|(out, points)| {
        let (mut x, inside) = place(driver, points, time_steps.times.first().copied());
        let which = vec![0; points.len()];
        driver.field.densities(&mut x, When { time_steps: &time_steps, which: &which }, out, &mut Default::default());
        for ((out, point), inside) in out.iter_mut().zip(points).zip(inside) {
            let scale = driver.space.per_world_unit(DVec3::from(*point)) as f32;
            *out = if inside { *out * scale } else { 0.0 };
        }
    });
}

/// Colour at points of the scene's frame seen along `d`.
pub(super) fn colour(driver: &RaySystem, points: &[[f64; 3]], d: &[[f32; 3]], time: f64, out: &mut [[f32; 3]]) {
    let time_steps = driver.field.time_steps_at(time);
    let code = driver.appearance_code(&Appearance::Mean).unwrap_or_default();
    let tasks = out.par_chunks_mut(TASK).zip(points.par_chunks(TASK)).zip(d.par_chunks(TASK));
    tasks.for_each(|((out, points), d)| {
        let (field, n) = (&driver.field, points.len());
        let (mut x, _) = place(driver, points, None);
        let which = vec![0; n];
        let mut input = vec![0.0; field.colour.inputs() * n];
        let when = When { time_steps: &time_steps, which: &which };
        field.outputs(&mut x, when, &mut input[..field.density.outputs() * n], &mut Default::default());
        let mut scratch = vec![0.0; field.colour.infer_scratch_len()];
        let views: Vec<f32> = (0..3).flat_map(|a| d.iter().map(move |d| d[a])).collect();
        let (basis, codes) = input[field.density.outputs() * n..].split_at_mut(field.harmonics.out_rows() * n);
        shapes_hold(field.harmonics.encode(field.simd, &views, basis));
        for (row, value) in codes.chunks_exact_mut(n.max(1)).zip(&code) {
            row.fill(*value);
        }
        let mut rgb = vec![0.0; 3 * n];
        field.colour.infer(field.simd, &field.colour_packed, &input, n, Columns::Each, &mut rgb, &mut scratch);
        for (i, out) in out.iter_mut().enumerate() {
            *out = [rgb[i], rgb[n + i], rgb[2 * n + i]];
        }
    });
}

/// Canonical points of points of the scene's frame at a time. Those that are not moved keep their bits, and so do those that
/// the space does not reach. Where space is contracted or projective a canonical point may lie beyond all space; the nearest
/// that does not is given.
pub(super) fn canonical(driver: &RaySystem, points: &[[f64; 3]], time: f64, out: &mut [[f64; 3]]) {
    out.copy_from_slice(points);
    let Some(deform) = driver.field.deform().filter(|deform| deform.warps()) else { return };
    let time_steps = driver.field.time_steps_at(time);
    let tasks = out.par_chunks_mut(TASK).zip(points.par_chunks(TASK));
    tasks.for_each_init(DeformScratch::default, |scratch, (out, points)| {
        let n = points.len();
        let internal: Vec<_> = points.iter().map(|&point| driver.space.internal_point(DVec3::from(point))).collect();
        let mut p = vec![0.0; 3 * n];
        for (i, at) in internal.iter().enumerate() {
            let at = at.unwrap_or([0.0; 3]);
            (p[i], p[n + i], p[2 * n + i]) = (at[0], at[1], at[2]);
        }
        let mut was = vec![0.0; 3 * n];
        driver.space.grid_positions(driver.field.simd, &p, &mut was);
        // The rows that the density network sees are of no interest here.
        let (mut x, mut seen) = (vec![0.0; 3 * n], vec![0.0; deform.seen_rows() * n]);
        deform.place(Points { x: &was, which: &vec![0; n], time_steps: &time_steps }, &mut x, &mut seen, scratch);
        let cells = driver.field.moving.as_ref().map(|part| &part.cells);
        for (i, out) in out.iter_mut().enumerate() {
            let [from, to] = [&was, &x].map(|x| [x[i], x[n + i], x[2 * n + i]]);
            // Where a part of the field is for what moves, nothing moves elsewhere.
            let moves = cells.is_none_or(|cells: &MovingCells| cells.holds(from));
            if internal[i].is_some() && from != to && moves {
                *out = driver.space.world_point(driver.space.internal_of_grid(to)).to_array();
            }
        }
    });
}
