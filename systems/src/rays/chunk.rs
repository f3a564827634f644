//! One chunk of a training batch: its rays, the samples they keep, and the way through the networks; the way back is
//! in [`super::learn`].
//!
//! A batch is cut into a fixed number of chunks, whatever the number of threads; a chunk is one task. Within it the
//! samples go through the networks in tiles of whole rays ([`super::tile`]).

use super::context::Placing;
use super::context::StepContext;
use super::head::Head;
use super::head::{PLACE_ROWS, place_features};
use super::marched::{Gradients, Marched};
use super::prepass::{Kept, Prepass};
use super::ray_bars::RayGeometryBars;
use super::scene_flow::FlowChunk;
use super::tile::{StaticRay, TILE, Tile};
use crate::buffers::sized;
use crate::fields::{Features, Field, MovingBars, MovingPoints, Part, Places, When};
use crate::photo_model::{Codes, Pixel};
use crate::samplers::{Draw, Proposed, RaysInSpace};
use crate::space::InternalRay;
use crate::warps::{DeformGrad, DeformScratch};
use engine::data::Batch;
use std::ops::Range;
use std::time::Instant;

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
    /// Intervals that proposals weighed.
    pub(super) proposed: u64,
    /// March or proposals, encoding, networks, the proposals' way back.
    pub(super) seconds: [f64; 4],
}

/// Buffers of a chunk, kept from step to step.
pub(super) struct Chunk {
    pub(super) rays: Vec<InternalRay>,
    /// `[sh + appearance][rays]`: spherical harmonics of the view directions, then the codes of the photos.
    pub(super) basis: Vec<f32>,
    /// `[place + transient][rays]`: where in the photo, then the codes of the photos.
    transient: Vec<f32>,
    pub(super) views: Vec<f32>,
    /// `[rays + 1]`
    pub(super) offsets: Vec<u32>,
    /// Distances of the samples, and their steps.
    pub(super) t: Vec<f32>,
    pub(super) dt: Vec<f32>,
    /// Samples: of each ray those in front of what is opaque.
    pub(super) n: usize,
    /// `[3][n]`, positions in the grid: canonical ones, and those at the rays' own time where something moves.
    pub(super) x: Vec<f32>,
    pub(super) was: Vec<f32>,
    /// `[n]`, views; only where something moves.
    pub(super) which: Vec<u32>,
    /// `[n]`, times; only where the features know them.
    pub(super) times: Vec<f32>,
    pub(super) features: Vec<f32>,
    /// `[rows][n]`: those of the grid, then those of the deformation.
    pub(super) features_bar: Vec<f32>,
    /// Gradient of interpolated features, where these are not what the network sees.
    pub(super) raw_bar: Vec<f32>,
    /// `[3][n]`, gradient of the canonical positions; only where something moves.
    pub(super) x_bar: Vec<f32>,
    pub(super) deform_grad: DeformGrad,
    pub(super) deform: DeformScratch,
    /// Samples at which something moves, and their gradients; only where a part of the field is for these.
    pub(super) moving: MovingPoints,
    pub(super) moving_bars: MovingBars,
    /// What moves in the frames beside; only where a term asks.
    pub(super) flow: FlowChunk,
    pub(super) density_grad: Vec<f32>,
    pub(super) colour_grad: Vec<f32>,
    pub(super) head_grad: Vec<f32>,
    /// `[rays][dims]`, gradients of the rays' codes.
    pub(super) appearance_bar: Vec<f32>,
    pub(super) transient_bar: Vec<f32>,
    /// The chunk's pixels as they were rendered; only where a photo model asks.
    pub(super) seen: Vec<Pixel>,
    pub(super) stats: ChunkStats,
    pub(super) proposed: Proposed,
    /// `[n]`, weights of the samples; only where proposals learn from them, or a loss of the deformation depends on them.
    pub(super) w: Vec<f32>,
    /// Those that such a loss looks at.
    pub(super) judged: Vec<f32>,
    prepass: Prepass,
    tile: Tile,
    /// Gradients of the rays themselves.
    pub(super) ray_bars: RayGeometryBars,
}

/// One tile of a chunk, and where its results go.
pub(super) struct TileWork<'t, 'g> {
    pub(super) tile: &'t mut Tile,
    pub(super) chunk: Marched<'t>,
    pub(super) gradients: &'t mut Gradients<'g>,
    /// `[n]`, weights of the chunk's samples; empty where neither proposals nor losses of the deformation need them.
    pub(super) weights: &'t mut [f32],
    pub(super) seen: &'t mut Vec<Pixel>,
    /// Rays of the tile, counted from the chunk's first.
    pub(super) rays: Range<usize>,
    /// Pixels of the tile, counted from the batch's first.
    pub(super) pixels: Range<usize>,
}

