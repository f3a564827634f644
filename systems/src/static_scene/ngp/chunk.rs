//! One chunk of a training batch: its rays, the samples they keep, and the way there and back through the networks.
//!
//! A batch is cut into a fixed number of chunks, whatever the number of threads; a chunk is one task. Within it the
//! samples go through the networks in tiles of whole rays, small enough that a tile's activations stay in the L2 cache.

use super::field::{Field, sized};
use super::grid_trainer::Part;
use super::look::{Kept, Look};
use super::occupy::Marcher;
use super::proposal::Proposals;
use super::proposed::{Draw, Proposed};
use crate::data::Batch;
use crate::space::{InternalRay, Space};
use field_core::mlp::Mlp;
use losses::kernel::Kernel;
use losses::{Edges, RayIntervals, Reduction, distortion};
use render_core::occupancy::OccupancyGrid;
use render_core::quadrature::{
    Composite, CompositeBar, CompositeGrads, LastInterval, Samples, Values, Weights, composite, composite_backward,
};
use render_core::ray::Ray;
use render_core::ray_distance::RayDistance;
use std::ops::Range;
use std::time::Instant;

/// Samples a tile aims at (rays stay whole).
const TILE: usize = 480;

/// What a chunk adds up besides gradients.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ChunkStats {
    pub(super) loss: f64,
    pub(super) squared_error: f64,
    /// Pixels that count.
    pub(super) pixels: f64,
    /// Samples a march without the occupancy grid would have placed.
    pub(super) dense: u64,
    /// Samples the march placed.
    pub(super) placed: u64,
    /// Samples whose density was asked for.
    pub(super) looked: u64,
    /// Intervals that proposals weighed.
    pub(super) proposed: u64,
    /// March or proposals, encoding, networks, the proposals' way back.
    pub(super) seconds: [f64; 4],
}

/// Buffers of a chunk, kept from step to step.
pub(super) struct Chunk {
    rays: Vec<InternalRay>,
    /// `[sh][rays]`, spherical harmonics of the view directions.
    basis: Vec<f32>,
    views: Vec<f32>,
    /// `[rays + 1]`
    offsets: Vec<u32>,
    /// Distances of the samples, and their steps.
    t: Vec<f32>,
    dt: Vec<f32>,
    /// Samples: of each ray those in front of what is opaque.
    pub(super) n: usize,
    /// `[3][n]`, positions in the grid.
    pub(super) x: Vec<f32>,
    features: Vec<f32>,
    /// `[levels * features][n]`
    pub(super) features_bar: Vec<f32>,
    pub(super) density_grad: Vec<f32>,
    pub(super) colour_grad: Vec<f32>,
    pub(super) stats: ChunkStats,
    pub(super) proposed: Proposed,
    /// `[n]`, weights of the samples; only where proposals learn from them.
    w: Vec<f32>,
    look: Look,
    tile: Tile,
}

/// Buffers of a tile.
#[derive(Default)]
struct Tile {
    density_acts: Vec<f32>,
    colour_acts: Vec<f32>,
    /// Input of the colour network, `[geometry + sh][n]`; its first rows are the density network's output.
    input: Vec<f32>,
    input_bar: Vec<f32>,
    rgb: Vec<f32>,
    rgb_bar: Vec<f32>,
    tau: Vec<f32>,
    tau_bar: Vec<f32>,
    w: Vec<f32>,
    offsets: Vec<u32>,
    background: Vec<f32>,
    pixel: Vec<f32>,
    pixel_bar: Vec<f32>,
    opacity: Vec<f32>,
    trans_end: Vec<f32>,
    scratch: Vec<f32>,
    /// Ends of the intervals in normalised distance, and the gradient of their weights.
    ends: [Vec<f32>; 2],
    w_bar: Vec<f32>,
}

