//! The intervals of a round along a tile's rays, from the weights of the round before.

use super::config::MOST_ROUNDS;
use super::driver::MipNerf360;
use super::level::{Gaussian, Level};
use crate::space::{InternalRay, SpaceKind};
use field_core::rng::Rng;
use float_core::Simd;
use render_core::contract::{Norm, contract, contract_covariance};
use render_core::frustum::{Moments, symmetric};
use render_core::histogram::Quantiles;
use render_core::proposal::{Refine, Resampler, annealing_exponent, dilation};
use render_core::ray_distance::{RayDistance, RaySpacing};

/// What the rounds of a tile have in common.
pub(super) struct Rounds<'a> {
    pub(super) rays: &'a [InternalRay],
    /// Random numbers of each ray, distinguished by these; `None` for a render.
    pub(super) random: Option<(Rng, &'a [usize])>,
    /// Part of the training that is over.
    pub(super) fraction: f32,
}

impl MipNerf360 {
    /// Normalised distance of a ray. Space that ends is cut evenly, space that does not evenly in parallax.
    pub(super) fn distance(&self, ray: &InternalRay) -> RayDistance {
        let warp = if self.space.kind() == SpaceKind::Contracted { RaySpacing::Reciprocal } else { RaySpacing::Linear };
        let (near, far) = (f64::from(ray.start), f64::from(ray.end));
        RayDistance::new(warp, near, far).expect("rays that end where they start are left out")
    }

    /// Fill the level of round `round` from the weights of the one before, `None` for the first.
    pub(super) fn fill(
        &self,
        rounds: &Rounds<'_>,
        round: usize,
        before: Option<&Level>,
        resampler: &mut Resampler,
        level: &mut Level,
    ) {
        let (config, rays) = (&self.config.rounds, rounds.rays.len());
        let m = config.intervals(round);
        let counts = [config.proposal_samples; MOST_ROUNDS];
        let refine = match before {
            None => Refine { dilation: 0.0, exponent: 1.0 },
            Some(_) => Refine {
                dilation: dilation(config.dilation, config.dilation_spread, &counts[..round]),
                exponent: annealing_exponent(rounds.fraction, config.anneal_slope),
            },
        };
        level.s.resize(rays * (m + 1), 0.0);
        level.offsets.clear();
        level.offsets.extend((0..=rays).map(|r| (r * m) as u32));
        for r in 0..rays {
            let rule = match &rounds.random {
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
        self.place(rounds.rays, m, level);
    }

    /// Distances, Gaussians and directions of the intervals.
    pub(super) fn place(&self, rays: &[InternalRay], m: usize, level: &mut Level) {
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
                level.put(n, i, self.contracted(Gaussian { mean, cov }));
                for (a, view) in ray.view.into_iter().enumerate() {
                    level.d[a * n + i] = view;
                }
                t0 = t1;
            }
        }
        self.project(n, level);
    }

    /// A Gaussian where the networks see it.
    pub(super) fn contracted(&self, gaussian: Gaussian) -> Gaussian {
        if self.space.kind() != SpaceKind::Contracted {
            return gaussian;
        }
        let Gaussian { mean, cov } = gaussian;
        let c = contract_covariance(Norm::L2, mean, &symmetric(cov));
        let cov = [c[0][0], c[0][1], c[0][2], c[1][1], c[1][2], c[2][2]];
        Gaussian { mean: contract(Norm::L2, mean), cov }
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
