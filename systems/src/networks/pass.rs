//! Pixels through both levels: their samples, networks, quadrature and loss, and all of it backwards.

use super::along::{Along, PlaceBars, placed};
use super::chunk::{Chunk, Context, Inputs, Pass, Sums};
use super::composite::CompositeOp;
use super::composite_two::{CompositeTwoOp, PIXEL};
use super::cones::{TILE, Which, crossing};
use super::head::Head;
use super::network::Seen;
use super::recipe::Recipe;
use super::samples::{Level, Tile, add_codes, spread_codes};
use super::two_level::{TwoLevel, recorded};
use super::when::SampleTimes;
use crate::photo_model::{Codes, Pixel};
use crate::space::InternalRay;
use engine::data::Dataset;
use field_core::rng::Rng;
use field_core::tape::{Tape, TapeError};
use float_core::Simd;
use losses::sparsity;
use std::ops::Range;

/// Stream of the times beside those of views, behind those of rays.
const BESIDE: u64 = 0x6265_7369_6465;

/// The rays of a tile in their batch.
struct Places<'a> {
    rays: &'a [InternalRay],
    /// Place of each ray in the batch.
    ids: &'a [usize],
    /// Place of the chunk's first pixel.
    first: usize,
    /// Randomness of the tile; `None`: evenly spaced, and no noise.
    rng: Option<Rng>,
}

/// What a level renders of a tile.
struct Values<'a> {
    /// 0: coarse, 1: fine.
    level: usize,
    /// Factor of the level's loss.
    factor: f32,
    /// Colours `[rays][3]`, or all six numbers of [`CompositeTwoOp`].
    values: &'a [f32],
}

/// What the pixels of a tile cost at a level, and the gradient `bar` of that with respect to the values. `seen` are the pixels of
/// the chunk.
fn judge<P>(
    ctx: &Context<'_, P>,
    places: &Places<'_>,
    rendered: &Values<'_>,
    seen: &mut [Pixel],
    sums: &mut Sums,
    bar: &mut Vec<f32>,
) {
    let &Values { level, factor, values } = rendered;
    let count = places.ids.len();
    let two = values.len() == PIXEL * count;
    bar.clear();
    bar.resize(values.len(), 0.0);
    for (r, &i) in places.ids.iter().enumerate() {
        let (weight, truth) = (ctx.inputs.batch.weight[i], ctx.inputs.truth[i]);
        let rgb = [0, 1, 2].map(|c| values[3 * r + c]);
        let error = [0, 1, 2].map(|c| rgb[c] - truth[c]);
        if level == 1 {
            for e in error {
                sums.fine_error += f64::from(weight * e * e) / 3.0;
                sums.weight += f64::from(weight) / 3.0;
            }
        }
        let Some(photo_model) = ctx.photo_model else {
            for (c, e) in error.into_iter().enumerate() {
                sums.loss += f64::from(factor * weight * e * e) / 3.0;
                bar[3 * r + c] = factor * weight * 2.0 * e * ctx.share / 3.0;
            }
            continue;
        };
        let scale = factor * weight * ctx.share;
        let (loss, rgb_bar) = if level == 0 {
            photo_model.coarse_loss(i, rgb, truth)
        } else {
            let mut pixel = Pixel { rgb, ..Pixel::default() };
            if two {
                [pixel.beta, pixel.transient, pixel.sigma_t] = [3, 4, 5].map(|block| values[block * count + r]);
            }
            seen[i - places.first] = pixel;
            if ctx.pass == Pass::Render {
                continue;
            }
            let (loss, pixel_bar) = photo_model.loss(i, &pixel, truth);
            if two {
                bar[3 * count + r] = scale * pixel_bar.beta;
                bar[5 * count + r] = scale * pixel_bar.sigma_t;
            }
            (loss, pixel_bar.rgb)
        };
        sums.loss += f64::from(factor * weight * loss);
        for (c, rgb_bar) in rgb_bar.into_iter().enumerate() {
            bar[3 * r + c] = scale * rgb_bar;
        }
    }
}

impl Level {
    /// Noise of the raw densities of level number `level`: 0 where nothing is random.
    fn draw_noise(&mut self, rng: Option<Rng>, level: usize, deviation: f32) {
        self.noise.clear();
        self.noise.resize(self.t.len(), 0.0);
        if let (Some(rng), true) = (rng, deviation > 0.0) {
            for (i, v) in self.noise.iter_mut().enumerate() {
                *v = deviation * rng.normal_at((1 << 32) + (level << 24) as u64 + i as u64);
            }
        }
    }
}

