//! Rendering: colours, depths and normals from the fine network.

use super::chunk::TwoLevelOps;
use super::cones::Cones;
use super::network::{Ops, Output, Seen};
use super::recipe::Recipe;
use super::samples::{Level, Tile};
use super::two_level::{TwoLevel, recorded};
use crate::space::InternalRay;
use engine::system::{Appearance, Layers, Normals, Query};
use field_core::tape::{Encoder, Node, Tape, TapeError};
use float_core::Simd;
use glam::DVec3;
use rayon::prelude::*;
use render_core::quadrature::{LastInterval, Samples, depth_median_exact, weights};

/// Points of one task.
pub(super) const TASK: usize = 256;

/// The fine network's answers: `[n]` and `[3][n]`.
struct Rendered {
    raw: Vec<f32>,
    rgb: Vec<f32>,
}

/// In which appearance samples are seen, and when.
#[derive(Clone, Copy)]
pub(super) struct Condition<'c> {
    /// Empty where colours depend on none.
    pub(super) code: &'c [f32],
    /// In `[0, 1]`.
    pub(super) time: f32,
}

/// A network's answers at a level's samples, all under one condition.
fn record<'a, P: Encoder>(
    ops: &'a Ops<'a, P>,
    level: &'a mut Level,
    params: &'a [f32],
    condition: Condition<'_>,
) -> Result<(Tape<'a>, Output), TapeError> {
    let n = level.t.len();
    let mut tape = Tape::new(&mut level.arena, params);
    let (x, d) = (tape.constant(level.x.len() / n.max(1), n, &level.x)?, tape.constant(3, n, &level.d)?);
    let when = ops.at(&mut tape, n, condition.time);
    let code = code_rows(&mut tape, condition.code, n)?;
    let out = ops.record(&mut tape, Seen { x, d, when, code })?;
    Ok((tape, out))
}

/// One code for `n` samples.
fn code_rows(tape: &mut Tape<'_>, code: &[f32], n: usize) -> Result<Option<Node>, TapeError> {
    if code.is_empty() {
        return Ok(None);
    }
    let column = tape.constant(code.len(), 1, code)?;
    tape.broadcast_samples(column, n).map(Some)
}

impl<R: Recipe> TwoLevel<R> {
    /// The samples of both levels of a tile of rays, evenly spaced; those of the fine one are in `tile.fine`.
    pub(super) fn place_samples(
        &self,
        ops: &TwoLevelOps<'_, R::Position>,
        rays: &[InternalRay],
        condition: Condition<'_>,
        tile: &mut Tile,
    ) -> Result<(), TapeError> {
        self.config.fill_coarse(&self.space, rays, None, tile);
        let raw = {
            let (tape, out) = record(&ops.levels[0], &mut tile.coarse, self.network(0), condition)?;
            tape.value(out.raw_density)?.data.to_vec()
        };
        tile.weigh(raw.iter().map(|&raw| self.config.density_of(raw)), rays.len());
        self.config.fill_fine(&self.space, rays, None, tile);
        Ok(())
    }

    /// Values of the fine network for a tile of rays.
    fn render_tile(
        &self,
        ops: &TwoLevelOps<'_, R::Position>,
        rays: &[InternalRay],
        condition: Condition<'_>,
        tile: &mut Tile,
    ) -> Result<Rendered, TapeError> {
        self.place_samples(ops, rays, condition, tile)?;
        let (tape, out) = record(&ops.levels[1], &mut tile.fine, self.network(1), condition)?;
        Ok(Rendered { raw: tape.value(out.raw_density)?.data.to_vec(), rgb: tape.value(out.rgb)?.data.to_vec() })
    }

    /// Layers of a tile's rays, appended.
    pub(super) fn render_into(
        &self,
        ops: &TwoLevelOps<'_, R::Position>,
        cones: Cones<'_>,
        query: &Query,
        code: &[f32],
        tile: &mut Tile,
        out: &mut Layers,
    ) {
        let rays = cones.rays;
        let internal = cones.internal(&self.space);
        let hit: Vec<usize> = (0..rays.len()).filter(|&i| internal[i].end > internal[i].start).collect();
        let from = out.rgb.len();
        out.extend(Layers::nothing(rays.len(), query));
        if hit.is_empty() {
            return;
        }
        let hit_rays: Vec<InternalRay> = hit.iter().map(|&i| internal[i]).collect();
        let condition = Condition { code, time: query.time as f32 };
        let values = recorded(self.render_tile(ops, &hit_rays, condition, tile));
        let fine = &tile.fine;
        let n = fine.t.len();
        let tau: Vec<f32> =
            values.raw.iter().zip(&fine.dt).map(|(&raw, dt)| self.config.density_of(raw) * dt).collect();
        let samples = Samples { offsets: &fine.offsets, tau: &tau, last: LastInterval::Finite };
        let (mut w, mut trans_end) = (vec![0.0; n], vec![0.0; hit.len()]);
        weights(Simd::best(), samples, &mut w, &mut trans_end);
        let mut median = vec![0.0; hit.len()];
        depth_median_exact(samples, &fine.t, &fine.dt, f32::INFINITY, &mut median);
        let normals = (query.layers.normals == Normals::Compute)
            .then(|| recorded(self.fine_normals(ops, condition, tile, &values.raw)));
        let fine = &tile.fine;
        for (r, &i) in hit.iter().enumerate() {
            let span = fine.offsets[r] as usize..fine.offsets[r + 1] as usize;
            let (mut rgb, mut sum, mut distance, mut normal) = ([0.0; 3], 0.0, 0.0, DVec3::ZERO);
            for k in span {
                for (c, rgb) in rgb.iter_mut().enumerate() {
                    *rgb += w[k] * values.rgb[c * n + k];
                }
                sum += w[k];
                distance += w[k] * (fine.t[k] + 0.5 * fine.dt[k]);
                if let Some(bars) = &normals {
                    let at = [fine.p[k], fine.p[n + k], fine.p[2 * n + k]];
                    let g = self.space.world_gradient(at, [bars[k], bars[n + k], bars[2 * n + k]]);
                    normal -= f64::from(w[k]) * g.normalize_or_zero();
                }
            }
            let world = |t: f32| self.space.world_distance(&rays[i], t) as f32;
            out.rgb[from + i] = [0, 1, 2].map(|c| rgb[c] + trans_end[r] * query.background[c]);
            out.opacity[from + i] = 1.0 - trans_end[r];
            if sum > 1e-3 {
                out.depth[from + i] = world(distance / sum);
            }
            if median[r].is_finite() {
                out.median_depth[from + i] = world(median[r]);
            }
            if normals.is_some() {
                out.normal[from + i] = normal.normalize_or_zero().as_vec3().to_array();
            }
        }
    }