/// Rows of codes for the pixels `pixels` of a batch, `per_pixel` rays each: `out` is `[dims][rays]`.
pub(super) fn fill_codes(codes: Codes<'_>, batch: &Batch, pixels: Range<usize>, per_pixel: usize, out: &mut [f32]) {
    let rays = pixels.len() * per_pixel;
    for (p, i) in pixels.enumerate() {
        for (k, &value) in codes.of(batch.view[i] as usize).iter().enumerate() {
            out[k * rays + p * per_pixel..][..per_pixel].fill(value);
        }
    }
}

impl Chunk {
    pub(super) fn new(field: &Field, head: Option<&Head>) -> Self {
        Self {
            rays: Vec::new(),
            basis: Vec::new(),
            transient: Vec::new(),
            views: Vec::new(),
            offsets: Vec::new(),
            t: Vec::new(),
            dt: Vec::new(),
            n: 0,
            x: Vec::new(),
            was: Vec::new(),
            which: Vec::new(),
            times: Vec::new(),
            features: Vec::new(),
            features_bar: Vec::new(),
            raw_bar: Vec::new(),
            x_bar: Vec::new(),
            deform_grad: DeformGrad::default(),
            deform: DeformScratch::default(),
            moving: MovingPoints::default(),
            moving_bars: MovingBars::default(),
            flow: FlowChunk::default(),
            density_grad: vec![0.0; field.density.packed_grad_len()],
            colour_grad: vec![0.0; field.colour.packed_grad_len()],
            head_grad: vec![0.0; head.map_or(0, |head| head.mlp.packed_grad_len())],
            appearance_bar: Vec::new(),
            transient_bar: Vec::new(),
            seen: Vec::new(),
            stats: ChunkStats::default(),
            proposed: Proposed::default(),
            w: Vec::new(),
            judged: Vec::new(),
            prepass: Prepass::default(),
            tile: Tile::default(),
            ray_bars: RayGeometryBars::default(),
        }
    }