/// What all chunks of a step share.
pub(super) struct StepContext<'a> {
    pub(super) field: &'a Field,
    pub(super) space: &'a Space,
    pub(super) occupancy: &'a OccupancyGrid,
    pub(super) marcher: Marcher,
    /// Where samples are placed by proposals instead, and the exponent of their weights.
    pub(super) proposals: Option<&'a Proposals>,
    pub(super) exponent: f32,
    /// Part of a sample's interval that lies in front of it.
    pub(super) lead: f32,
    pub(super) batch: &'a Batch,
    /// Rays of a pixel: its colour is the mean of theirs.
    pub(super) per_pixel: usize,
    /// `[pixels * per_pixel]`
    pub(super) rays: &'a [Ray],
    /// Background of each pixel of the batch.
    pub(super) background: &'a [[f32; 3]],
    /// `[1 + proposals][rays]`, jitter of each ray's first sample, `[0, 1)`.
    pub(super) jitter: &'a [f32],
    pub(super) kernel: Kernel,
    /// Factor of the distortion loss, and the distance it is measured in.
    pub(super) distortion: f32,
    pub(super) distance: RayDistance,
    /// Optical depth behind which nothing is looked at.
    pub(super) depth_limit: f64,
    /// One over the pixels of the batch that count.
    pub(super) share: f32,
}

impl Chunk {
    pub(super) fn new(field: &Field) -> Self {
        Self {
            rays: Vec::new(),
            basis: Vec::new(),
            views: Vec::new(),
            offsets: Vec::new(),
            t: Vec::new(),
            dt: Vec::new(),
            n: 0,
            x: Vec::new(),
            features: Vec::new(),
            features_bar: Vec::new(),
            density_grad: vec![0.0; field.density.packed_grad_len()],
            colour_grad: vec![0.0; field.colour.packed_grad_len()],
            stats: ChunkStats::default(),
            proposed: Proposed::default(),
            w: Vec::new(),
            look: Look::default(),
            tile: Tile::default(),
        }
    }