impl<R: Recipe> TwoLevel<R> {
    /// The pixels `ids` of a batch.
    pub(super) fn run(&self, ctx: &Context<'_, R::Position>, data: &Dataset, ids: Range<usize>, chunk: &mut Chunk) {
        // A photo model may need the renders of pixels that do not count, between their neighbours.
        let all = ctx.photo_model.is_some() && ctx.pass == Pass::Render;
        let which = if all { Which::All } else { Which::Counted };
        let (rays, hit) = crossing(&self.space, data, &ctx.inputs.batch, ids.clone(), R::FOOTPRINT, which);
        self.run_rays(ctx, ids, &rays, &hit, chunk);
    }

    /// The pixels `ids` of a batch; `hit` are those whose `rays` cross the space.
    pub(super) fn run_rays(
        &self,
        ctx: &Context<'_, R::Position>,
        ids: Range<usize>,
        rays: &[InternalRay],
        hit: &[usize],
        chunk: &mut Chunk,
    ) {
        chunk.ray_bars.begin(if ctx.by_ray { ids.len() } else { 0 });
        chunk.sums = Sums { missed: (ids.len() - hit.len()) as u64, ..Sums::default() };
        if ctx.pass == Pass::Learn {
            chunk.grad.clear();
            chunk.grad.resize(self.trained.params.len(), 0.0);
        }
        chunk.seen.clear();
        if ctx.photo_model.is_some() {
            let nothing = |&rgb| Pixel { rgb, ..Pixel::default() };
            chunk.seen.extend(ctx.inputs.background[ids.clone()].iter().map(nothing));
        }
        for (bar, codes) in [(&mut chunk.appearance_bar, ctx.appearance), (&mut chunk.transient_bar, ctx.transient)] {
            bar.clear();
            bar.resize(codes.map_or(0, |codes| codes.dims * ids.len()), 0.0);
        }
        for (rays, hit) in rays.chunks(TILE).zip(hit.chunks(TILE)) {
            // Rays are distinguished by their place in the batch, whatever tile they are in.
            let rng = ctx.random.map(|rng| rng.substream(hit[0] as u64));
            recorded(self.tile(ctx, &Places { rays, ids: hit, first: ids.start, rng }, chunk));
        }
    }

    /// One tile of rays, forward and, to learn, backward.
    fn tile(&self, ctx: &Context<'_, R::Position>, places: &Places<'_>, chunk: &mut Chunk) -> Result<(), TapeError> {
        let (Inputs { background, .. }, rays) = (ctx.inputs, places.rays);
        chunk.tile.background.clear();
        chunk.tile.background.extend(places.ids.iter().flat_map(|&i| background[i]));
        self.config.fill_coarse(&self.space, rays, places.rng.as_ref(), &mut chunk.tile);
        let raw = self.level(ctx, 0, places, chunk)?;
        chunk.tile.weigh(raw.iter().map(|&raw| self.config.density_of(raw)), rays.len());
        self.config.fill_fine(&self.space, rays, places.rng.as_ref(), &mut chunk.tile);
        self.level(ctx, 1, places, chunk)?;
        Ok(())
    }

    /// Times of the rays of a tile: those of their views.
    fn times_of(&self, ctx: &Context<'_, R::Position>, ids: &[usize]) -> impl Iterator<Item = f32> {
        let (times, views) = (self.config.view_times(), &ctx.inputs.batch.view);
        ids.iter().map(move |&i| times[views[i] as usize])
    }

    /// Times beside those of a tile's rays, where displacements are held to vary little between them. Returns whether they are.
    fn spread_beside(
        &self,
        ctx: &Context<'_, R::Position>,
        places: &Places<'_>,
        offsets: &[u32],
        beside: &mut SampleTimes,
    ) -> bool {
        let Some(rng) = places.rng.filter(|_| ctx.pass == Pass::Learn && self.config.variation() > 0.0) else {
            return false;
        };
        let (rng, views) = (rng.substream(BESIDE), &ctx.inputs.batch.view);
        let times = places.ids.iter().enumerate().map(|(r, &i)| {
            let [u, v, ..] = rng.uniform4_at(r as u64);
            self.config.time_beside(views[i] as usize, [u, v])
        });
        beside.spread(times, offsets);
        true
    }

