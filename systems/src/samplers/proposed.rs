//! From rays to the intervals that the field sees: round after round of proposals, and the way back for their own loss.

use super::proposals::{ProposalField, Proposals};
use crate::buffers::sized;
use crate::fields::{Features, Part, Places};
use crate::space::{InternalRay, Space};
use float_core::Simd;
use losses::interlevel::{self, Levels, interlevel_backward};
use losses::{Edges, RayIntervals, Reduction};
use render_core::histogram::Quantiles;
use render_core::proposal::{Refine, Resampler};
use render_core::quadrature::{LastInterval, Samples, Weights, WeightsBar, weights, weights_backward};
use render_core::ray_distance::RayDistance;

/// How intervals are drawn.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Draw<'a> {
    /// One random number a ray and round, and flattened weights; activations are kept for the way back.
    Training {
        /// `[rounds + 1][rays of the batch]`, in `[0, 1)`.
        jitter: &'a [f32],
        /// Rays of the batch, and the first of those given.
        rays: usize,
        first: usize,
        exponent: f32,
    },
    /// The same intervals each time.
    Render,
}

impl Draw<'_> {
    fn exponent(&self) -> f32 {
        match self {
            Self::Training { exponent, .. } => *exponent,
            Self::Render => 1.0,
        }
    }

    fn shares(&self, round: usize, ray: u32) -> Quantiles<'_> {
        match self {
            Self::Training { jitter, rays, first, .. } => {
                Quantiles::Shared(jitter[round * rays + first + ray as usize])
            }
            Self::Render => Quantiles::Centres,
        }
    }
}

/// Buffers of the rays of a chunk or task. Rays that do not cross the space, or do not count, are left out.
#[derive(Default)]
pub(crate) struct Proposed {
    /// Rays that samples are placed on, and their normalised distance.
    rays: Vec<u32>,
    maps: Vec<RayDistance>,
    rounds: Vec<Round>,
    /// `[rays][last + 1]` fenceposts of the intervals that the field sees.
    posts: Vec<f32>,
    resampler: Resampler,
    p: Vec<f32>,
    mlp: Vec<f32>,
    fine_offsets: Vec<u32>,
    ends: [Vec<f32>; 2],
    w_bar: Vec<f32>,
    tau_bar: Vec<f32>,
    interlevel: interlevel::Scratch,
}

/// What a proposal saw.
#[derive(Default)]
struct Round {
    /// Intervals of all rays.
    n: usize,
    /// `[rays + 1]`
    offsets: Vec<u32>,
    /// `[rays][count + 1]` fenceposts in normalised distance.
    posts: Vec<f32>,
    /// `[3][n]`, positions in the grid.
    x: Vec<f32>,
    /// `[n]`, times; only where the proposal knows them.
    times: Vec<f32>,
    features: Vec<f32>,
    acts: Vec<f32>,
    raw: Vec<f32>,
    /// Metric lengths, internal units; then optical depths.
    tau: Vec<f32>,
    w: Vec<f32>,
    trans_end: Vec<f32>,
    features_bar: Vec<f32>,
    /// Interpolated features and their gradient, where these are not what the network sees.
    interpolated: Vec<f32>,
    interpolated_bar: Vec<f32>,
    mlp_grad: Vec<f32>,
}

impl Round {
    fn bytes(&self) -> usize {
        let floats = [
            &self.posts,
            &self.x,
            &self.features,
            &self.acts,
            &self.raw,
            &self.tau,
            &self.w,
            &self.features_bar,
            &self.mlp_grad,
        ];
        4 * (floats.iter().map(|b| b.capacity()).sum::<usize>() + self.offsets.capacity())
    }
}

/// Rays, and the space that they go through.
#[derive(Clone, Copy)]
pub(crate) struct RaysInSpace<'a> {
    /// Level of the kernels.
    pub(crate) simd: Simd,
    pub(crate) space: &'a Space,
    pub(crate) rays: &'a [InternalRay],
}

