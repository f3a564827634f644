//! What a term reads of a tile of rays, and the gradients that it adds.

use std::ops::Range;

/// Whole rays of a batch, rendered: the static part alone.
#[derive(Clone, Copy)]
pub(crate) struct TileRays<'a> {
    /// `[rays + 1]`, first sample of each ray.
    pub(crate) offsets: &'a [u32],
    /// `[n]`, where the samples are and how long their intervals are, internal units.
    pub(crate) t: &'a [f32],
    pub(crate) dt: &'a [f32],
    /// Part of an interval that lies in front of its sample.
    pub(crate) lead: f32,
    /// `[n]`, optical depths and weights of the samples.
    pub(crate) tau: &'a [f32],
    pub(crate) w: &'a [f32],
    /// `[3][n]`, colours of the samples.
    pub(crate) rgb: &'a [f32],
    /// `[rays]`, transmittance behind the last sample.
    pub(crate) trans_end: &'a [f32],
    /// `[n]`, the share of the samples' matter that moves; empty where no part of the field is for that.
    pub(crate) moving: &'a [f32],
    /// Rays of a pixel: those of one pixel follow each other.
    pub(crate) per_pixel: usize,
    /// Of each pixel: the factor of its loss, its colour, its view and its column and row there.
    pub(crate) weight: &'a [f32],
    pub(crate) truth: &'a [[f32; 3]],
    pub(crate) view: &'a [u32],
    pub(crate) place: &'a [[u16; 2]],
    /// One over the pixels of the batch that count.
    pub(crate) share: f32,
}

impl TileRays<'_> {
    /// Samples of ray `r`.
    pub(crate) fn span(&self, r: usize) -> Range<usize> {
        self.offsets[r] as usize..self.offsets[r + 1] as usize
    }

    /// Number of rays.
    pub(crate) fn rays(&self) -> usize {
        self.trans_end.len()
    }

    /// One over the rays of a pixel.
    pub(crate) fn per_ray(&self) -> f32 {
        1.0 / self.per_pixel as f32
    }
}

/// A gradient that terms add to: all zero until the first of them asks for it.
#[derive(Default)]
pub(crate) struct Bar {
    buffer: Vec<f32>,
    len: usize,
    used: bool,
}

impl Bar {
    fn begin(&mut self, len: usize) {
        (self.len, self.used) = (len, false);
    }

    /// The gradient, to be added to.
    pub(crate) fn add(&mut self) -> &mut [f32] {
        if !self.used {
            self.used = true;
            self.buffer.clear();
            self.buffer.resize(self.len, 0.0);
        }
        &mut self.buffer
    }

    /// The gradient; `None` where no term has one.
    pub(crate) fn get(&self) -> Option<&[f32]> {
        self.used.then_some(&self.buffer[..])
    }

    fn bytes(&self) -> usize {
        4 * self.buffer.capacity()
    }
}

/// Gradients of the terms with respect to what they read of a tile.
#[derive(Default)]
pub(crate) struct RayBars {
    /// `[n]`, of the weights.
    pub(crate) w: Bar,
    /// `[rays]`, of the transmittances behind the last samples.
    pub(crate) trans_end: Bar,
    /// `[3][n]`, of the colours of the samples.
    pub(crate) rgb: Bar,
    /// `[n]`, of the densities `tau / dt`.
    pub(crate) sigma: Bar,
    /// `[n]`, of the shares that move.
    pub(crate) moving: Bar,
    /// Room for what a term computes on its way.
    pub(super) room: [Vec<f32>; 2],
}

impl RayBars {
    /// No gradient yet, for `rays` rays of `n` samples.
    pub(crate) fn begin(&mut self, rays: usize, n: usize) {
        self.w.begin(n);
        self.trans_end.begin(rays);
        self.rgb.begin(3 * n);
        self.sigma.begin(n);
        self.moving.begin(n);
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        let room: usize = self.room.iter().map(|room| 4 * room.capacity()).sum();
        self.w.bytes() + self.trans_end.bytes() + self.rgb.bytes() + self.sigma.bytes() + self.moving.bytes() + room
    }
}

/// A term of the loss over rays.
pub(crate) trait RayTerm: Send + Sync {
    /// Add what the rays cost to `loss`, summed over rays, and [`TileRays::share`] times its derivatives to `bars`.
    fn add(&self, rays: &TileRays<'_>, bars: &mut RayBars, loss: &mut f64);
}