    /// A level of a tile whose samples are placed: 0 is the coarse one, 1 the fine one. Returns the raw densities.
    fn level(
        &self,
        ctx: &Context<'_, R::Position>,
        level: usize,
        places: &Places<'_>,
        chunk: &mut Chunk,
    ) -> Result<Vec<f32>, TapeError> {
        let Places { rays, ids, first, rng } = *places;
        let views = &ctx.inputs.batch.view;
        let ops = &ctx.ops.levels[level];
        let Tile { coarse, fine, background, bar, appearance, transient, times, beside, .. } = &mut chunk.tile;
        let samples = if level == 0 { coarse } else { fine };
        samples.draw_noise(rng, level, self.config.density_noise());
        let Level { arena, offsets, t, dt, x, d, noise, .. } = samples;
        let (n, offsets, dt, simd) = (dt.len(), &offsets[..], &dt[..], Simd::best());
        let codes = |codes: Option<Codes<'_>>, rows: &mut Vec<f32>| {
            let codes = codes?;
            spread_codes(ids.iter().map(|&i| codes.of(views[i] as usize)), codes.dims, offsets, rows);
            Some(codes.dims)
        };
        let appearance_dims = codes(ctx.appearance, appearance);
        let head = self.head.as_ref().filter(|_| level == 1);
        let transient_dims = head.and_then(|_| codes(ctx.transient, transient));
        let moves = ops.displacement().is_some() && times.spread(self.times_of(ctx, ids), offsets);
        chunk.sums.still += if ops.displacement().is_some() && !moves { n as u64 } else { 0 };
        let varies = moves && level == 1 && self.spread_beside(ctx, places, offsets, beside);

        let one = CompositeOp { simd, offsets, dt, background };
        let two = head.map(|head| CompositeTwoOp { simd, mixture: head.mixture, offsets, dt, background });
        let mut tape = Tape::new(arena, self.network(level));
        let seen = Seen {
            x: placed(&mut tape, ctx.by_ray, x.len() / n.max(1), n, x)?,
            d: placed(&mut tape, ctx.by_ray, 3, n, d)?,
            when: if moves { Some(times.record(&mut tape)?) } else { None },
            code: appearance_dims.map(|dims| tape.input(dims, n, appearance)).transpose()?,
        };
        let out = ops.record(&mut tape, seen)?;
        let noise = tape.constant(1, n, noise)?;
        let noisy = tape.add(out.raw_density, noise)?;
        let raw = tape.value(noisy)?.data.to_vec();
        chunk.sums.samples += n as u64;
        if level == 0 && ctx.pass == Pass::Render {
            return Ok(raw);
        }
        let sigma = self.config.density(&mut tape, noisy)?;
        let mut transient_code = None;
        let pixels = match (&ctx.ops.head, &two, transient_dims) {
            (Some(op), Some(two), Some(dims)) => {
                let code = tape.input(dims, n, transient)?;
                let part = Head::record(op, &mut tape, out.trunk, code)?;
                transient_code = Some(code);
                tape.custom(two, &[sigma, out.rgb, part.sigma, part.rgb, part.beta])?
            }
            _ => tape.custom(&one, &[sigma, out.rgb])?,
        };

        let rendered = Values { level, factor: self.config.level_weight(level), values: tape.value(pixels)?.data };
        judge(ctx, places, &rendered, &mut chunk.seen, &mut chunk.sums, bar);
        if ctx.pass == Pass::Render {
            return Ok(raw);
        }
        let prior = if level == 0 { self.config.sparsity() } else { 0.0 };
        let mut sigma_bar = Vec::new();
        if prior > 0.0 {
            // The mean over the samples of each ray, as the mean over rays is taken outside.
            let sigmas = tape.value(sigma)?.data;
            let factor = f64::from(prior) * ids.len() as f64;
            chunk.sums.loss += factor * sparsity::density(sigmas);
            sigma_bar.resize(n, 0.0);
            sparsity::density_backward(sigmas, factor * f64::from(ctx.share), &mut sigma_bar).expect("as many");
        }
        let mut varied_bar = Vec::new();
        let mut seeds = vec![(pixels, &bar[..])];
        if !sigma_bar.is_empty() {
            seeds.push((sigma, &sigma_bar));
        }
        if let (true, Some(displacement), Some(displaced)) = (varies, ops.displacement(), out.displaced) {
            let other = beside.record(&mut tape)?;
            let varied = displacement.variation(&mut tape, displaced, other)?;
            let factor = self.config.variation();
            let sum: f64 = tape.value(varied)?.data.iter().map(|&v| f64::from(v)).sum();
            chunk.sums.loss += f64::from(factor) * sum;
            varied_bar.resize(n, factor * ctx.share);
            seeds.push((varied, &varied_bar));
        }
        tape.backward(&seeds, &mut chunk.grad[self.range(level)])?;
        let places = || ids.iter().map(|i| i - first);
        if ctx.by_ray {
            let bars = PlaceBars { x: tape.gradient(seen.x)?, d: tape.gradient(seen.d)? };
            chunk.ray_bars.add(&self.config, &self.space, &Along { rays, offsets, t, dt }, &bars, places());
        }
        if let Some(code) = seen.code {
            add_codes(tape.gradient(code)?, offsets, places(), &mut chunk.appearance_bar);
        }
        if let Some(code) = transient_code {
            add_codes(tape.gradient(code)?, offsets, places(), &mut chunk.transient_bar);
        }
        Ok(raw)
    }
}
