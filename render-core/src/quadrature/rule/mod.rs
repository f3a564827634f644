//! What is assumed between samples: from densities and values at points to optical depths and values of intervals.
//!
//! [`composite`](super::composite) asks for one optical depth and one value an interval. [`intervals`] makes them from
//! samples at points `t[i]`, each with the interval `[t[i], t[i + 1]]` of length `dt[i]` behind it:
//!
//! | [`Rule`] | `tau[i]` | value of the interval | error on a smooth density |
//! | --- | --- | --- | --- |
//! | `PiecewiseConstant` | `sigma[i] dt[i]` | `v[i]` | `O(h)`; `O(h^2)` if the samples are mid-points of their intervals |
//! | `Trapezoid` | `(sigma[i] + sigma[i + 1]) dt[i] / 2` | `(v[i] + v[i + 1]) / 2` | `O(h^2)` |
//! | `PiecewiseLinear` | the same | `v[i] + mu (v[i + 1] - v[i])` | `O(h^2)`, and exact where density and value are linear |
//!
//! Under density linear on each interval the trapezoid's optical depth is exact: the transmittance inside is
//! `exp(-quadratic)` and the weight `T[i] - T[i + 1]` is that of the compositing. What differs is where in the interval the
//! light comes from: with values linear as well, `int(T sigma v) = w[i] (v[i] + mu[i] (v[i + 1] - v[i]))` with `mu` the mean
//! position of absorption, 1/2 for a thin even interval, near 0 for a dense one. That is all that compositing needs to know, so
//! the rules come before [`composite`](super::composite) and [`intervals_backward`] after
//! [`composite_backward`](super::composite_backward), and there is one compositing kernel for all.
//!
//! The last sample of a ray has no neighbour: its interval, to the far end, is constant under every rule.
//!
//! ```
//! use float_core::Simd;
//! use render_core::quadrature::{Composite, LastInterval, Points, Rule, Samples, Values, composite, intervals};
//!
//! // One ray with samples at 0, 1, 2 and the far end at 2; density and value rise and fall between them.
//! let (offsets, dt, sigma, value) = ([0, 3], [1.0, 1.0, 0.0], [0.0, 2.0, 1.0], [0.0, 1.0, 0.5]);
//! let points = Points {
//!     offsets: &offsets,
//!     dt: &dt,
//!     sigma: &sigma,
//!     values: Values { data: &value, stride: 3, channels: 1 },
//! };
//! let (mut tau, mut data) = ([0.0; 3], [0.0; 3]);
//! intervals(Simd::best(), Rule::PiecewiseLinear, points, &mut tau, &mut data);
//! assert_eq!(tau, [1.0, 1.5, 0.0]);
//!
//! let samples = Samples { offsets: &offsets, tau: &tau, last: LastInterval::Finite };
//! let values = Values { data: &data, stride: 3, channels: 1 };
//! let (mut pixel, mut opacity, mut w, mut end) = ([0.0], [0.0], [0.0; 3], [0.0]);
//! let out = Composite { colour: &mut pixel, opacity: &mut opacity, w: &mut w, trans_end: &mut end };
//! composite(Simd::best(), samples, values, &[0.0], out);
//! assert!((end[0] - (-2.5_f32).exp()).abs() < 1e-7);
//! assert!((pixel[0] - 0.617_81).abs() < 1e-5);
//! ```
//!
//! # Numerics
//! `mu` is within `1e-6` of the truth for every pair of densities, its gradients within `1e-5 / max(tau, 1)`; optical depths are
//! rounded twice. Optical densities above `1e30` count as `1e30` in `mu`; an infinite density on an interval without length
//! counts as empty. Where both densities of an interval are 0 (`tau < 1e-30`), `mu` is 1/2 and its gradient is taken as 0: it has
//! no limit there. All of it is lane by lane: a sample's result does not depend on its place in the batch.
//!
//! # Source
//! Williams and Max, "A volume density optical model", 1992 (linear density on an interval, in closed form); Uy et al.,
//! "NeRF Revisited: Fixing Quadrature Instability in Volume Rendering", 2023, section 4 (the same for radiance fields).

mod backward;
pub(super) mod centroid;
mod forward;

pub use backward::{IntervalsBar, PointsBar, intervals_backward};
pub use forward::intervals;

use super::{Values, check_offsets};

/// What density and values do between samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Rule {
    /// Each interval has the density and the value of its own sample.
    #[default]
    PiecewiseConstant,
    /// Each interval has the mean density and the mean value of the samples at its ends.
    Trapezoid,
    /// Density and value are linear on each interval.
    PiecewiseLinear,
}

impl Rule {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::PiecewiseConstant, Self::Trapezoid, Self::PiecewiseLinear];
}

/// A batch of rays, seen at points.
#[derive(Clone, Copy, Debug)]
pub struct Points<'a> {
    /// `[rays + 1]`, non-decreasing: ray `r` owns the samples `offsets[r] .. offsets[r + 1]`, front to back.
    pub offsets: &'a [u32],
    /// `[n]` distance from each sample to the next, from the last one of a ray to its far end; world units, `>= 0`. Or the
    /// lengths of bins with a sample in each, under [`Rule::PiecewiseConstant`].
    pub dt: &'a [f32],
    /// `[n]` density at each sample, 1 / world unit, `>= 0`; `inf` is opaque.
    pub sigma: &'a [f32],
    /// Values at each sample.
    pub values: Values<'a>,
}

impl Points<'_> {
    fn check(&self) {
        check_offsets(self.offsets, self.sigma.len());
        assert_eq!(self.dt.len(), self.sigma.len(), "dt and sigma differ in length");
        self.values.check(self.sigma.len());
    }

    /// The samples that belong to a ray: they lie together.
    fn span(&self) -> core::ops::Range<usize> {
        match (self.offsets.first(), self.offsets.last()) {
            (Some(&first), Some(&last)) => first as usize..last as usize,
            _ => 0..0,
        }
    }
}

/// Samples are worked on in pieces of this many, held on the stack.
const PIECE: usize = 64;

/// One number for each sample of a piece.
type Piece = [f32; PIECE];

/// A piece of a batch, and where rays end in it.
struct Walk<'a> {
    /// From the end of the ray that the piece begins in.
    ends: &'a [u32],
    start: usize,
    len: usize,
}

impl<'a> Walk<'a> {
    /// The piece of `span` that begins at `start`.
    #[inline(always)]
    fn at(offsets: &'a [u32], span: &core::ops::Range<usize>, start: usize) -> Self {
        let ends = &offsets[offsets.partition_point(|&end| end as usize <= start)..];
        Self { ends, start, len: PIECE.min(span.end - start) }
    }

    /// The places in the piece that hold the last sample of a ray.
    #[inline(always)]
    fn lasts(&self) -> impl Iterator<Item = usize> {
        let (start, end) = (self.start, self.start + self.len);
        // Rays without samples name the last one of the ray before them again, which does no harm.
        self.ends.iter().map(|&e| e as usize).take_while(move |&e| e <= end).map(move |e| e - 1 - start)
    }

    /// The numbers of the piece.
    #[inline(always)]
    fn own(&self, x: &[f32], out: &mut Piece) {
        out[..self.len].copy_from_slice(&x[self.start..][..self.len]);
    }

    /// The number of each sample's neighbour behind it, its own at the end of a ray.
    #[inline(always)]
    fn next(&self, x: &[f32], out: &mut Piece) {
        let behind = &x[self.start + 1..];
        let n = self.len.min(behind.len());
        out[..n].copy_from_slice(&behind[..n]);
        for k in self.lasts() {
            out[k] = x[self.start + k];
        }
    }
}