impl Proposed {
    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        let floats = [&self.posts, &self.p, &self.mlp, &self.ends[0], &self.ends[1], &self.w_bar, &self.tau_bar];
        4 * floats.iter().map(|b| b.capacity()).sum::<usize>() + self.rounds.iter().map(Round::bytes).sum::<usize>()
    }

    /// Intervals that the proposals weighed.
    pub(crate) fn interval_count(&self) -> u64 {
        self.rounds.iter().map(|r| r.n as u64).sum()
    }

    /// Cut the rays for which `counts` holds; `time` is that of a ray, in `[-1, 1]`.
    pub(crate) fn sample(
        &mut self,
        proposals: &Proposals,
        at: &RaysInSpace<'_>,
        counts: impl Fn(usize) -> bool,
        time: impl Fn(usize) -> f32,
        draw: Draw<'_>,
    ) {
        self.rays.clear();
        self.maps.clear();
        for (r, ray) in at.rays.iter().enumerate().filter(|&(r, _)| counts(r)) {
            // A ray that misses the space has no distances to normalise.
            if let Ok(map) = RayDistance::new(proposals.warp, ray.start.into(), ray.end.into()) {
                self.rays.push(r as u32);
                self.maps.push(map);
            }
        }
        self.rounds.resize_with(proposals.fields.len(), Round::default);
        for (k, (field, &count)) in proposals.fields.iter().zip(proposals.rounds()).enumerate() {
            let (before, rest) = self.rounds.split_at_mut(k);
            let round = &mut rest[0];
            let refine = Refine { dilation: proposals.dilation(k), exponent: draw.exponent() };
            let shares = |j: usize| draw.shares(k, self.rays[j]);
            cut(&mut self.resampler, before.last(), refine, shares, self.rays.len(), count, &mut round.posts);
            round.place(&self.maps, count);
            round.fill_times(&*field.features, &self.rays, &time);
            round.weigh(field, at, &self.rays, &mut self.p, &mut self.mlp, draw);
        }
        let k = proposals.fields.len();
        let refine = Refine { dilation: proposals.dilation(k), exponent: draw.exponent() };
        let shares = |j: usize| draw.shares(k, self.rays[j]);
        let (rays, count) = (self.rays.len(), proposals.last());
        cut(&mut self.resampler, self.rounds.last(), refine, shares, rays, count, &mut self.posts);
    }

    /// The cut: middles and lengths of the intervals of all `rays`, written over `t`, `dt`, `offsets`.
    pub(crate) fn intervals(&self, rays: usize, t: &mut Vec<f32>, dt: &mut Vec<f32>, offsets: &mut Vec<u32>) {
        t.clear();
        dt.clear();
        offsets.clear();
        offsets.push(0);
        let stride = self.posts.len() / self.rays.len().max(1);
        let mut asked = self.rays.iter().zip(&self.maps).zip(self.posts.chunks_exact(stride.max(1))).peekable();
        for r in 0..rays as u32 {
            if let Some(((_, map), posts)) = asked.next_if(|((ray, _), _)| **ray == r) {
                each_interval(map, posts, |middle, length| {
                    t.push(middle);
                    dt.push(length);
                });
            }
            offsets.push(t.len() as u32);
        }
    }

    /// Gradients of the proposals' parameters from the weights `w` that the field found in the first intervals of each
    /// ray, `offsets` `[rays + 1]`; `factor` is that of the loss, summed over rays and intervals.
    pub(crate) fn learn(&mut self, proposals: &Proposals, simd: Simd, offsets: &[u32], w: &[f32], factor: f64) {
        let stride = self.posts.len() / self.rays.len().max(1);
        self.fine_offsets.clear();
        self.fine_offsets.push(0);
        let [start, end] = self.ends.each_mut().map(|buffer| sized(buffer, w.len()));
        for (&r, posts) in self.rays.iter().zip(self.posts.chunks_exact(stride.max(1))) {
            let span = offsets[r as usize] as usize..offsets[r as usize + 1] as usize;
            start[span.clone()].copy_from_slice(&posts[..span.len()]);
            end[span.clone()].copy_from_slice(&posts[1..=span.len()]);
            self.fine_offsets.push(span.end as u32);
        }
        let fine = RayIntervals { offsets: &self.fine_offsets, edges: Edges::Apart { start, end } };
        for (round, field) in self.rounds.iter_mut().zip(&proposals.fields) {
            let grad = sized(&mut round.mlp_grad, field.mlp.packed_grad_len());
            grad.fill(0.0);
            let n = round.n;
            let features_bar = sized(&mut round.features_bar, field.rows() * n);
            features_bar.fill(0.0);
            let w_bar = sized(&mut self.w_bar, n);
            w_bar.fill(0.0);
            let (w_proposal, tau) = (&round.w[..n], &round.tau[..n]);
            let posts = RayIntervals { offsets: &round.offsets, edges: Edges::Joined(&round.posts) };
            let levels = Levels { fine, w, proposal: posts, w_proposal };
            interlevel_backward(levels, Reduction::Sum, factor, w_bar, &mut self.interlevel)
                .expect("both cuts are of the same rays");
            let raw_bar = sized(&mut self.tau_bar, n);
            weights_backward(
                simd,
                Samples { offsets: &round.offsets, tau, last: LastInterval::Finite },
                Weights { w: w_proposal, trans_end: &round.trans_end[..self.rays.len()] },
                WeightsBar { w: w_bar, trans_end: None },
                raw_bar,
            );
            for (bar, tau) in raw_bar.iter_mut().zip(tau) {
                // d tau / d raw = tau, as the density is an exponential.
                *bar *= tau;
            }
            let scratch = sized(&mut self.mlp, field.mlp.backward_scratch_len());
            let x_bar = Some((&mut *features_bar, n));
            field.mlp.backward(simd, &field.packed, &round.acts, raw_bar, n, n, x_bar, grad, scratch);
            field.features.pull(&round.features[..field.rows() * n], n, features_bar, &mut round.interpolated_bar);
        }
    }

    /// What round `round` brings to the gradient of its proposal's features.
    pub(crate) fn part(&self, round: usize, features: &dyn Features) -> Part<'_> {
        let r = &self.rounds[round];
        let raw_bar = if features.pulls_in_place() { &r.features_bar } else { &r.interpolated_bar };
        Part { places: Places { x: &r.x[..3 * r.n], times: &r.times }, raw_bar }
    }

    /// Packed gradient of the network of round `round`.
    pub(crate) fn mlp_grad(&self, round: usize) -> &[f32] {
        &self.rounds[round].mlp_grad
    }
}

