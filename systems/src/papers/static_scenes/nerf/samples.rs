//! Where a tile's rays are sampled: stratified for the coarse network, by its weights for the fine one.

use crate::networks::{Along, Level, RaysConfig, Tile, ray_random};
use crate::space::{InternalRay, Space};
use field_core::rng::Rng;
use float_core::Simd;
use render_core::ray::{RayBar, SamplePositionsGrads, sample_positions, sample_positions_backward};
use render_core::sample::{dt_from_points, invert_cdf, merge_sorted, mid_points, stratified_bins};

/// Added to the weights before fine samples are drawn, so that a ray that sees nothing is sampled evenly.
const PAD: f32 = 1e-5;

/// One sample in each of equal bins; in their middle for a render.
pub(super) fn coarse(config: &RaysConfig, space: &Space, rays: &[InternalRay], random: Option<&Rng>, tile: &mut Tile) {
    let n = config.coarse;
    let Tile { coarse: level, ray: scratch, .. } = tile;
    level.begin();
    scratch.drawn.resize(n, 0.0);
    for (r, ray) in rays.iter().enumerate() {
        if ray_random(random, r, 0, &mut scratch.u, n).is_none() {
            scratch.u.clear();
            scratch.u.resize(n, 0.5);
        }
        stratified_bins(ray.start, ray.end, space.spacing(), &scratch.u, &mut scratch.drawn);
        level.push(&scratch.drawn, |dt| dt_from_points(&scratch.drawn, ray.end, dt));
    }
    place(level, rays, space);
}

/// Samples from the coarse weights, merged with the coarse samples.
pub(super) fn fine(config: &RaysConfig, space: &Space, rays: &[InternalRay], random: Option<&Rng>, tile: &mut Tile) {
    let (n, m) = (config.coarse, config.fine);
    let Tile { coarse, fine: level, w, ray: scratch, .. } = tile;
    scratch.drawn.resize(m, 0.0);
    scratch.mid.resize(n - 1, 0.0);
    scratch.cdf.resize(n - 1, 0.0);
    scratch.bins.resize(n + m, 0.0);
    level.begin();
    for (r, ray) in rays.iter().enumerate() {
        let (t, w) = (&coarse.t[r * n..(r + 1) * n], &w[r * n..(r + 1) * n]);
        mid_points(t, &mut scratch.mid);
        match ray_random(random, r, n as u64, &mut scratch.u, m) {
            Some(u) => u.sort_unstable_by(f32::total_cmp),
            None => {
                // Evenly spread shares of the mass.
                scratch.u.clear();
                scratch.u.extend((0..m).map(|i| (i as f32 + 0.5) / m as f32));
            }
        }
        invert_cdf(&scratch.mid, &w[1..n - 1], PAD, &scratch.u, &mut scratch.cdf, &mut scratch.drawn);
        merge_sorted(t, &scratch.drawn, &mut scratch.bins);
        level.push(&scratch.bins, |dt| dt_from_points(&scratch.bins, ray.end, dt));
    }
    place(level, rays, space);
}

/// Positions and directions of all samples.
fn place(level: &mut Level, rays: &[InternalRay], space: &Space) {
    let n = level.t.len();
    level.make_room(n, 3);
    for (r, ray) in rays.iter().enumerate() {
        for i in level.offsets[r] as usize..level.offsets[r + 1] as usize {
            for (a, at) in ray.at(level.t[i]).into_iter().enumerate() {
                level.p[a * n + i] = at;
            }
        }
    }
    level.set_directions(rays);
    encoder_input(space, level);
}

/// Positions in `[-1, 1]`.
pub(super) fn encoder_input(space: &Space, level: &mut Level) {
    space.grid_positions(Simd::best(), &level.p, &mut level.x);
    for x in &mut level.x {
        *x = 2.0 * *x - 1.0;
    }
}

/// Gradients of rays from those of positions in `[-1, 1]`: see [`Recipe::pull_rays`](crate::networks::Recipe::pull_rays).
pub(super) fn pull_rays(space: &Space, along: &Along<'_>, x_bar: &[f32], bars: &mut [RayBar]) {
    let (rays, n) = (along.lines(), along.t.len());
    let (mut p, mut p_bar) = (vec![0.0; 3 * n], vec![0.0; 3 * n]);
    sample_positions(&rays, along.offsets, along.t, &mut p);
    // x = 2 u - 1.
    let unit_bar: Vec<f32> = x_bar.iter().map(|bar| 2.0 * bar).collect();
    space.map().unit_backward(&p, &unit_bar, &mut p_bar);
    sample_positions_backward(&rays, along.offsets, along.t, &p_bar, SamplePositionsGrads { rays: bars, t: None });
}
