//! The rays of a chunk that take part: some of those along which something may move.

use super::film::{Film, Frames};
use crate::fields::MovingPoints;
use crate::space::Space;
use engine::data::Batch;
use render_core::ray::Ray;
use render_core::space_map::SpaceMap;
use std::ops::Range;

/// What a chunk's main pass left of all its samples.
#[derive(Default)]
pub(crate) struct KeptSamples {
    /// `[n]`, optical depths as rendered, and of the still part alone.
    pub(crate) tau: Vec<f32>,
    pub(crate) still: Vec<f32>,
    /// `[3][n]`, colours as rendered.
    pub(crate) rgb: Vec<f32>,
}

impl KeptSamples {
    /// Room for `n` samples.
    pub(crate) fn begin(&mut self, n: usize) {
        for (buffer, len) in [(&mut self.tau, n), (&mut self.still, n), (&mut self.rgb, 3 * n)] {
            buffer.clear();
            buffer.resize(len, 0.0);
        }
    }
}

/// The samples of a chunk.
#[derive(Clone, Copy)]
pub(crate) struct ChunkSamples<'a> {
    /// `[rays + 1]`
    pub(crate) offsets: &'a [u32],
    /// `[n]`
    pub(crate) t: &'a [f32],
    pub(crate) dt: &'a [f32],
    /// `[3][n]`, in the unit cube.
    pub(crate) x: &'a [f32],
    pub(crate) moving: &'a MovingPoints,
    pub(crate) kept: &'a KeptSamples,
}

/// The rays of a batch.
#[derive(Clone, Copy)]
pub(super) struct BatchRays<'a> {
    pub(super) batch: &'a Batch,
    /// Rays of a pixel.
    pub(super) per_pixel: usize,
    /// `[pixels * per_pixel]`
    pub(super) rays: &'a [Ray],
    pub(super) truth: &'a [[f32; 3]],
    pub(super) background: &'a [[f32; 3]],
    pub(super) space: &'a Space,
    pub(super) film: &'a Film,
    /// Share of the pixels that take part.
    pub(super) share: f32,
    /// Which way two frames are looked at.
    pub(super) chained: Option<usize>,
}

/// Rays that take part: `n` samples, `m` of which may move.
#[derive(Default)]
pub(crate) struct Chosen {
    /// Which rays of the chunk they are.
    pub(crate) rays: Vec<u32>,
    /// `[rays + 1]`, all samples of each, and those that may move.
    pub(crate) offsets: Vec<u32>,
    pub(crate) moving: Vec<u32>,
    /// `[m]`, which of all samples they are.
    pub(crate) at: Vec<u32>,
    /// `[3][n]`, where samples are, in the unit cube.
    pub(crate) x: Vec<f32>,
    /// `[n]`, lengths of intervals.
    pub(crate) dt: Vec<f32>,
    /// `[n]` and `[3][n]`: what was rendered; the still part where nothing may move.
    pub(crate) tau: Vec<f32>,
    pub(crate) rgb: Vec<f32>,
    /// `[n]`, optical depths of the still part alone.
    pub(crate) still: Vec<f32>,
    /// `[n]`, disparities, in units of one over half the side of space (NDC: over the near plane).
    pub(crate) disparity: Vec<f32>,
    /// `[rays]`: frames of each ray and beside it, its pixel and the place in it that the ray goes through, its colour, what is behind it,
    /// and the factor of its cost.
    pub(crate) frames: Vec<Frames>,
    pub(crate) place: Vec<[u16; 2]>,
    pub(crate) pixel: Vec<[f32; 2]>,
    pub(crate) truth: Vec<[f32; 3]>,
    pub(crate) background: Vec<f32>,
    pub(crate) factor: Vec<f32>,
}

/// Whether pixel `i` of a batch is of the share that takes part.
fn takes_part(i: usize, share: f32) -> bool {
    let before = |i: usize| (i as f64 * f64::from(share)).floor();
    before(i + 1) > before(i)
}

/// The unit of disparities: half the side of space, in NDC its near plane; world units.
pub(super) fn unit(map: &SpaceMap) -> f64 {
    match map {
        SpaceMap::Box { radius, .. } | SpaceMap::Contracted { radius, .. } => *radius,
        SpaceMap::Ndc { ndc, .. } => ndc.near,
        _ => 1.0,
    }
}

impl Chosen {
    fn clear(&mut self) {
        for ends in [&mut self.offsets, &mut self.moving] {
            ends.clear();
            ends.push(0);
        }
        self.rays.clear();
        self.at.clear();
        for buffer in [&mut self.x, &mut self.dt, &mut self.tau, &mut self.rgb, &mut self.still, &mut self.disparity] {
            buffer.clear();
        }
        self.frames.clear();
        self.place.clear();
        self.pixel.clear();
        self.truth.clear();
        self.background.clear();
        self.factor.clear();
    }

