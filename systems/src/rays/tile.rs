//! A tile: whole rays of a chunk, few enough that their activations stay in the L2 cache. Forward to pixels, and back.

use super::context::StepContext;
use super::head::{HeadBars, HeadTile, StaticBars, StaticPart};
use super::marched::{Gradients, Marched};
use super::scene_flow::KeptSamples;
use crate::buffers::sized;
use crate::fields::{Columns, Mixed};
use crate::photo_model::{Pixel, PixelBar};
use crate::terms::{RayBars, TileRays};
use render_core::quadrature::{
    Composite, CompositeBar, CompositeGrads, LastInterval, Samples, Values, Weights, composite, composite_backward,
};
use std::ops::Range;

/// Samples a tile aims at (rays stay whole).
pub(super) const TILE: usize = 480;

/// A ray of a tile, static part alone.
pub(super) struct StaticRay<'a> {
    /// Weights of its samples.
    pub(super) w: &'a [f32],
    /// What the colour network saw, `[rows][stride]`; the ray's samples begin at `first`.
    pub(super) input: &'a [f32],
    pub(super) stride: usize,
    pub(super) first: usize,
    pub(super) trans_end: f32,
}

impl StaticRay<'_> {
    /// The sample in which half of what a ray meets lies; `None` for a ray that meets little.
    pub(super) fn middle(&self) -> Option<usize> {
        let mut sum = 0.0;
        self.w.iter().position(|w| {
            sum += w;
            sum >= 0.5
        })
    }
}

/// Buffers of a tile.
#[derive(Default)]
pub(super) struct Tile {
    density_acts: Vec<f32>,
    pub(super) colour_acts: Vec<f32>,
    /// Input of the colour network, `[geometry + sh + appearance][n]`; its first rows are the density network's output.
    input: Vec<f32>,
    input_bar: Vec<f32>,
    rgb: Vec<f32>,
    pub(super) rgb_bar: Vec<f32>,
    tau: Vec<f32>,
    tau_bar: Vec<f32>,
    /// Weights of the static part alone.
    pub(super) w: Vec<f32>,
    pub(super) offsets: Vec<u32>,
    background: Vec<f32>,
    /// Colours of the static part alone.
    pub(super) pixel: Vec<f32>,
    pixel_bar: Vec<f32>,
    opacity: Vec<f32>,
    trans_end: Vec<f32>,
    pub(super) scratch: Vec<f32>,
    /// Gradients of the terms that read whole rays.
    bars: RayBars,
    /// Samples at which something moves, mixed of both parts, and the moving part's share of each sample, `[n]`.
    mixed: Mixed,
    shares: Vec<f32>,
    /// Gradient of the rays' uncertainties and mean transient densities.
    head_bars: HeadBars,
    head: HeadTile,
}