    /// Gradient of the fine network's density with respect to its positions, `[3][n]`, by a second record with the
    /// positions as inputs.
    fn fine_normals(
        &self,
        ops: &TwoLevelOps<'_, R::Position>,
        condition: Condition<'_>,
        tile: &mut Tile,
        raw: &[f32],
    ) -> Result<Vec<f32>, TapeError> {
        let level = &mut tile.fine;
        let n = level.t.len();
        let mut unused = vec![0.0; self.network(1).len()];
        let mut tape = Tape::new(&mut level.arena, self.network(1));
        let (x, d) = (tape.input(level.x.len() / n.max(1), n, &level.x)?, tape.constant(3, n, &level.d)?);
        let when = ops.levels[1].at(&mut tape, n, condition.time);
        let code = code_rows(&mut tape, condition.code, n)?;
        let out = ops.levels[1].record(&mut tape, Seen { x, d, when, code })?;
        // Directions only: any positive derivative of the activation will do.
        let bar: Vec<f32> = raw.iter().map(|&raw| if self.config.density_of(raw) > 0.0 { 1.0 } else { 0.0 }).collect();
        tape.backward(&[(out.raw_density, &bar)], &mut unused)?;
        Ok(tape.gradient(x)?[..3 * n].to_vec())
    }

    /// Points of the scene's frame as samples of `level`: their internal coordinates. Those that the space does not reach stand in its
    /// middle, and are `None`.
    pub(super) fn put_points(&self, points: &[[f64; 3]], level: &mut Level) -> Vec<Option<[f32; 3]>> {
        let n = points.len();
        let internal: Vec<_> = points.iter().map(|&point| self.space.internal_point(DVec3::from(point))).collect();
        level.t.resize(n, 0.0);
        level.make_room(n, self.shapes.position_rows());
        for (i, p) in internal.iter().enumerate() {
            let p = p.unwrap_or([0.0; 3]);
            (0..3).for_each(|a| level.p[a * n + i] = p[a]);
        }
        self.config.place_points(&self.space, n, level);
        internal
    }

    /// Fine network at points of the scene's frame at a time, in the mean appearance: `each(i, density per world unit, colour)`.
    pub(super) fn evaluate(
        &self,
        points: &[[f64; 3]],
        d: &[[f32; 3]],
        time: f64,
        mut each: impl FnMut(usize, f32, [f32; 3]),
    ) {
        let ops = self.ops();
        let code = self.code_of(&Appearance::Mean);
        let condition = Condition { code: &code, time: time as f32 };
        let parts: Vec<Rendered> = points
            .par_chunks(TASK)
            .zip(d.par_chunks(TASK))
            .map_init(Level::default, |level, (points, d)| {
                let n = points.len();
                self.put_points(points, level);
                for (i, d) in d.iter().enumerate() {
                    (0..3).for_each(|a| level.d[a * n + i] = d[a]);
                }
                let (tape, out) = recorded(record(&ops.levels[1], level, self.network(1), condition));
                Rendered {
                    raw: recorded(tape.value(out.raw_density)).data.to_vec(),
                    rgb: recorded(tape.value(out.rgb)).data.to_vec(),
                }
            })
            .collect();
        for (i, &point) in points.iter().enumerate() {
            let (part, k) = (&parts[i / TASK], i % TASK);
            let n = part.raw.len();
            let point = DVec3::from(point);
            let inside = self.space.internal_point(point).is_some();
            let sigma = self.config.density_of(part.raw[k]) * self.space.per_world_unit(point) as f32;
            each(i, if inside { sigma } else { 0.0 }, [part.rgb[k], part.rgb[n + k], part.rgb[2 * n + k]]);
        }
    }
}