    /// What it brings to the gradient of the grid.
    pub(super) fn part(&self) -> Part<'_> {
        Part { n: self.n, x: &self.x, features_bar: &self.features_bar }
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        let t = &self.tile;
        let floats = [
            &self.t,
            &self.dt,
            &self.x,
            &self.features,
            &self.features_bar,
            &self.density_grad,
            &self.colour_grad,
            &t.density_acts,
            &t.colour_acts,
            &t.input,
            &t.input_bar,
            &t.rgb,
            &t.rgb_bar,
            &t.tau,
            &t.tau_bar,
            &t.w,
            &self.w,
        ];
        let rays = self.rays.capacity() * size_of::<InternalRay>();
        4 * floats.iter().map(|b| b.capacity()).sum::<usize>() + rays + self.look.bytes() + self.proposed.bytes()
    }

    /// Sample the rays of the batch's pixels `pixels`, render them, and bring the loss back to features and network
    /// gradients.
    pub(super) fn run(&mut self, ctx: &StepContext<'_>, pixels: Range<usize>) {
        let start = Instant::now();
        self.stats = ChunkStats::default();
        self.density_grad.fill(0.0);
        self.colour_grad.fill(0.0);
        let rays = pixels.start * ctx.per_pixel..pixels.end * ctx.per_pixel;
        self.rays.clear();
        self.rays.extend(ctx.rays[rays.clone()].iter().map(|ray| ctx.space.internal_ray(ray)));
        ctx.field.basis(&self.rays, &mut self.views, &mut self.basis);
        match ctx.proposals {
            None => self.look.march(ctx, &self.rays, rays),
            Some(proposals) => {
                let counts = |r: usize| ctx.batch.weight[(rays.start + r) / ctx.per_pixel] > 0.0;
                let (all, first) = (ctx.rays.len(), rays.start);
                let draw = Draw::Training { jitter: ctx.jitter, rays: all, first, exponent: ctx.exponent };
                self.proposed.sample((proposals, ctx.field.simd, ctx.space), &self.rays, counts, draw);
                self.look.take(&self.proposed, self.rays.len());
                self.stats.proposed = self.proposed.looked();
            }
        }
        let marched = Instant::now();
        let Self { offsets, t, dt, x, features, .. } = self;
        self.n = self.look.follow(ctx, &self.rays, Kept { offsets, t, dt, x, features });
        let (n, rows) = (self.n, ctx.field.grid.out_rows());
        sized(&mut self.features_bar, rows * n).fill(0.0);
        if ctx.proposals.is_some() {
            sized(&mut self.w, n);
        }
        self.stats.dense = self.look.dense;
        self.stats.placed = self.look.placed();
        self.stats.looked = self.look.looked;
        let encoded = Instant::now();
        let (count, k) = (pixels.len(), ctx.per_pixel);
        let mut first = 0;
        while first < count {
            let mut last = first + 1;
            while last < count && (self.offsets[(last + 1) * k] - self.offsets[first * k]) as usize <= TILE {
                last += 1;
            }
            self.render_tile(ctx, pixels.start, first..last);
            first = last;
        }
        let rendered = Instant::now();
        if let Some(proposals) = ctx.proposals {
            // The mean over rays and final intervals.
            let factor = f64::from(ctx.share) / (k * proposals.last()) as f64;
            self.proposed.learn((proposals, ctx.field.simd), &self.offsets, &self.w[..n], factor);
        }
        let seconds = |a: Instant, b: Instant| (b - a).as_secs_f64();
        self.stats.seconds = [
            seconds(start, marched),
            seconds(marched, encoded),
            seconds(encoded, rendered),
            seconds(rendered, Instant::now()),
        ];
    }

    /// Pixels `pixels` of the chunk (`base` is the chunk's first in the batch), forward and backward.
    fn render_tile(&mut self, ctx: &StepContext<'_>, base: usize, pixels: Range<usize>) {
        let (field, n_all, k) = (ctx.field, self.n, ctx.per_pixel);
        let rays = pixels.start * k..pixels.end * k;
        let samples = self.offsets[rays.start] as usize..self.offsets[rays.end] as usize;
        let (n, count) = (samples.len(), rays.len());
        let t = &mut self.tile;
        let geometry = field.density.outputs();
        let inputs = field.colour.inputs();

        // Density, and with it the geometry features of the colour network.
        let input = sized(&mut t.input, inputs * n);
        let density_acts = sized(&mut t.density_acts, field.density.activations_len(n));
        let features = &self.features[samples.start.min(self.features.len())..];
        field.density.forward(field.simd, &field.density_packed, features, n_all, n, input, n, density_acts);
        let tau = sized(&mut t.tau, n);
        for (i, tau) in tau.iter_mut().enumerate() {
            *tau = field.density_of(input[i]) * self.dt[samples.start + i];
        }

        // Colour.
        t.offsets.clear();
        t.offsets.extend(self.offsets[rays.start..=rays.end].iter().map(|o| o - samples.start as u32));
        for r in 0..count {
            let span = t.offsets[r] as usize..t.offsets[r + 1] as usize;
            for k in 0..inputs - geometry {
                input[(geometry + k) * n..][span.clone()].fill(self.basis[k * self.rays.len() + rays.start + r]);
            }
        }
        let rgb = sized(&mut t.rgb, 3 * n);
        let colour_acts = sized(&mut t.colour_acts, field.colour.activations_len(n));
        field.colour.forward(field.simd, &field.colour_packed, input, n, n, rgb, n, colour_acts);

        // Pixel.
        let pixels = base + pixels.start..base + pixels.end;
        let background = sized(&mut t.background, 3 * count);
        for (b, i) in background.chunks_exact_mut(3 * k).zip(pixels.clone()) {
            b.as_chunks_mut().0.fill(ctx.background[i]);
        }
        let quadrature = Samples { offsets: &t.offsets, tau, last: LastInterval::Finite };
        let values = Values { data: rgb, stride: n, channels: 3 };
        let w = sized(&mut t.w, n);
        let pixel = sized(&mut t.pixel, 3 * count);
        let opacity = sized(&mut t.opacity, count);
        let trans_end = sized(&mut t.trans_end, count);
        composite(field.simd, quadrature, values, background, Composite { colour: pixel, opacity, trans_end, w });
        if ctx.proposals.is_some() {
            self.w[samples.clone()].copy_from_slice(w);
        }

        // Loss: truth and prediction on the same background.
        let pixel_bar = sized(&mut t.pixel_bar, 3 * count);
        let per_ray = 1.0 / k as f32;
        for (i, (rays, bars)) in pixels.zip(pixel.chunks_exact(3 * k).zip(pixel_bar.chunks_exact_mut(3 * k))) {
            let (alpha, weight) = (ctx.batch.alpha[i], ctx.batch.weight[i]);
            self.stats.pixels += f64::from(weight);
            for c in 0..3 {
                let truth = ctx.batch.rgb[i][c] * alpha + ctx.background[i][c] * (1.0 - alpha);
                let value = per_ray * rays[c..].iter().step_by(3).sum::<f32>();
                let e = value - truth;
                self.stats.loss += f64::from(weight * ctx.kernel.value(value, truth)) / 3.0;
                self.stats.squared_error += f64::from(weight * e * e) / 3.0;
                let slope = weight * ctx.kernel.derivative(value, truth) * ctx.share * per_ray / 3.0;
                bars[c..].iter_mut().step_by(3).for_each(|bar| *bar = slope);
            }
        }
        if n == 0 {
            return;
        }

        // Weight that is spread along the ray costs.
        let w_bar = if ctx.distortion > 0.0 {
            let [start, end] = t.ends.each_mut().map(|buffer| sized(buffer, n));
            for i in 0..n {
                let dt = self.dt[samples.start + i];
                let at = self.t[samples.start + i] - ctx.lead * dt;
                (start[i], end[i]) = (ctx.distance.s_of(at.into()) as f32, ctx.distance.s_of((at + dt).into()) as f32);
            }
            let intervals = RayIntervals { offsets: &t.offsets, edges: Edges::Apart { start, end } };
            let w_bar = sized(&mut t.w_bar, n);
            w_bar.fill(0.0);
            let factor = f64::from(ctx.distortion * per_ray);
            let fits = "offsets and samples are those of the tile";
            self.stats.loss += factor * distortion::distortion(intervals, w, Reduction::Sum).expect(fits);
            let factor = factor * f64::from(ctx.share);
            distortion::distortion_backward(intervals, w, Reduction::Sum, factor, w_bar).expect(fits);
            Some(&*w_bar)
        } else {
            None
        };

        // And back.
        let tau_bar = sized(&mut t.tau_bar, n);
        let rgb_bar = sized(&mut t.rgb_bar, 3 * n);
        composite_backward(
            field.simd,
            quadrature,
            values,
            background,
            Weights { w, trans_end },
            CompositeBar { colour: pixel_bar, w: w_bar, trans_end: None },
            CompositeGrads { tau: tau_bar, values: rgb_bar, background: None },
        );
        let input_bar = sized(&mut t.input_bar, inputs * n);
        input_bar.fill(0.0);
        let scratch_len = field.colour.backward_scratch_len().max(field.density.backward_scratch_len());
        let scratch = sized(&mut t.scratch, scratch_len);
        backward(
            &field.colour,
            ctx,
            &field.colour_packed,
            colour_acts,
            rgb_bar,
            n,
            (input_bar, n),
            &mut self.colour_grad,
            scratch,
        );
        for i in 0..n {
            // d tau / d raw = tau, as the density is an exponential.
            input_bar[i] += tau_bar[i] * tau[i];
        }
        let features_bar = &mut self.features_bar[samples.start..];
        backward(
            &field.density,
            ctx,
            &field.density_packed,
            density_acts,
            input_bar,
            n,
            (features_bar, n_all),
            &mut self.density_grad,
            scratch,
        );
    }
}

#[expect(clippy::too_many_arguments, reason = "forwards a kernel call")]
fn backward(
    mlp: &Mlp,
    ctx: &StepContext<'_>,
    packed: &field_core::mlp::Packed,
    acts: &[f32],
    y_bar: &[f32],
    n: usize,
    x_bar: (&mut [f32], usize),
    grad: &mut [f32],
    scratch: &mut [f32],
) {
    mlp.backward(ctx.field.simd, packed, acts, y_bar, n, n, Some(x_bar), grad, scratch);
}