    /// Its samples.
    fn places(&self) -> Places<'_> {
        Places { x: &self.x[..3 * self.n], times: &self.times }
    }

    /// What it brings to the gradient of the features.
    pub(super) fn part(&self, features: &dyn Features) -> Part<'_> {
        let raw_bar = if features.pulls_in_place() { &self.features_bar } else { &self.raw_bar };
        Part { places: self.places(), raw_bar }
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        let floats = [
            &self.t,
            &self.dt,
            &self.x,
            &self.was,
            &self.x_bar,
            &self.features,
            &self.features_bar,
            &self.density_grad,
            &self.colour_grad,
            &self.w,
            &self.judged,
        ];
        let rays = self.rays.capacity() * size_of::<InternalRay>();
        let moving = self.moving.bytes() + self.moving_bars.bytes() + self.flow.bytes();
        let parts = self.prepass.bytes() + self.proposed.bytes() + self.tile.bytes() + self.deform.bytes() + moving;
        4 * floats.iter().map(|b| b.capacity()).sum::<usize>() + rays + parts
    }

    /// Place the samples of the batch's pixels `pixels` and keep those in front of what is opaque.
    pub(super) fn sample(&mut self, ctx: &StepContext<'_>, pixels: Range<usize>) {
        let start = Instant::now();
        self.stats = ChunkStats::default();
        let rays = pixels.start * ctx.per_pixel..pixels.end * ctx.per_pixel;
        let first_pixel = pixels.start;
        self.rays.clear();
        self.rays.extend(ctx.rays[rays.clone()].iter().map(|ray| ctx.space.internal_ray(ray)));
        let dims = ctx.appearance.map_or(0, |codes| codes.dims);
        let codes = ctx.field.basis(&self.rays, dims, &mut self.views, &mut self.basis);
        if let Some(table) = ctx.appearance {
            fill_codes(table, ctx.batch, pixels.clone(), ctx.per_pixel, codes);
        }
        if let Some(table) = ctx.transient {
            let all = sized(&mut self.transient, (PLACE_ROWS + table.dims) * rays.len());
            let (places, codes) = all.split_at_mut(PLACE_ROWS * rays.len());
            fill_codes(table, ctx.batch, pixels.clone(), ctx.per_pixel, codes);
            for (p, i) in pixels.enumerate() {
                for (k, value) in place_features(ctx.batch.place[i]).into_iter().enumerate() {
                    places[k * rays.len() + p * ctx.per_pixel..][..ctx.per_pixel].fill(value);
                }
            }
        }
        match ctx.placing {
            Placing::March(occupancy, marcher) => self.prepass.march(ctx, occupancy, marcher, &self.rays, rays),
            Placing::Proposals(proposals, exponent) => {
                let counts = |r: usize| ctx.batch.weight[(rays.start + r) / ctx.per_pixel] > 0.0;
                let (all, first) = (ctx.rays.len(), rays.start);
                let draw = Draw::Training { jitter: ctx.jitter, rays: all, first, exponent };
                let time_steps = ctx.time_steps;
                let view = |r: usize| ctx.batch.view[(rays.start + r) / ctx.per_pixel] as usize;
                let time = |r: usize| time_steps.times.get(view(r)).copied().unwrap_or(0.0);
                let at = RaysInSpace { simd: ctx.field.simd, space: ctx.space, rays: &self.rays };
                self.proposed.sample(proposals, &at, counts, time, draw);
                self.prepass.take(&self.proposed, self.rays.len());
                self.stats.proposed = self.proposed.interval_count();
            }
        }
        let marched = Instant::now();
        let Self { offsets, t, dt, x, was, which, features, .. } = self;
        let view = |ray: usize| ctx.batch.view[first_pixel + ray / ctx.per_pixel];
        self.n = self.prepass.follow(ctx, &self.rays, view, Kept { offsets, t, dt, x, was, which, features });
        let when = When { time_steps: ctx.time_steps, which: &self.which };
        ctx.field.fill_times(when, &mut self.times);
        if let Some(part) = &ctx.field.moving {
            self.moving.find(part, &self.x[..3 * self.n], when);
        }
        self.stats.dense = self.prepass.dense;
        self.stats.placed = self.prepass.placed();
        self.stats.seconds[0] = (marched - start).as_secs_f64();
        self.stats.seconds[1] = marched.elapsed().as_secs_f64();
    }

    /// Samples that [`Chunk::sample`] evaluated.
    pub(super) fn evaluated(&self) -> u64 {
        self.prepass.evaluated()
    }

    /// Render what [`Chunk::sample`] placed into `seen`, for a photo model that wants to see the batch first.
    pub(super) fn render_ahead(&mut self, ctx: &StepContext<'_>, pixels: Range<usize>) {
        self.render_tiles(ctx, pixels, |_, _| {});
    }

    /// [`Chunk::render_ahead`]; returns where each ray ends, in the grid's unit cube; NaN where it ends nowhere.
    pub(super) fn render_ends(&mut self, ctx: &StepContext<'_>, pixels: Range<usize>) -> Vec<[f32; 3]> {
        let mut ends = Vec::with_capacity(pixels.len() * ctx.per_pixel);
        self.render_tiles(ctx, pixels, |tile, rays| ends.extend((0..rays).map(|r| tile.static_ray(r).middle())));
        let at = |ray: usize, k: usize| [0, 1, 2].map(|a| self.x[a * self.n + self.offsets[ray] as usize + k]);
        ends.iter().enumerate().map(|(ray, k)| k.map_or([f32::NAN; 3], |k| at(ray, k))).collect()
    }

    /// Render into `seen`, and show each tile with the number of its rays.
    fn render_tiles(&mut self, ctx: &StepContext<'_>, pixels: Range<usize>, mut each: impl FnMut(&Tile, usize)) {
        let start = Instant::now();
        self.seen.clear();
        self.each_tile(ctx, pixels, |TileWork { tile, chunk, seen, rays, pixels, .. }| {
            let count = rays.len();
            tile.forward(ctx, chunk, rays, pixels);
            seen.extend(tile.pixels(ctx));
            each(tile, count);
        });
        self.stats.seconds[2] += start.elapsed().as_secs_f64();
    }

    /// Each ray with what the static part holds along it; one ray a pixel.
    pub(super) fn each_ray(
        &mut self,
        ctx: &StepContext<'_>,
        pixels: Range<usize>,
        mut each: impl FnMut(usize, StaticRay<'_>),
    ) {
        self.each_tile(ctx, pixels, |TileWork { tile, chunk, rays, pixels, .. }| {
            tile.forward(ctx, chunk, rays.clone(), pixels.clone());
            for (r, pixel) in pixels.enumerate() {
                each(pixel, tile.static_ray(r));
            }
        });
    }

    /// Cut the chunk into tiles of whole pixels.
    pub(super) fn each_tile(
        &mut self,
        ctx: &StepContext<'_>,
        pixels: Range<usize>,
        mut work: impl FnMut(TileWork<'_, '_>),
    ) {
        let (count, k) = (pixels.len(), ctx.per_pixel);
        let chunk = Marched {
            rays: count * k,
            offsets: &self.offsets,
            t: &self.t,
            dt: &self.dt,
            features: &self.features,
            n: self.n,
            basis: &self.basis,
            transient: &self.transient,
            moving: &self.moving,
        };
        let mut gradients = Gradients {
            features: &mut self.features_bar,
            density: &mut self.density_grad,
            colour: &mut self.colour_grad,
            head: &mut self.head_grad,
            appearance: &mut self.appearance_bar,
            transient: &mut self.transient_bar,
            moving: &mut self.moving_bars,
            directions: &mut self.ray_bars.basis,
        };
        let mut first = 0;
        while first < count {
            let mut last = first + 1;
            while last < count && (self.offsets[(last + 1) * k] - self.offsets[first * k]) as usize <= TILE {
                last += 1;
            }
            work(TileWork {
                tile: &mut self.tile,
                chunk,
                gradients: &mut gradients,
                weights: &mut self.w,
                seen: &mut self.seen,
                rays: first * k..last * k,
                pixels: pixels.start + first..pixels.start + last,
            });
            first = last;
        }
    }
}