#[cfg(test)]
impl Proposed {
    /// Fenceposts of each ray's last cut, into `count` intervals.
    pub(crate) fn last_posts(&self, count: usize) -> Vec<&[f32]> {
        self.posts.chunks_exact(count + 1).collect()
    }

    /// Beginning, end and weight of the intervals of round `round`.
    pub(crate) fn weighed(&self, round: usize) -> Vec<(f32, f32, f64)> {
        let r = &self.rounds[round];
        let count = r.n / self.rays.len().max(1);
        let ends = r.posts.chunks_exact(count + 1).flat_map(|p| p.windows(2));
        ends.zip(&r.w).map(|(p, w)| (p[0], p[1], f64::from(*w))).collect()
    }
}

impl Round {
    /// Offsets of `count` intervals a ray.
    fn place(&mut self, maps: &[RayDistance], count: usize) {
        self.n = maps.len() * count;
        self.offsets.clear();
        self.offsets.extend((0..=maps.len()).map(|r| (r * count) as u32));
        let tau = sized(&mut self.tau, self.n);
        let t = sized(&mut self.w, self.n);
        let mut i = 0;
        for (map, posts) in maps.iter().zip(self.posts.chunks_exact(count + 1)) {
            each_interval(map, posts, |middle, length| {
                (t[i], tau[i]) = (middle, length);
                i += 1;
            });
        }
    }

