//! Where a tile's cones are cut, and the Gaussians of the pieces.

use super::MipNerfConfig;
use crate::networks::{Along, GaussianBar, Level, Tile, ray_random};
use crate::space::{InternalRay, Space, SpaceKind};
use field_core::rng::Rng;
use render_core::contract::{Norm, contract, contract_covariance};
use render_core::frustum::{Frustum, Moments, symmetric};
use render_core::histogram::{Quantiles, blur_weights, quantiles, resample_fenceposts};
use render_core::ray::RayBar;
use render_core::sample::{bin_edges, dt_from_edges, stratified_nerf};

/// Evenly spaced fenceposts from end to end, jittered in training.
pub(super) fn coarse(
    config: &MipNerfConfig,
    space: &Space,
    rays: &[InternalRay],
    random: Option<&Rng>,
    tile: &mut Tile,
) {
    let n = config.levels.rays.coarse + 1;
    let Tile { coarse: level, ray: scratch, .. } = tile;
    level.begin();
    scratch.drawn.resize(n, 0.0);
    for (r, ray) in rays.iter().enumerate() {
        let (spacing, posts) = (space.spacing(), &mut scratch.drawn[..]);
        match ray_random(random, r, 0, &mut scratch.random, n) {
            Some(u) => stratified_nerf(ray.start, ray.end, spacing, u, posts),
            None => bin_edges(ray.start, ray.end, spacing, posts),
        }
        push(level, &scratch.drawn);
    }
    place(level, rays, space);
}

/// Fenceposts anew, from the blurred weights of the coarse level.
pub(super) fn fine(config: &MipNerfConfig, space: &Space, rays: &[InternalRay], random: Option<&Rng>, tile: &mut Tile) {
    let (n, m) = (config.levels.rays.coarse, config.levels.rays.fine + 1);
    let Tile { coarse, fine: level, w, ray: scratch, .. } = tile;
    scratch.u.resize(m, 0.0);
    scratch.drawn.resize(m, 0.0);
    scratch.bins.resize(n + 1, 0.0);
    scratch.blurred.resize(n, 0.0);
    scratch.cdf.resize(n + 1, 0.0);
    level.begin();
    for r in 0..rays.len() {
        let span = r * n..(r + 1) * n;
        let (t, dt) = (&coarse.t[span.clone()], &coarse.dt[span.clone()]);
        scratch.bins[..n].copy_from_slice(t);
        scratch.bins[n] = t[n - 1] + dt[n - 1];
        blur_weights(&w[span], config.cones.resample_padding, &mut scratch.blurred);
        let rule = match ray_random(random, r, n as u64 + 1, &mut scratch.random, m) {
            Some(u) => Quantiles::Each(u),
            None => Quantiles::Ends,
        };
        quantiles(rule, &mut scratch.u);
        resample_fenceposts(&scratch.bins, &scratch.blurred, &scratch.u, &mut scratch.cdf, &mut scratch.drawn);
        push(level, &scratch.drawn);
    }
    place(level, rays, space);
}

/// The intervals between fenceposts.
fn push(level: &mut Level, posts: &[f32]) {
    level.push(&posts[..posts.len() - 1], |dt| dt_from_edges(posts, dt));
}

/// Gaussians and directions of all pieces.
fn place(level: &mut Level, rays: &[InternalRay], space: &Space) {
    let n = level.t.len();
    level.make_room(n, 6);
    let shape = if space.kind() == SpaceKind::Ndc { Frustum::Cylinder } else { Frustum::Cone };
    for (r, ray) in rays.iter().enumerate() {
        for i in level.offsets[r] as usize..level.offsets[r + 1] as usize {
            let moments = Moments::new(shape, level.t[i], level.t[i] + level.dt[i], ray.radius);
            let (mean, cov) = moments.covariance(ray.o, ray.d);
            put(level, space.kind(), i, n, Gaussian { mean, cov });
        }
    }
    level.set_directions(rays);
}

/// Points as the Gaussians of cubes of this side.
pub(super) fn cubes(side: f32, space: &Space, n: usize, level: &mut Level) {
    let var = side * side / 12.0;
    for i in 0..n {
        let mean = [level.p[i], level.p[n + i], level.p[2 * n + i]];
        put(level, space.kind(), i, n, Gaussian { mean, cov: [var, 0.0, 0.0, var, 0.0, var] });
    }
}

/// The Gaussian of a piece of a cone.
struct Gaussian {
    mean: [f32; 3],
    /// Upper triangle of the covariance.
    cov: [f32; 6],
}

/// Gaussian `i` of `n`: its mean, and mean and variances in the cube `[-1, 1]^3` that the encoding sees.
fn put(level: &mut Level, kind: SpaceKind, i: usize, n: usize, gaussian: Gaussian) {
    let Gaussian { mean, cov } = gaussian;
    let (seen, var) = match kind {
        SpaceKind::Box | SpaceKind::Ndc => (mean, [cov[0], cov[3], cov[5]]),
        SpaceKind::Contracted => {
            let cov = contract_covariance(Norm::Max, mean, &symmetric(cov));
            // The contracted cube has twice the side.
            (contract(Norm::Max, mean).map(|x| 0.5 * x), [0, 1, 2].map(|a| 0.25 * cov[a][a]))
        }
    };
    for a in 0..3 {
        level.p[a * n + i] = mean[a];
        level.x[a * n + i] = seen[a];
        level.x[(3 + a) * n + i] = var[a];
    }
}

/// Gradients of rays from those of means and variances: see [`Recipe::pull_rays`](crate::networks::Recipe::pull_rays).
pub(super) fn pull_rays(space: &Space, along: &Along<'_>, x_bar: &[f32], bars: &mut [RayBar]) {
    let n = along.t.len();
    let shape = if space.kind() == SpaceKind::Ndc { Frustum::Cylinder } else { Frustum::Cone };
    // As in `put`.
    let (contraction, half) = match space.kind() {
        SpaceKind::Box | SpaceKind::Ndc => (None, 1.0),
        SpaceKind::Contracted => (Some(Norm::Max), 0.5),
    };
    for ((r, line), bar) in along.lines().iter().enumerate().zip(bars) {
        for i in along.offsets[r] as usize..along.offsets[r + 1] as usize {
            let (t0, dt) = (f64::from(along.t[i]), f64::from(along.dt[i]));
            let moments = Moments::new(shape, t0, t0 + dt, f64::from(along.rays[r].radius));
            let mean = [0, 1, 2].map(|a| half * f64::from(x_bar[a * n + i]));
            let [xx, yy, zz] = [3, 4, 5].map(|a| half * half * f64::from(x_bar[a * n + i]));
            GaussianBar { mean, cov: [xx, 0.0, 0.0, yy, 0.0, zz] }.pull(contraction, &moments, line, bar);
        }
    }
}