impl Tile {
    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        let floats = [
            &self.density_acts,
            &self.colour_acts,
            &self.input,
            &self.input_bar,
            &self.rgb,
            &self.rgb_bar,
            &self.tau,
            &self.tau_bar,
            &self.w,
            &self.scratch,
            &self.shares,
        ];
        let parts = self.bars.bytes() + self.head.bytes() + self.mixed.bytes();
        4 * floats.iter().map(|b| b.capacity()).sum::<usize>() + parts
    }

    /// Render the rays `rays` of a chunk; `pixels` are their pixels in the batch.
    pub(super) fn forward(
        &mut self,
        ctx: &StepContext<'_>,
        chunk: Marched<'_>,
        rays: Range<usize>,
        pixels: Range<usize>,
    ) {
        let field = ctx.field;
        let samples = chunk.offsets[rays.start] as usize..chunk.offsets[rays.end] as usize;
        let (n, count) = (samples.len(), rays.len());
        let geometry = field.density.outputs();
        let inputs = field.colour.inputs();

        // Density, and with it the geometry features of the colour network.
        let input = sized(&mut self.input, inputs * n);
        let density_acts = sized(&mut self.density_acts, field.density.activations_len(n));
        let features = &chunk.features[samples.start.min(chunk.features.len())..];
        field.density.forward(field.simd, &field.density_packed, features, chunk.n, n, input, n, density_acts);
        self.shares.clear();
        if let Some(part) = &field.moving {
            let moving = chunk.moving.within(samples.clone());
            self.mixed.forward(field.simd, part, moving, &mut input[..geometry * n]);
            self.mixed.shares(moving, sized(&mut self.shares, n));
        }
        let tau = sized(&mut self.tau, n);
        for (i, tau) in tau.iter_mut().enumerate() {
            *tau = field.density_of(input[i]) * chunk.dt[samples.start + i];
        }

        // Colour.
        self.offsets.clear();
        self.offsets.extend(chunk.offsets[rays.start..=rays.end].iter().map(|o| o - samples.start as u32));
        for r in 0..count {
            let span = self.offsets[r] as usize..self.offsets[r + 1] as usize;
            for k in 0..inputs - geometry {
                input[(geometry + k) * n..][span.clone()].fill(chunk.basis[k * chunk.rays + rays.start + r]);
            }
        }
        let rgb = sized(&mut self.rgb, 3 * n);
        let colour_acts = sized(&mut self.colour_acts, field.colour.activations_len(n));
        let columns = Columns::Rays(&self.offsets);
        field.colour.forward(field.simd, &field.colour_packed, input, n, columns, rgb, colour_acts);

        // Pixel.
        let background = sized(&mut self.background, 3 * count);
        for (b, i) in background.chunks_exact_mut(3 * ctx.per_pixel).zip(pixels) {
            b.as_chunks_mut().0.fill(ctx.background[i]);
        }
        if let Some(head) = ctx.head {
            // The first sample of a ray is the veil's: nothing static is there.
            for r in 0..count {
                if self.offsets[r] < self.offsets[r + 1] {
                    tau[self.offsets[r] as usize] = 0.0;
                }
            }
            self.head.forward(
                head,
                ctx,
                chunk,
                rays,
                input,
                &StaticPart { offsets: &self.offsets, tau, rgb, background },
            );
        }
        let quadrature = Samples { offsets: &self.offsets, tau, last: LastInterval::Finite };
        let values = Values { data: rgb, stride: n, channels: 3 };
        let w = sized(&mut self.w, n);
        let pixel = sized(&mut self.pixel, 3 * count);
        let opacity = sized(&mut self.opacity, count);
        let trans_end = sized(&mut self.trans_end, count);
        composite(field.simd, quadrature, values, background, Composite { colour: pixel, opacity, trans_end, w });
    }

    /// The pixels of [`Tile::forward`], each the mean of its rays.
    pub(super) fn pixels(&self, ctx: &StepContext<'_>) -> impl Iterator<Item = Pixel> {
        let per_pixel = ctx.per_pixel;
        let count = self.offsets.len().saturating_sub(1);
        let with_head = ctx.head.is_some();
        let colours = if with_head { self.head.colour() } else { &self.pixel[..] };
        let per_ray = 1.0 / per_pixel as f32;
        (0..count / per_pixel).map(move |p| {
            let rays = &colours[3 * p * per_pixel..][..3 * per_pixel];
            let rgb = [0, 1, 2].map(|c| per_ray * rays[c..].iter().step_by(3).sum::<f32>());
            let of_pixel = p * per_pixel..(p + 1) * per_pixel;
            let opacity = 1.0 - per_ray * self.trans_end[of_pixel.clone()].iter().sum::<f32>();
            let pixel = if with_head { self.head.pixel(rgb, of_pixel) } else { Pixel { rgb, ..Pixel::default() } };
            Pixel { opacity, ..pixel }
        })
    }

    /// Ray `r` of [`Tile::forward`].
    pub(super) fn static_ray(&self, r: usize) -> StaticRay<'_> {
        let span = self.offsets[r] as usize..self.offsets[r + 1] as usize;
        let stride = self.offsets[self.offsets.len() - 1] as usize;
        let (first, trans_end) = (span.start, self.trans_end[r]);
        StaticRay { w: &self.w[span], input: &self.input, stride, first, trans_end }
    }

    /// Write what [`Tile::forward`] found of the samples of `rays` over theirs of the chunk.
    pub(super) fn keep(&self, ctx: &StepContext<'_>, chunk: Marched<'_>, rays: Range<usize>, kept: &mut KeptSamples) {
        let samples = chunk.offsets[rays.start] as usize..chunk.offsets[rays.end] as usize;
        let n = samples.len();
        if n == 0 {
            return;
        }
        kept.tau[samples.clone()].copy_from_slice(&self.tau[..n]);
        for (row, rgb) in kept.rgb.chunks_exact_mut(chunk.n).zip(self.rgb.chunks_exact(n)) {
            row[samples.clone()].copy_from_slice(rgb);
        }
        let still = &mut kept.still[samples.clone()];
        still.copy_from_slice(&self.tau[..n]);
        let dt = &chunk.dt[samples.clone()];
        self.mixed.each_still(chunk.moving.within(samples), |i, raw| still[i] = ctx.field.density_of(raw) * dt[i]);
    }

    /// Take the derivatives of the pixels of [`Tile::forward`], in their order, each times `factor`.
    pub(super) fn set_bars(&mut self, per_pixel: usize, bars: impl Iterator<Item = PixelBar>) {
        self.pixel_bar.clear();
        self.head_bars.clear();
        let per_ray = 1.0 / per_pixel as f32;
        for bar in bars {
            for _ in 0..per_pixel {
                self.pixel_bar.extend(bar.rgb.map(|g| g * per_ray));
                self.head_bars.push(bar.beta * per_ray, bar.sigma_t * per_ray);
            }
        }
    }

    /// Bring the derivatives back to features and network gradients. Returns what the rays cost besides their
    /// colours.
    pub(super) fn backward(
        &mut self,
        ctx: &StepContext<'_>,
        chunk: Marched<'_>,
        rays: Range<usize>,
        pixels: Range<usize>,
        out: &mut Gradients<'_>,
    ) -> f64 {
        let samples = chunk.offsets[rays.start] as usize..chunk.offsets[rays.end] as usize;
        let (n, count) = (samples.len(), rays.len());
        if n == 0 {
            return 0.0;
        }
        let mut loss = 0.0;
        let seen = TileRays {
            offsets: &self.offsets,
            t: &chunk.t[samples.clone()],
            dt: &chunk.dt[samples.clone()],
            lead: ctx.lead,
            tau: &self.tau[..n],
            w: &self.w[..n],
            rgb: &self.rgb[..3 * n],
            trans_end: &self.trans_end[..count],
            moving: &self.shares,
            per_pixel: ctx.per_pixel,
            weight: &ctx.batch.weight[pixels.clone()],
            truth: &ctx.truth[pixels.clone()],
            view: &ctx.batch.view[pixels.clone()],
            place: &ctx.batch.pixel[pixels],
            share: ctx.share,
        };
        self.bars.begin(count, n);
        ctx.terms().for_each(|term| term.add(&seen, &mut self.bars, &mut loss));
        self.composite_backward(ctx, rays.clone(), n, out);
        if let Some(bar) = self.bars.rgb.get() {
            self.rgb_bar.iter_mut().zip(bar).for_each(|(sum, bar)| *sum += bar);
        }
        if let Some(bar) = self.bars.sigma.get() {
            let dt = &chunk.dt[samples.clone()];
            for (tau_bar, (bar, dt)) in self.tau_bar.iter_mut().zip(bar.iter().zip(dt)) {
                *tau_bar += if *dt > 0.0 { bar / dt } else { 0.0 };
            }
        }
        self.networks_backward(ctx, chunk, rays, samples, out);
        loss
    }

    /// From pixels and the terms' gradients of weights and ends to optical depths and colours of the samples.
    fn composite_backward(&mut self, ctx: &StepContext<'_>, rays: Range<usize>, n: usize, out: &mut Gradients<'_>) {
        let (field, count) = (ctx.field, rays.len());
        let tau = &self.tau[..n];
        let background = &self.background[..3 * count];
        let tau_bar = sized(&mut self.tau_bar, n);
        let rgb_bar = sized(&mut self.rgb_bar, 3 * n);
        let (w_bar, end_bar) = (self.bars.w.get(), self.bars.trans_end.get());
        let plain = |pixel_bar: &[f32], tau_bar: &mut [f32], rgb_bar: &mut [f32]| {
            composite_backward(
                field.simd,
                Samples { offsets: &self.offsets, tau, last: LastInterval::Finite },
                Values { data: &self.rgb[..3 * n], stride: n, channels: 3 },
                background,
                Weights { w: &self.w[..n], trans_end: &self.trans_end[..count] },
                CompositeBar { colour: pixel_bar, w: w_bar, trans_end: end_bar },
                CompositeGrads { tau: tau_bar, values: rgb_bar, background: None },
            );
        };
        let geometry = field.density.outputs();
        let input_bar = sized(&mut self.input_bar, field.colour.inputs() * n);
        input_bar.fill(0.0);
        let Some(head) = ctx.head else { return plain(&self.pixel_bar, tau_bar, rgb_bar) };
        // The static part alone is spread along the ray, as it alone is rendered elsewhere.
        if w_bar.is_some() || end_bar.is_some() {
            let nothing = sized(&mut self.pixel, 3 * count);
            nothing.fill(0.0);
            plain(nothing, tau_bar, rgb_bar);
        } else {
            tau_bar.fill(0.0);
        }
        let part = StaticPart { offsets: &self.offsets, tau, rgb: &self.rgb[..3 * n], background };
        let bars = StaticBars { tau: &mut *tau_bar, rgb: &mut *rgb_bar, geometry: &mut input_bar[..geometry * n] };
        self.head.backward(head, ctx, rays, &part, &self.pixel_bar, &self.head_bars, bars, out);
        // Nothing static is where the veil is.
        for r in 0..count {
            if self.offsets[r] < self.offsets[r + 1] {
                tau_bar[self.offsets[r] as usize] = 0.0;
            }
        }
    }

    /// From optical depths and colours of the samples through both networks.
    fn networks_backward(
        &mut self,
        ctx: &StepContext<'_>,
        chunk: Marched<'_>,
        rays: Range<usize>,
        samples: Range<usize>,
        out: &mut Gradients<'_>,
    ) {
        let (field, n, count) = (ctx.field, samples.len(), rays.len());
        let inputs = field.colour.inputs();
        let input_bar = &mut self.input_bar[..inputs * n];
        let scratch_len = field.colour.backward_scratch_len().max(field.density.backward_scratch_len());
        let scratch = sized(&mut self.scratch, scratch_len);
        let (packed, acts) = (&field.colour_packed, &self.colour_acts);
        let (rgb_bar, columns) = (&self.rgb_bar[..3 * n], Columns::Rays(&self.offsets));
        let x_bar = Some(&mut *input_bar);
        field.colour.backward(field.simd, packed, acts, rgb_bar, n, columns, x_bar, out.colour, scratch);
        // What the colour network sees of a ray is the same at all its samples.
        if let Some(codes) = ctx.appearance {
            let first = inputs - codes.dims;
            for (r, bars) in
                out.appearance[rays.start * codes.dims..].chunks_exact_mut(codes.dims).take(count).enumerate()
            {
                let span = self.offsets[r] as usize..self.offsets[r + 1] as usize;
                for (k, bar) in bars.iter_mut().enumerate() {
                    *bar += input_bar[(first + k) * n..][span.clone()].iter().sum::<f32>();
                }
            }
        }
        for (k, bars) in out.directions.chunks_exact_mut(chunk.rays.max(1)).enumerate() {
            let row = &input_bar[(field.density.outputs() + k) * n..][..n];
            for (bar, span) in bars[rays.clone()].iter_mut().zip(self.offsets.windows(2)) {
                *bar += row[span[0] as usize..span[1] as usize].iter().sum::<f32>();
            }
        }
        for (bar, (tau_bar, tau)) in input_bar.iter_mut().zip(self.tau_bar.iter().zip(&self.tau[..n])) {
            // d tau / d raw = tau, as the density is an exponential.
            *bar += tau_bar * tau;
        }
        if let Some(part) = &field.moving {
            let (moving, raw_bar) =
                (chunk.moving.within(samples.clone()), &mut input_bar[..field.density.outputs() * n]);
            let (share_bar, bars) = (self.bars.moving.get(), &mut *out.moving);
            let (features_bar, grad) = (&mut bars.features[..], &mut bars.network[..]);
            self.mixed.backward(field.simd, part, moving, raw_bar, n, share_bar, features_bar, grad);
        }
        let features_bar = &mut out.features[samples.start..];
        let (packed, acts) = (&field.density_packed, &self.density_acts);
        let (simd, grad) = (field.simd, &mut *out.density);
        field.density.backward(simd, packed, acts, input_bar, n, features_bar, chunk.n, grad, scratch);
    }
}
