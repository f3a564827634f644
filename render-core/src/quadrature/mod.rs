//! The volume rendering quadrature over a batch of rays, forward and backward, in optical depth.
//!
//! Each interval has one optical depth and one value. Under constant density `tau[i] = sigma[i] * dt[i]`; [`rule`] makes them from
//! other assumptions. With `T[i] = exp(-sum(tau[j], j < i))`,
//!
//! ```text
//! w[i] = T[i] * (1 - exp(-tau[i]))          C = sum(w[i] * c[i]) + T_end * background
//! ```
//!
//! so that `sum(w) + T_end = 1`. Everything here works on a **batch**: ray `r` owns the samples
//! `offsets[r] .. offsets[r + 1]`, front to back; rays without samples are legal and show the background.
//!
//! [`Compositor`] does the usual case with its buffers inside. Below it are plain functions on slices:
//!
//! | function | out of | into |
//! | --- | --- | --- |
//! | [`intervals`], [`intervals_backward`] | densities and values at points, a [`Rule`] | optical depths and values of intervals |
//! | [`weights`], [`weights_backward`] | optical depths | weights and what reaches the background |
//! | [`composite`], [`composite_backward`] | optical depths, values of any number of channels | pixels |
//! | [`accumulate`], [`normalise`] | weights, values | sums such as normals |
//! | [`depth_expected`], [`depth_median`], [`depth_median_exact`] | weights or optical depths, distances | depths |
//! | [`opacity`] | weights | accumulated opacity |
//! | [`two::composite_two`], [`two::composite_two_backward`] | optical depths and values of a static and a transient part | pixels |
//! | [`blend::composite_blend`], [`blend::composite_blend_backward`] | optical depths and values of a static and a dynamic part, the share of the latter | pixels |
//!
//! # Numerics
//! The optical depth is summed in `f64` and rounded once for each sample, so the transmittance of optical depth `c` is
//! off by about `c * 2^-24` however many samples there are; from depth 87 on it is exactly 0. `1 - exp(-tau)` is an
//! `exp_m1`: thin intervals keep their digits. Nothing divides by an opacity. Every result depends on its own ray only,
//! never on its place in the batch: cutting a batch differently gives the same bits at the same [`Simd`] level.
//!
//! Values are not scanned: call [`check_finite`] and [`check_density`] at the boundary.
//!
//! [`reference`](mod@reference) holds the same in `f64`, one ray at a time, slow and obvious.
//!
//! # Source
//! Max, "Optical models for direct volume rendering", 1995; Mildenhall et al., "NeRF", 2020, eq. 3.

mod backward;
pub mod blend;
mod check;
mod compositor;
mod depth;
mod forward;
mod lanes;
pub mod reference;
pub mod rule;
pub mod two;

pub use backward::{CompositeBar, CompositeGrads, WeightsBar, composite_backward, weights_backward};
pub use check::{BadValue, check_density, check_finite};
pub use compositor::{Compositor, Pixels, PixelsBar, RaySamples, SampleGrads};
pub use depth::{
    DepthBar, MIN_OPACITY, depth_expected, depth_expected_backward, depth_median, depth_median_exact, depth_raw,
    disparity, normalise, opacity,
};
pub use forward::{Composite, accumulate, composite, weights};
pub use rule::{IntervalsBar, Points, PointsBar, Rule, intervals, intervals_backward};

use core::ops::Range;
#[cfg(doc)]
use float_core::Simd;
use float_core::{Vector, vecmath};

/// What the last interval of each ray is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum LastInterval {
    /// As long as its optical depth says; what is left reaches the background.
    #[default]
    Finite,
    /// A wall: its optical depth counts as infinite whatever the array holds, nothing reaches the background, and the
    /// gradient with respect to it is 0. A ray without samples still shows the background.
    Opaque,
}

/// Number of rays of offsets.
fn rays(offsets: &[u32]) -> usize {
    offsets.len().saturating_sub(1)
}

/// The samples of ray `r`.
#[inline(always)]
fn range(offsets: &[u32], r: usize) -> Range<usize> {
    offsets[r] as usize..offsets[r + 1] as usize
}

/// Optical depths of a batch of rays.
#[derive(Clone, Copy, Debug)]
pub struct Samples<'a> {
    /// `[rays + 1]`, non-decreasing: ray `r` owns the samples `offsets[r] .. offsets[r + 1]`.
    pub offsets: &'a [u32],
    /// `[n]` optical depth of each interval, `sigma * dt`, dimensionless, `>= 0`; `inf` is opaque.
    pub tau: &'a [f32],
    /// What the last interval of each ray is.
    pub last: LastInterval,
}

impl Samples<'_> {
    /// Number of rays.
    #[must_use]
    pub fn rays(&self) -> usize {
        rays(self.offsets)
    }

    /// The samples of ray `r`.
    #[inline(always)]
    pub(crate) fn range(&self, r: usize) -> Range<usize> {
        range(self.offsets, r)
    }

    fn check(&self) {
        check_offsets(self.offsets, self.tau.len());
    }
}

