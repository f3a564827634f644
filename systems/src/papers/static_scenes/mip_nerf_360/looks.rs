//! The intervals of a look at a tile of rays, and the Gaussians that stand for them.

use super::MipNerf360;
use crate::space::{InternalRay, SpaceKind};
use field_core::rng::Rng;
use field_core::tape::Arena;
use float_core::Simd;
use render_core::contract::{Norm, contract, contract_covariance};
use render_core::frustum::{Moments, symmetric};
use render_core::histogram::Quantiles;
use render_core::proposal::{Refine, Resampler, annealing_exponent, dilation};
use render_core::ray_distance::{RayDistance, RaySpacing};

/// One look.
#[derive(Default)]
pub(super) struct Level {
    pub(super) arena: Arena,
    /// `[rays + 1]`
    pub(super) offsets: Vec<u32>,
    /// `[n + rays]` fenceposts in normalised distance.
    pub(super) s: Vec<f32>,
    /// `[n]` where each interval begins, internal units.
    pub(super) t: Vec<f32>,
    /// `[n]`
    pub(super) dt: Vec<f32>,
    /// `[n]`
    pub(super) w: Vec<f32>,
    /// `[2 K][n]` means and variances along the `K` directions.
    pub(super) x: Vec<f32>,
    /// `[3][n]`
    pub(super) d: Vec<f32>,
    /// Gradient of what the look's tape puts out.
    pub(super) bar: Vec<f32>,
    mean: Vec<f32>,
    cov: Vec<f32>,
}

/// What looks of a tile have in common.
pub(super) struct Looks<'a> {
    pub(super) rays: &'a [InternalRay],
    /// Random numbers of each ray, told apart by these; `None` for a render.
    pub(super) random: Option<(Rng, &'a [usize])>,
    /// Part of the training that is over.
    pub(super) fraction: f32,
}

impl MipNerf360 {
    /// Normalised distance of a ray. Space that ends is cut evenly, space that does not evenly in parallax.
    fn distance(&self, ray: &InternalRay) -> RayDistance {
        let warp = if self.space.kind() == SpaceKind::Contracted { RaySpacing::Reciprocal } else { RaySpacing::Linear };
        let (near, far) = (f64::from(ray.start), f64::from(ray.end));
        RayDistance::new(warp, near, far).expect("rays that end where they start are left out")
    }

    /// Fill the level of look `round` from the weights of the one before, `None` for the first.
    pub(super) fn fill(
        &self,
        looks: &Looks<'_>,
        round: usize,
        before: Option<&Level>,
        resampler: &mut Resampler,
        level: &mut Level,
    ) {
        let (config, rays) = (&self.config, looks.rays.len());
        let m = config.intervals(round);
        let counts = [config.proposal_samples; 8];
        let refine = match before {
            None => Refine { dilation: 0.0, exponent: 1.0 },
            Some(_) => Refine {
                dilation: dilation(config.dilation, config.dilation_spread, &counts[..round]),
                exponent: annealing_exponent(looks.fraction, config.anneal_slope),
            },
        };
        level.s.resize(rays * (m + 1), 0.0);
        level.offsets.clear();
        level.offsets.extend((0..=rays).map(|r| (r * m) as u32));
        for r in 0..rays {
            let rule = match &looks.random {
                Some((rng, ids)) => Quantiles::Shared(rng.substream(ids[r] as u64).uniform_at(round as u64)),
                None => Quantiles::Centres,
            };
            let (s, w) = match before {
                None => (&[0.0, 1.0][..], &[1.0][..]),
                Some(level) => {
                    let span = level.offsets[r] as usize..level.offsets[r + 1] as usize;
                    (&level.s[span.start + r..=span.end + r], &level.w[span])
                }
            };
            resampler.next(s, w, refine, rule, &mut level.s[r * (m + 1)..][..m + 1]);
        }
        self.place(looks.rays, m, level);
    }

    /// Distances, Gaussians and directions of the intervals.
    fn place(&self, rays: &[InternalRay], m: usize, level: &mut Level) {
        let n = rays.len() * m;
        level.make_room(n);
        for (r, ray) in rays.iter().enumerate() {
            let map = self.distance(ray);
            let first = r * (m + 1);
            let (o, d) = (ray.o.map(f64::from), ray.d.map(f64::from));
            let mut t0 = map.t_of(level.s[first].into());
            for k in 0..m {
                let (i, t1) = (r * m + k, map.t_of(level.s[first + k + 1].into()));
                (level.t[i], level.dt[i]) = (t0 as f32, (t1 - t0) as f32);
                let (mean, cov) = Moments::conical(t0, t1, f64::from(ray.radius)).covariance(o, d);
                level.put(n, i, self.contracted(mean, cov));
                for (a, view) in ray.view.into_iter().enumerate() {
                    level.d[a * n + i] = view;
                }
                t0 = t1;
            }
        }
        self.project(n, level);
    }

    /// A Gaussian where the networks see it.
    pub(super) fn contracted(&self, mean: [f64; 3], cov: [f64; 6]) -> ([f64; 3], [f64; 6]) {
        if self.space.kind() != SpaceKind::Contracted {
            return (mean, cov);
        }
        let c = contract_covariance(Norm::L2, mean, &symmetric(cov));
        (contract(Norm::L2, mean), [c[0][0], c[0][1], c[0][2], c[1][1], c[1][2], c[2][2]])
    }

    /// Gaussians along the directions of the encoding.
    pub(super) fn project(&self, n: usize, level: &mut Level) {
        let projection = &self.shapes.projection;
        level.x.resize(2 * projection.len() * n, 0.0);
        let (along, var) = level.x.split_at_mut(projection.len() * n);
        projection
            .project(Simd::best(), &level.mean[..3 * n], &level.cov[..6 * n], along, var)
            .expect("buffers are cut to the shapes of the encoding");
    }
}

impl Level {
    /// Make room for `n` intervals.
    pub(super) fn make_room(&mut self, n: usize) {
        for (buffer, rows) in [
            (&mut self.t, 1),
            (&mut self.dt, 1),
            (&mut self.w, 1),
            (&mut self.mean, 3),
            (&mut self.cov, 6),
            (&mut self.d, 3),
        ] {
            buffer.resize(rows * n, 0.0);
        }
    }

    /// Gaussian of interval `i`.
    pub(super) fn put(&mut self, n: usize, i: usize, (mean, cov): ([f64; 3], [f64; 6])) {
        for (a, m) in mean.into_iter().enumerate() {
            self.mean[a * n + i] = m as f32;
        }
        for (a, c) in cov.into_iter().enumerate() {
            self.cov[a * n + i] = c as f32;
        }
    }
}
