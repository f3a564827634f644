//! Where a tile's rays are sampled: stratified for the coarse network, by its weights for the fine one.

use super::{Nerf, PAD};
use crate::space::{InternalRay, Space, SpaceKind};
use field_core::rng::Rng;
use field_core::tape::Arena;
use float_core::Simd;
use render_core::quadrature::{LastInterval, Samples, weights};
use render_core::sample::{Spacing, dt_from_points, invert_cdf, merge_sorted, mid_points, stratified_bins};

/// Memory of a tile.
#[derive(Default)]
pub(super) struct Tile {
    pub(super) coarse: Level,
    pub(super) fine: Level,
    pub(super) bins: Vec<f32>,
    pub(super) mid: Vec<f32>,
    pub(super) u: Vec<f32>,
    pub(super) drawn: Vec<f32>,
    pub(super) w: Vec<f32>,
    pub(super) trans_end: Vec<f32>,
    pub(super) tau: Vec<f32>,
    pub(super) cdf: Vec<f64>,
    pub(super) background: Vec<f32>,
    pub(super) bar: Vec<f32>,
}

/// One network's samples of a tile.
#[derive(Default)]
pub(super) struct Level {
    pub(super) arena: Arena,
    pub(super) offsets: Vec<u32>,
    pub(super) t: Vec<f32>,
    pub(super) dt: Vec<f32>,
    pub(super) p: Vec<f32>,
    pub(super) x: Vec<f32>,
    pub(super) d: Vec<f32>,
    pub(super) noise: Vec<f32>,
}

impl Nerf {
    /// Coarse and fine samples of a tile's rays, then what `use_levels` does with both networks' records.
    pub(super) fn fill_coarse(&self, rays: &[InternalRay], random: Option<&Rng>, tile: &mut Tile) {
        let n = self.config.coarse;
        tile.u.resize(n, 0.5);
        let level = &mut tile.coarse;
        level.begin();
        for (r, ray) in rays.iter().enumerate() {
            fill_u(random, r as u64, 0, &mut tile.u);
            tile.drawn.resize(n, 0.0);
            stratified_bins(ray.start, ray.end, self.spacing(), &tile.u, &mut tile.drawn);
            level.push(&tile.drawn[..n], ray.end);
        }
        level.place(rays, &self.space);
    }

    /// Samples from the coarse weights, merged with the coarse samples.
    pub(super) fn fill_fine(&self, rays: &[InternalRay], raw: &[f32], random: Option<&Rng>, tile: &mut Tile) {
        let (n, m) = (self.config.coarse, self.config.fine);
        let Tile { coarse, fine, bins, mid, u, drawn, w, trans_end, tau, cdf, .. } = tile;
        tau.clear();
        tau.extend(raw.iter().zip(&coarse.dt).map(|(raw, dt)| raw.max(0.0) * dt));
        w.resize(tau.len(), 0.0);
        trans_end.resize(rays.len(), 0.0);
        let samples = Samples { offsets: &coarse.offsets, tau, last: LastInterval::Finite };
        weights(Simd::best(), samples, w, trans_end);
        u.resize(m, 0.0);
        drawn.resize(m, 0.0);
        mid.resize(n - 1, 0.0);
        cdf.resize(n - 1, 0.0);
        bins.resize(n + m, 0.0);
        fine.begin();
        for (r, ray) in rays.iter().enumerate() {
            let (t, w) = (&coarse.t[r * n..(r + 1) * n], &w[r * n..(r + 1) * n]);
            mid_points(t, mid);
            fill_u(random, r as u64, n as u64, u);
            u.sort_unstable_by(f32::total_cmp);
            invert_cdf(mid, &w[1..n - 1], PAD, u, cdf, drawn);
            merge_sorted(t, drawn, bins);
            fine.push(bins, ray.end);
        }
        fine.place(rays, &self.space);
    }

    fn spacing(&self) -> Spacing {
        match self.space.kind() {
            SpaceKind::Contracted => Spacing::Disparity,
            _ => Spacing::Linear,
        }
    }
}

/// Random numbers of a ray, or evenly spaced ones for a render.
fn fill_u(random: Option<&Rng>, ray: u64, from: u64, u: &mut [f32]) {
    match random {
        Some(rng) => rng.substream(ray).fill_uniform(from, u),
        None => {
            let n = u.len() as f32;
            let middle = from == 0;
            for (i, u) in u.iter_mut().enumerate() {
                // The middle of each coarse bin; evenly spread shares of the fine samples' mass.
                *u = if middle { 0.5 } else { (i as f32 + 0.5) / n };
            }
        }
    }
}

impl Level {
    pub(super) fn begin(&mut self) {
        self.t.clear();
        self.dt.clear();
        self.offsets.clear();
        self.offsets.push(0);
    }

    pub(super) fn push(&mut self, t: &[f32], end: f32) {
        let from = self.t.len();
        self.t.extend_from_slice(t);
        self.dt.resize(self.t.len(), 0.0);
        dt_from_points(t, end, &mut self.dt[from..]);
        self.offsets.push(self.t.len() as u32);
    }

    /// Positions in `[-1, 1]` and directions of all samples.
    pub(super) fn place(&mut self, rays: &[InternalRay], space: &Space) {
        let n = self.t.len();
        for rows in [&mut self.p, &mut self.x, &mut self.d] {
            rows.resize(3 * n, 0.0);
        }
        for (r, ray) in rays.iter().enumerate() {
            for i in self.offsets[r] as usize..self.offsets[r + 1] as usize {
                let at = ray.at(self.t[i]);
                for (a, (at, view)) in at.into_iter().zip(ray.view).enumerate() {
                    (self.p[a * n + i], self.d[a * n + i]) = (at, view);
                }
            }
        }
        space.grid_positions(Simd::best(), &self.p, &mut self.x);
        for x in &mut self.x {
            *x = 2.0 * *x - 1.0;
        }
    }
}