/// Values of each sample, channel by channel: colours, normals, features.
#[derive(Clone, Copy, Debug)]
pub struct Values<'a> {
    /// Value of channel `c` of sample `i` at `data[c * stride + i]`.
    pub data: &'a [f32],
    /// Distance from one channel to the next, `>= n`.
    pub stride: usize,
    /// Number of channels.
    pub channels: usize,
}

impl Values<'_> {
    fn check(&self, n: usize) {
        assert!(self.stride >= n, "values: stride {} is less than {n} samples", self.stride);
        check_strided(self.data.len(), self.stride, self.channels, n, "values");
    }
}

/// Colours of two parts on the same rays, and what is behind them: as many channels everywhere.
fn check_parts(a: Values<'_>, b: Values<'_>, background: &[f32], n: usize, rays: usize) {
    a.check(n);
    b.check(n);
    assert_eq!(a.channels, b.channels, "the values of the two parts differ in channels");
    assert_eq!(background.len(), rays * a.channels, "background holds one value a ray and channel");
}

/// What [`weights`] or [`composite`] left for the way back.
#[derive(Clone, Copy, Debug)]
pub struct Weights<'a> {
    /// `[n]` weight of each interval.
    pub w: &'a [f32],
    /// `[rays]` transmittance to the background.
    pub trans_end: &'a [f32],
}

/// A channel-major array holds every channel's first `n` entries.
fn check_strided(len: usize, stride: usize, channels: usize, n: usize, what: &str) {
    let need = if channels == 0 { 0 } else { (channels - 1) * stride + n };
    assert!(len >= need, "{what}: {len} entries, {channels} channels of stride {stride} need {need}");
}

/// Offsets do not decrease and stay within `n` samples.
fn check_offsets(offsets: &[u32], n: usize) {
    assert!(offsets.is_sorted(), "offsets decrease");
    let last = offsets.last().copied().unwrap_or(0) as usize;
    assert!(last <= n, "offsets end at {last}, past the {n} samples");
}

/// Rays are worked on in blocks of at least this many samples (or to the last ray): long enough that the vector exps
/// have no tail to speak of, short enough for the first-level cache.
const BLOCK: usize = 512;

/// The rays of the block that starts with ray `first`.
#[inline(always)]
fn block(offsets: &[u32], first: usize) -> Range<usize> {
    let rays = offsets.len() - 1;
    let start = offsets[first] as usize;
    let mut end = first + 1;
    while end < rays && (offsets[end] as usize) - start < BLOCK {
        end += 1;
    }
    first..end
}

/// What [`map2`] does to each sample. A trait and not a closure: a closure would not be compiled with the level's instructions.
trait Op {
    fn apply<V: Vector>(a: V, b: V) -> V;
}

/// `T * (1 - exp(-tau))` from the depth in front and `tau`.
struct Weight;
/// `exp(-depth)`.
struct Transmittance;
/// `1 - exp(-depth)`.
struct Opacity;

impl Op for Weight {
    #[inline(always)]
    fn apply<V: Vector>(depth: V, tau: V) -> V {
        vecmath::exp_neg(depth) * -vecmath::exp_m1(-tau)
    }
}

impl Op for Transmittance {
    #[inline(always)]
    fn apply<V: Vector>(depth: V, _: V) -> V {
        vecmath::exp_neg(depth)
    }
}

impl Op for Opacity {
    #[inline(always)]
    fn apply<V: Vector>(depth: V, _: V) -> V {
        -vecmath::exp_m1(-depth)
    }
}

/// `a[i] = op(a[i], b[i])` on whole vectors; the tail goes through padded copies, so that a sample's result never depends
/// on where in the batch it lies.
#[inline(always)]
fn map2<V: Vector, F: Op>(a: &mut [f32], b: &[f32]) {
    let n = a.len();
    let b = &b[..n];
    let body = n / V::LANES * V::LANES;
    let mut i = 0;
    while i < body {
        F::apply(V::load(&a[i..]), V::load(&b[i..])).store(&mut a[i..]);
        i += V::LANES;
    }
    let tail = n - body;
    if tail > 0 {
        let (mut pa, mut pb) = ([0.0; MAX_LANES], [0.0; MAX_LANES]);
        pa[..tail].copy_from_slice(&a[body..]);
        pb[..tail].copy_from_slice(&b[body..]);
        F::apply(V::load(&pa), V::load(&pb)).store(&mut pa);
        a[body..].copy_from_slice(&pa[..tail]);
    }
}

/// `a[i] = op(a[i], 0)`, as [`map2`].
#[inline(always)]
fn map1<V: Vector, F: Op>(a: &mut [f32]) {
    let n = a.len();
    let body = n / V::LANES * V::LANES;
    let mut i = 0;
    while i < body {
        F::apply(V::load(&a[i..]), V::splat(0.0)).store(&mut a[i..]);
        i += V::LANES;
    }
    let tail = n - body;
    if tail > 0 {
        let mut pa = [0.0; MAX_LANES];
        pa[..tail].copy_from_slice(&a[body..]);
        F::apply(V::load(&pa), V::splat(0.0)).store(&mut pa);
        a[body..].copy_from_slice(&pa[..tail]);
    }
}

/// The widest vector level there is.
const MAX_LANES: usize = 16;
