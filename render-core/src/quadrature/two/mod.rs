//! Two kinds of matter on one ray: a static and a transient part, composited with one transmittance.
//!
//! Every interval has two optical depths `tau_s`, `tau_t`, two colours and an uncertainty `beta`. With
//! `T[i] = exp(-sum(tau_s[j] + tau_t[j], j < i))` and weights `w_s`, `w_t` that share it,
//!
//! ```text
//! C    = sum(w_s[i] * c_s[i] + w_t[i] * c_t[i]) + T_end * background
//! beta = sum(w_t[i] * beta[i])              (without its lower bound: add it where the loss is)
//! ```
//!
//! What an interval's opacity is divided into is the [`Mixture`]. An image of the static part alone has its own
//! transmittance: [`composite`](super::composite) on `tau_s`, not a part of what comes out here.
//!
//! | function | out of | into |
//! | --- | --- | --- |
//! | [`composite_two`] | optical depths, colours, uncertainties | pixels, uncertainty, share of the transient part |
//! | [`composite_two_backward`] | their gradients | gradients of all that went in |
//!
//! Layout, summing and determinism are those of [`quadrature`](super): ragged rays, feature-major values, optical depth
//! summed in `f64`. With `tau_t = 0` the results are those of [`composite`](super::composite), bit for bit; the gradients
//! up to rounding. Values are not scanned: call [`check_finite`](super::check_finite) and
//! [`check_density`](super::check_density) at the boundary.
//!
//! ```
//! use float_core::Simd;
//! use render_core::quadrature::Values;
//! use render_core::quadrature::two::{CompositeTwo, Mixture, TwoSamples, TwoValues, composite_two};
//!
//! // One ray, one interval: half of its matter a red wall, half a green passer-by.
//! let samples = TwoSamples { offsets: &[0, 1], tau_s: &[40.0], tau_t: &[40.0] };
//! let values = TwoValues {
//!     values_s: Values { data: &[1.0, 0.0, 0.0], stride: 1, channels: 3 },
//!     values_t: Values { data: &[0.0, 1.0, 0.0], stride: 1, channels: 3 },
//!     beta: &[2.0],
//!     background: &[0.0; 3],
//! };
//! let (mut colour, mut beta, mut transient, mut trans_end) = ([0.0; 3], [0.0], [0.0], [0.0]);
//! let (mut w_s, mut w_t) = ([0.0], [0.0]);
//! let out = CompositeTwo {
//!     colour: &mut colour, beta: &mut beta, transient: &mut transient, trans_end: &mut trans_end,
//!     w_s: &mut w_s, w_t: &mut w_t,
//! };
//! composite_two(Simd::best(), samples, Mixture::Proportional, values, out);
//! assert_eq!((colour, beta, transient), ([0.5, 0.5, 0.0], [1.0], [0.5]));
//! ```
//!
//! # Source
//! Martin-Brualla et al., "NeRF in the Wild", 2021, eq. 6, 7 and 11.

mod backward;
mod forward;
pub mod reference;

pub use backward::{CompositeTwoBar, CompositeTwoGrads, WeightsTwo, composite_two_backward};
pub use forward::{CompositeTwo, composite_two};

use super::{Values, check_offsets, check_parts, range, rays};
use core::ops::Range;
use float_core::Vector;

/// How the opacity of an interval is divided between its two parts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Mixture {
    /// As published: each part as if the other were not in the same interval, `w_s = T (1 - exp(-tau_s))` and
    /// `w_t = T (1 - exp(-tau_t))`. What both cover is counted twice: `sum(w_s + w_t) + T_end` is
    /// `1 + sum(T a_s a_t)` with the opacities `a_s`, `a_t` of the two, so colours can exceed 1.
    #[default]
    Paper,
    /// The opacity of both together, divided in proportion to the optical depths:
    /// `w_s = T (1 - exp(-(tau_s + tau_t))) tau_s / (tau_s + tau_t)`. Sums to 1 with `T_end`. This is the exact integral
    /// where both densities are constant along the interval.
    Proportional,
}

impl Mixture {
    /// Both, in the order above.
    pub const ALL: [Self; 2] = [Self::Paper, Self::Proportional];
}

/// Optical depths of a batch of rays, static and transient.
#[derive(Clone, Copy, Debug)]
pub struct TwoSamples<'a> {
    /// `[rays + 1]`, non-decreasing: ray `r` owns the samples `offsets[r] .. offsets[r + 1]`.
    pub offsets: &'a [u32],
    /// `[n]` optical depth of the static part of each interval, dimensionless, `>= 0`; `inf` is opaque.
    pub tau_s: &'a [f32],
    /// `[n]` optical depth of the transient part.
    pub tau_t: &'a [f32],
}

impl TwoSamples<'_> {
    /// Number of rays.
    #[must_use]
    pub fn rays(&self) -> usize {
        rays(self.offsets)
    }

    #[inline(always)]
    fn range(&self, r: usize) -> Range<usize> {
        range(self.offsets, r)
    }
}

/// What is composited.
#[derive(Clone, Copy, Debug)]
pub struct TwoValues<'a> {
    /// Colours of the static part; usually three channels.
    pub values_s: Values<'a>,
    /// Colours of the transient part, of as many channels.
    pub values_t: Values<'a>,
    /// `[n]` uncertainty of each sample, `>= 0`, in the unit of colours.
    pub beta: &'a [f32],
    /// `[rays][channels]` what is behind the last interval.
    pub background: &'a [f32],
}

impl TwoValues<'_> {
    /// Number of channels of the colours.
    fn channels(&self) -> usize {
        self.values_s.channels
    }
}

/// The checks that both ways share.
fn check(samples: TwoSamples<'_>, values: TwoValues<'_>) {
    let (n, rays) = (samples.tau_s.len(), samples.rays());
    check_offsets(samples.offsets, n);
    assert_eq!(samples.tau_t.len(), n, "tau_t and tau_s differ in length");
    check_parts(values.values_s, values.values_t, values.background, n, rays);
    assert_eq!(values.beta.len(), n, "beta and tau_s differ in length");
}

/// Optical depths beyond this count as this where the opacity is divided: their sum must not overflow.
const DEEP: f32 = 1e37;

/// The sum of both optical depths and the share of each. Without any matter the static part has all of nothing, which
/// makes the gradients below right.
#[inline(always)]
fn shares<V: Vector>(tau_s: V, tau_t: V) -> (V, V, V) {
    let (s, t) = (tau_s.min(V::splat(DEEP)), tau_t.min(V::splat(DEEP)));
    let tau = s + t;
    (tau, tau.select_positive(s / tau, V::splat(1.0)), tau.select_positive(t / tau, V::splat(0.0)))
}
