//! One chunk of a training batch: its rays, their samples, and the way there and back through the networks.
//!
//! A batch is cut into a fixed number of chunks, whatever the number of threads; a chunk is one task. Within it the
//! samples go through the networks in tiles of whole rays, small enough that a tile's activations stay in the L2 cache.

use super::field::{Field, sized};
use super::occupy::Marcher;
use crate::data::Batch;
use crate::space::{InternalRay, Space};
use field_core::mlp::Mlp;
use losses::kernel::Kernel;
use render_core::occupancy::OccupancyGrid;
use render_core::quadrature::{
    Composite, CompositeBar, CompositeGrads, LastInterval, Samples, Values, Weights, composite, composite_backward,
};
use std::ops::Range;
use std::time::Instant;

/// Samples a tile aims at (rays stay whole).
const TILE: usize = 480;

/// What a chunk adds up besides gradients.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ChunkStats {
    pub(super) loss: f64,
    pub(super) squared_error: f64,
    /// Rays that count.
    pub(super) rays: f64,
    /// Samples a march without the occupancy grid would have placed.
    pub(super) dense: u64,
    pub(super) seconds: [f64; 3],
}

/// Buffers of a chunk, kept from step to step.
pub(super) struct Chunk {
    rays: Vec<InternalRay>,
    /// `[sh][rays]`, spherical harmonics of the view directions.
    basis: Vec<f32>,
    views: Vec<f32>,
    /// `[rays + 1]`
    offsets: Vec<u32>,
    t: Vec<f32>,
    dt: Vec<f32>,
    /// Samples.
    pub(super) n: usize,
    /// `[3][n]`, internal positions.
    p: Vec<f32>,
    /// `[3][n]`, positions in the grid.
    pub(super) x: Vec<f32>,
    features: Vec<f32>,
    /// `[levels * features][n]`
    pub(super) features_bar: Vec<f32>,
    pub(super) density_grad: Vec<f32>,
    pub(super) colour_grad: Vec<f32>,
    pub(super) stats: ChunkStats,
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
}

