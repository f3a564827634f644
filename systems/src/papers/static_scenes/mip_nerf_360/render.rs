//! Rendering: the same rounds without jitter, then colours, depths and normals from the final network.

use super::driver::{MipNerf360, Tile, fits};
use super::level::{Gaussian, Level};
use super::network::Ops;
use super::quadrature::QuadratureOp;
use super::rounds::Rounds;
use crate::networks::cones::Cones;
use crate::space::{InternalRay, SpaceKind};
use engine::system::{Layers, Normals, Query};
use field_core::tape::{Tape, TapeError};
use float_core::{Simd, m32};
use glam::DVec3;
use rayon::prelude::*;
use render_core::contract::{Norm, contract_backward};
use render_core::quadrature::{Samples, depth_median_exact, weights};

/// Points evaluated together.
const POINTS: usize = 256;

/// Densities and colours of the final network, `[n]` and `[3][n]`.
#[derive(Default)]
struct Values {
    sigma: Vec<f32>,
    rgb: Vec<f32>,
}

impl MipNerf360 {
    /// All rounds of a tile's rays; the last of the tile's levels holds the final intervals.
    pub(super) fn render_rounds(&self, ops: &Ops<'_>, rays: &[InternalRay], tile: &mut Tile) -> Result<(), TapeError> {
        let rounds = Rounds { rays, random: None, fraction: 1.0 };
        let Tile { levels, resampler, .. } = tile;
        levels.resize_with(self.config.rounds.proposals + 1, Level::default);
        self.fill(&rounds, 0, None, resampler, &mut levels[0]);
        for round in 0..self.config.rounds.proposals {
            let (level, next) = levels[round..].split_first_mut().expect("a level for each round");
            let Level { arena, offsets, dt, w, x, .. } = level;
            let n = dt.len();
            let op = QuadratureOp { simd: Simd::best(), offsets, dt, last: self.config.rounds.last(), background: &[] };
            {
                let mut tape = Tape::new(arena, &self.trained.params);
                let x = tape.constant(x.len() / n, n, x)?;
                let sigma = ops.proposal(&mut tape, x)?;
                let out = tape.custom(&op, &[sigma])?;
                w.copy_from_slice(tape.value(out)?.data);
            }
            self.fill(&rounds, round + 1, Some(level), resampler, &mut next[0]);
        }
        Ok(())
    }

    /// The final network on a level's intervals.
    fn values(&self, ops: &Ops<'_>, level: &mut Level) -> Result<Values, TapeError> {
        let Level { arena, dt, x, d, .. } = level;
        let n = dt.len();
        let mut tape = Tape::new(arena, &self.trained.params);
        let (x, d) = (tape.constant(x.len() / n, n, x)?, tape.constant(3, n, d)?);
        let (sigma, rgb) = ops.record(&mut tape, x, d)?;
        Ok(Values { sigma: tape.value(sigma)?.data.to_vec(), rgb: tape.value(rgb)?.data.to_vec() })
    }

    /// Layers of a tile's rays, appended.
    pub(super) fn render_into(
        &self,
        ops: &Ops<'_>,
        cones: Cones<'_>,
        query: &Query,
        tile: &mut Tile,
        out: &mut Layers,
    ) -> Result<(), TapeError> {
        let rays = cones.rays;
        let internal = cones.internal(&self.space);
        let hit: Vec<usize> = (0..rays.len()).filter(|&i| internal[i].end > internal[i].start).collect();
        let from = out.rgb.len();
        out.extend(Layers::nothing(rays.len(), query));
        if hit.is_empty() {
            return Ok(());
        }
        let hit_rays: Vec<InternalRay> = hit.iter().map(|&i| internal[i]).collect();
        self.render_rounds(ops, &hit_rays, tile)?;
        let level = tile.levels.last_mut().expect("the final round");
        let values = self.values(ops, level)?;
        let normals = match query.layers.normals {
            Normals::Compute => Some(self.normals(ops, &hit_rays, level)?),
            Normals::Skip => None,
        };
        let n = level.dt.len();
        let tau: Vec<f32> = values.sigma.iter().zip(&level.dt).map(|(sigma, dt)| sigma * dt).collect();
        let samples = Samples { offsets: &level.offsets, tau: &tau, last: self.config.rounds.last() };
        let mut trans_end = vec![0.0; hit.len()];
        weights(Simd::best(), samples, &mut level.w, &mut trans_end);
        let mut median = vec![0.0; hit.len()];
        depth_median_exact(samples, &level.t, &level.dt, f32::INFINITY, &mut median);
        for (r, &i) in hit.iter().enumerate() {
            let (mut rgb, mut sum, mut distance, mut normal) = ([0.0; 3], 0.0, 0.0, DVec3::ZERO);
            for k in level.offsets[r] as usize..level.offsets[r + 1] as usize {
                let w = level.w[k];
                for (c, rgb) in rgb.iter_mut().enumerate() {
                    *rgb += w * values.rgb[c * n + k];
                }
                sum += w;
                distance += w * self.mark(level.t[k], level.dt[k]);
                if let Some(normals) = &normals {
                    normal += f64::from(w) * normals[k];
                }
            }
            let world = |t: f32| self.space.world_distance(&rays[i], t) as f32;
            out.rgb[from + i] = [0, 1, 2].map(|c| rgb[c] + trans_end[r] * query.background[c]);
            out.opacity[from + i] = 1.0 - trans_end[r];
            if sum > 1e-3 {
                out.depth[from + i] = world(self.unmark(distance / sum));
            }
            if median[r].is_finite() {
                out.median_depth[from + i] = world(median[r]);
            }
            if normals.is_some() {
                out.normal[from + i] = normal.normalize_or_zero().as_vec3().to_array();
            }
        }
        Ok(())
    }