    /// Times of the intervals, where the proposal knows them.
    fn fill_times(&mut self, features: &dyn Features, asked: &[u32], time: impl Fn(usize) -> f32) {
        self.times.clear();
        if !features.view_times().is_empty() {
            for (&r, span) in asked.iter().zip(self.offsets.windows(2)) {
                self.times.extend(std::iter::repeat_n(time(r as usize), (span[1] - span[0]) as usize));
            }
        }
    }

    /// Weights of the intervals.
    fn weigh(
        &mut self,
        field: &ProposalField,
        at: &RaysInSpace<'_>,
        asked: &[u32],
        p: &mut Vec<f32>,
        mlp: &mut Vec<f32>,
        draw: Draw<'_>,
    ) {
        let (&RaysInSpace { simd, space, rays }, n) = (at, self.n);
        let p = sized(p, 3 * n);
        for (&r, span) in asked.iter().zip(self.offsets.windows(2)) {
            for i in span[0] as usize..span[1] as usize {
                let at = rays[r as usize].at(self.w[i]);
                (p[i], p[n + i], p[2 * n + i]) = (at[0], at[1], at[2]);
            }
        }
        let x = sized(&mut self.x, 3 * n);
        space.grid_positions(simd, p, x);
        let features = sized(&mut self.features, field.rows() * n);
        field.features.encode(Places { x, times: &self.times }, features, &mut self.interpolated);
        let raw = sized(&mut self.raw, n);
        match draw {
            Draw::Training { .. } => {
                let acts = sized(&mut self.acts, field.mlp.activations_len(n));
                field.mlp.forward(simd, &field.packed, features, n, n, raw, n, acts);
            }
            Draw::Render => {
                let scratch = sized(mlp, field.mlp.infer_scratch_len());
                field.mlp.infer(simd, &field.packed, features, n, n, raw, n, scratch);
            }
        }
        let tau = &mut self.tau[..n];
        for (tau, raw) in tau.iter_mut().zip(&raw[..]) {
            *tau *= field.density_of(*raw);
        }
        let samples = Samples { offsets: &self.offsets, tau, last: LastInterval::Finite };
        weights(simd, samples, &mut self.w[..n], sized(&mut self.trans_end, asked.len()));
    }
}

/// `count` intervals of each ray, where the round before found weight: `posts` `[rays][count + 1]`, written.
fn cut<'u>(
    resampler: &mut Resampler,
    before: Option<&Round>,
    refine: Refine,
    shares: impl Fn(usize) -> Quantiles<'u>,
    rays: usize,
    count: usize,
    posts: &mut Vec<f32>,
) {
    posts.resize(rays * (count + 1), 0.0);
    for (j, out) in posts.chunks_exact_mut(count + 1).enumerate() {
        match before {
            Some(round) => {
                let span = round.offsets[j] as usize..round.offsets[j + 1] as usize;
                let s = &round.posts[span.start + j..=span.end + j];
                resampler.next(s, &round.w[span], refine, shares(j), out);
            }
            None => resampler.next(&[0.0, 1.0], &[1.0], Refine { dilation: 0.0, exponent: 1.0 }, shares(j), out),
        }
    }
}

/// Middle and length of each interval between fenceposts, internal units.
fn each_interval(map: &RayDistance, posts: &[f32], mut visit: impl FnMut(f32, f32)) {
    let mut start = map.t_of(posts[0].into());
    for &post in &posts[1..] {
        let end = map.t_of(post.into());
        visit((0.5 * (start + end)) as f32, (end - start) as f32);
        start = end;
    }
}