/// What all chunks of a step share.
pub(super) struct StepContext<'a> {
    pub(super) field: &'a Field,
    pub(super) space: &'a Space,
    pub(super) occupancy: &'a OccupancyGrid,
    pub(super) marcher: Marcher,
    pub(super) batch: &'a Batch,
    /// Background of each ray of the batch.
    pub(super) background: &'a [[f32; 3]],
    /// Jitter of each ray's first sample, `[0, 1)`.
    pub(super) jitter: &'a [f32],
    pub(super) kernel: Kernel,
    /// One over the rays of the batch that count.
    pub(super) per_ray: f32,
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
            p: Vec::new(),
            x: Vec::new(),
            features: Vec::new(),
            features_bar: Vec::new(),
            density_grad: vec![0.0; field.density.packed_grad_len()],
            colour_grad: vec![0.0; field.colour.packed_grad_len()],
            stats: ChunkStats::default(),
            tile: Tile::default(),
        }
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
        ];
        4 * floats.iter().map(|b| b.capacity()).sum::<usize>() + self.rays.capacity() * size_of::<InternalRay>()
    }

    /// Sample the chunk's rays, render them, and bring the loss back to features and network gradients.
    pub(super) fn run(&mut self, ctx: &StepContext<'_>, rays: Range<usize>) {
        let start = Instant::now();
        self.stats = ChunkStats::default();
        self.density_grad.fill(0.0);
        self.colour_grad.fill(0.0);
        self.march(ctx, rays.clone());
        let marched = Instant::now();
        let (n, rows) = (self.n, ctx.field.grid.out_rows());
        ctx.field.encode(&self.x[..3 * n], sized(&mut self.features, rows * n));
        sized(&mut self.features_bar, rows * n).fill(0.0);
        let encoded = Instant::now();
        let count = rays.len();
        let mut first = 0;
        while first < count {
            let begin = self.offsets[first];
            let mut last = first + 1;
            while last < count && (self.offsets[last + 1] - begin) as usize <= TILE {
                last += 1;
            }
            self.render_tile(ctx, rays.start, first..last);
            first = last;
        }
        let seconds = |a: Instant, b: Instant| (b - a).as_secs_f64();
        self.stats.seconds = [seconds(start, marched), seconds(marched, encoded), seconds(encoded, Instant::now())];
    }

    /// Place samples along the rays, skipping what the occupancy grid knows to be empty.
    fn march(&mut self, ctx: &StepContext<'_>, rays: Range<usize>) {
        self.rays.clear();
        self.offsets.clear();
        self.offsets.push(0);
        self.t.clear();
        self.dt.clear();
        for i in rays {
            let ray = ctx.space.internal_ray(&ctx.batch.rays[i]);
            if ctx.batch.weight[i] > 0.0 {
                let marched = ctx.marcher.march(ctx.occupancy, &ray, ctx.jitter[i], |t, dt| {
                    self.t.push(t);
                    self.dt.push(dt);
                });
                self.stats.dense += u64::from(marched.lattice);
            }
            self.rays.push(ray);
            self.offsets.push(self.t.len() as u32);
        }
        ctx.field.basis(&self.rays, &mut self.views, &mut self.basis);
        self.n = self.t.len();
        let n = self.n;
        let p = sized(&mut self.p, 3 * n);
        for (r, ray) in self.rays.iter().enumerate() {
            for i in self.offsets[r] as usize..self.offsets[r + 1] as usize {
                let at = ray.at(self.t[i]);
                (p[i], p[n + i], p[2 * n + i]) = (at[0], at[1], at[2]);
            }
        }
        ctx.space.grid_positions(ctx.field.simd, p, sized(&mut self.x, 3 * n));
    }

    /// Rays `rays` of the chunk (`base` is the chunk's first ray in the batch), forward and backward.
    fn render_tile(&mut self, ctx: &StepContext<'_>, base: usize, rays: Range<usize>) {
        let (field, n_all) = (ctx.field, self.n);
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
        let batch_rays = base + rays.start..base + rays.end;
        let background = sized(&mut t.background, 3 * count);
        for (b, i) in background.chunks_exact_mut(3).zip(batch_rays.clone()) {
            b.copy_from_slice(&ctx.background[i]);
        }
        let quadrature = Samples { offsets: &t.offsets, tau, last: LastInterval::Finite };
        let values = Values { data: rgb, stride: n, channels: 3 };
        let w = sized(&mut t.w, n);
        let pixel = sized(&mut t.pixel, 3 * count);
        let opacity = sized(&mut t.opacity, count);
        let trans_end = sized(&mut t.trans_end, count);
        composite(field.simd, quadrature, values, background, Composite { colour: pixel, opacity, trans_end, w });

        // Loss: truth and prediction on the same background.
        let pixel_bar = sized(&mut t.pixel_bar, 3 * count);
        for (r, i) in batch_rays.enumerate() {
            let (alpha, weight) = (ctx.batch.alpha[i], ctx.batch.weight[i]);
            self.stats.rays += f64::from(weight);
            for c in 0..3 {
                let truth = ctx.batch.rgb[i][c] * alpha + ctx.background[i][c] * (1.0 - alpha);
                let (value, e) = (pixel[3 * r + c], pixel[3 * r + c] - truth);
                let slope = ctx.kernel.derivative(value, truth);
                let value = ctx.kernel.value(value, truth);
                self.stats.loss += f64::from(weight * value) / 3.0;
                self.stats.squared_error += f64::from(weight * e * e) / 3.0;
                pixel_bar[3 * r + c] = weight * slope * ctx.per_ray / 3.0;
            }
        }
        if n == 0 {
            return;
        }

        // And back.
        let tau_bar = sized(&mut t.tau_bar, n);
        let rgb_bar = sized(&mut t.rgb_bar, 3 * n);
        composite_backward(
            field.simd,
            quadrature,
            values,
            background,
            Weights { w, trans_end },
            CompositeBar { colour: pixel_bar, w: None, trans_end: None },
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