    /// What the expected depth is an expectation of: the distance, or its logarithm where space has no end.
    fn mark(&self, t: f32, dt: f32) -> f32 {
        let middle = t + 0.5 * dt;
        if self.space.kind() == SpaceKind::Contracted { m32::ln(middle) } else { middle }
    }

    fn unmark(&self, mark: f32) -> f32 {
        if self.space.kind() == SpaceKind::Contracted { m32::exp(mark) } else { mark }
    }

    /// Unit vectors against the gradient of the final network's density at the intervals' means, `[n]`.
    fn normals(&self, ops: &Ops<'_>, rays: &[InternalRay], level: &mut Level) -> Result<Vec<DVec3>, TapeError> {
        let Level { arena, offsets, t, dt, x, .. } = level;
        let (n, k) = (dt.len(), self.shapes.basis.len());
        let mut unused = vec![0.0; self.trained.params.len()];
        let mut tape = Tape::new(arena, &self.trained.params);
        let along = tape.input(k, n, &x[..k * n])?;
        let var = tape.constant(k, n, &x[k * n..])?;
        let rows = tape.concat(&[along, var])?;
        let (_, sigma) = ops.density(&mut tape, rows)?;
        let ones = vec![1.0; n];
        tape.backward(&[(sigma, &ones)], &mut unused)?;
        let bars = tape.gradient(along)?;
        let mut normals = vec![DVec3::ZERO; n];
        for (r, ray) in rays.iter().enumerate() {
            for i in offsets[r] as usize..offsets[r + 1] as usize {
                let seen: DVec3 = self
                    .shapes
                    .basis
                    .iter()
                    .enumerate()
                    .map(|(j, &p)| DVec3::from(p) * f64::from(bars[j * n + i]))
                    .sum();
                let mut gradient = seen.to_array();
                if self.space.kind() == SpaceKind::Contracted {
                    let at = ray.at(t[i] + 0.5 * dt[i]).map(f64::from);
                    gradient = [0.0; 3];
                    contract_backward(Norm::L2, at, seen.to_array(), &mut gradient);
                }
                normals[i] = -DVec3::from(gradient).normalize_or_zero();
            }
        }
        Ok(normals)
    }

    /// Final network at points of the scene's frame, which count as Gaussians without extent:
    /// `each(i, density per world unit, colour)`.
    pub(super) fn evaluate(&self, points: &[[f64; 3]], d: &[[f32; 3]], mut each: impl FnMut(usize, f32, [f32; 3])) {
        let ops = self.ops();
        let parts: Vec<Values> = points
            .par_chunks(POINTS)
            .zip(d.par_chunks(POINTS))
            .map_init(Level::default, |level, (points, d)| {
                let n = points.len();
                level.make_room(n);
                for (i, (&point, d)) in points.iter().zip(d).enumerate() {
                    let p = self.space.internal_point(DVec3::from(point)).unwrap_or([0.0; 3]);
                    let gaussian = Gaussian { mean: p.map(f64::from), cov: [0.0; 6] };
                    level.put(n, i, self.contracted(gaussian));
                    for (a, d) in d.iter().enumerate() {
                        level.d[a * n + i] = *d;
                    }
                }
                self.project(n, level);
                fits(self.values(&ops, level))
            })
            .collect();
        for (i, &point) in points.iter().enumerate() {
            let (part, k) = (&parts[i / POINTS], i % POINTS);
            let n = part.sigma.len();
            let point = DVec3::from(point);
            let inside = self.space.internal_point(point).is_some();
            let sigma = part.sigma[k] * self.space.per_world_unit(point) as f32;
            each(i, if inside { sigma } else { 0.0 }, [part.rgb[k], part.rgb[n + k], part.rgb[2 * n + k]]);
        }
    }
}