    /// Choose among the rays of the batch's pixels `pixels`, which are a chunk's.
    pub(super) fn choose(&mut self, of: BatchRays<'_>, chunk: ChunkSamples<'_>, pixels: Range<usize>) {
        self.clear();
        let BatchRays { batch, per_pixel, film, share, .. } = of;
        let all = chunk.offsets.last().map_or(0, |&n| n as usize);
        let of_unit = unit(&of.space.map());
        let mut from = Vec::new();
        let columns = &chunk.moving.columns;
        for (r, ends) in chunk.offsets.windows(2).enumerate() {
            let i = pixels.start + r / per_pixel;
            let [first, last] = [ends[0], ends[1]].map(|end| columns.partition_point(|&column| column < end));
            if first == last || batch.weight[i] <= 0.0 || !takes_part(i, share) {
                continue;
            }
            let begins = from.len() as u32;
            self.at.extend(columns[first..last].iter().map(|column| begins + column - ends[0]));
            from.extend(ends[0] as usize..ends[1] as usize);
            self.rays.push(r as u32);
            self.offsets.push(from.len() as u32);
            self.moving.push(self.at.len() as u32);
            let view = batch.view[i];
            let ray = &of.rays[pixels.start * per_pixel + r];
            let t = &chunk.t[ends[0] as usize..ends[1] as usize];
            self.disparity.extend(t.iter().map(|&t| (of_unit * disparity(&of, view, ray, t)) as f32));
            let place = batch.pixel[i];
            self.frames.push(film.frames(view, of.chained));
            self.place.push(place);
            self.pixel.push(film.pixel_of(view, ray, place));
            self.truth.push(of.truth[i]);
            self.background.extend(of.background[i]);
            self.factor.push(batch.weight[i] / (per_pixel as f32 * share));
        }
        let (kept, rows) = (chunk.kept, [0, 1, 2]);
        for row in rows {
            self.x.extend(from.iter().map(|&i| chunk.x[row * all + i]));
            self.rgb.extend(from.iter().map(|&i| kept.rgb[row * all + i]));
        }
        self.dt.extend(from.iter().map(|&i| chunk.dt[i]));
        self.tau.extend(from.iter().map(|&i| kept.tau[i]));
        self.still.extend(from.iter().map(|&i| kept.still[i]));
    }

    /// Number of rays.
    pub(crate) fn len(&self) -> usize {
        self.rays.len()
    }

    /// Samples, and those that may move.
    pub(crate) fn samples(&self) -> [usize; 2] {
        [self.dt.len(), self.at.len()]
    }

    /// Rows `[rows][n]` of all samples, of those that may move: `[rows][m]`, written.
    pub(crate) fn gather(&self, from: &[f32], out: &mut Vec<f32>) {
        out.clear();
        for row in from.chunks_exact(self.dt.len().max(1)) {
            out.extend(self.at.iter().map(|&i| row[i as usize]));
        }
    }

    /// The other direction.
    pub(crate) fn scatter(&self, from: &[f32], out: &mut [f32]) {
        let [n, m] = self.samples();
        for (row, out) in from.chunks_exact(m.max(1)).zip(out.chunks_exact_mut(n.max(1))) {
            row.iter().zip(&self.at).for_each(|(value, &i)| out[i as usize] = *value);
        }
    }

    /// Moving samples of ray `r`.
    pub(crate) fn movers(&self, r: usize) -> Range<usize> {
        self.moving[r] as usize..self.moving[r + 1] as usize
    }

    /// All samples of ray `r`.
    pub(crate) fn span(&self, r: usize) -> Range<usize> {
        self.offsets[r] as usize..self.offsets[r + 1] as usize
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        let floats = [&self.x, &self.dt, &self.tau, &self.rgb, &self.still, &self.disparity];
        4 * (floats.iter().map(|b| b.capacity()).sum::<usize>() + self.at.capacity())
    }
}

/// One over the z depth of a sample before the camera of its photo; 0 at infinity.
fn disparity(of: &BatchRays<'_>, view: u32, ray: &Ray, t: f32) -> f64 {
    /// World units: nothing is nearer.
    const NEAREST: f64 = 1e-6;
    let z = of.space.world_distance(ray, t) * of.film.cosine(view, ray);
    if z.is_finite() { 1.0 / z.max(NEAREST) } else { 0.0 }
}
