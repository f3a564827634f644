//! A static and a dynamic part on one ray, mixed sample by sample by the share `m` of the dynamic one.
//!
//! Every interval has two optical depths `tau_s`, `tau_d`, two colours and a predicted share `m` in `[0, 1]`. With
//! `a = 1 - exp(-tau)` of each part,
//!
//! ```text
//! T[i] = prod((1 - m[j] a_d[j]) (1 - (1 - m[j]) a_s[j]), j < i)
//! w_d  = T m a_d            w_s = T (1 - m) a_s
//! C    = sum(w_d[i] c_d[i] + w_s[i] c_s[i]) + T_end * background
//! D    = sum((w_d[i] + w_s[i]) m[i])                   how much of the pixel moves
//! ```
//!
//! Two papers, one blend, two letters:
//!
//! | source | its weight | here |
//! | --- | --- | --- |
//! | DynamicNeRF, eq. 14 | `b` multiplies the static part | `m = 1 - b`, gradient of `b` = minus that of `m` |
//! | DynamicNeRF as released, NSFF, RoDynRF, eq. 11 | multiplies the dynamic part | `m` |
//!
//! The released programs add `1e-10` to each factor of `T`; here nothing is added. The opacities of an interval are added, not
//! composed, so what both cover is counted twice: with `o = m (1 - m) a_d a_s`
//!
//! ```text
//! sum(w_d + w_s) + T_end = 1 + sum(T o)  <=  1 + (1 - T_end) / 3
//! ```
//!
//! with the most where two opaque parts share evenly. Clamp an opacity that is made of these weights. Where every `m` is 0 or 1
//! the sum is 1.
//!
//! An image of either part alone has its own transmittance: [`composite`](super::composite) on `tau_s` or `tau_d`. A depth is a
//! channel of both values that holds the distances.
//!
//! | function | out of | into |
//! | --- | --- | --- |
//! | [`composite_blend`] | optical depths, shares, colours | pixels, how much of them moves |
//! | [`composite_blend_backward`] | their gradients | gradients of all that went in |
//!
//! Layout and determinism are those of [`quadrature`](super): ragged rays, feature-major values, a ray the same bits wherever in
//! the batch it is.
//!
//! # Numerics
//! A factor of `T` is summed from parts that do not cancel, `1 - m a` where matter is thin and `(1 - m) + m exp(-tau)` where it
//! is thick, and `T` is their product in `f64`. The way back divides by nothing: `T = 0` behind an opaque sample is a number as
//! any other.
//!
//! Values are not scanned: call [`check_finite`](super::check_finite) and [`check_density`](super::check_density) at the
//! boundary.
//!
//! ```
//! use float_core::Simd;
//! use render_core::quadrature::Values;
//! use render_core::quadrature::blend::{BlendSamples, BlendValues, CompositeBlend, composite_blend};
//!
//! // One ray, one interval, a quarter of which moves: a red wall, and green that would be as opaque.
//! let samples = BlendSamples { offsets: &[0, 1], tau_s: &[90.0], tau_d: &[90.0], m: &[0.25] };
//! let values = BlendValues {
//!     values_s: Values { data: &[1.0, 0.0, 0.0], stride: 1, channels: 3 },
//!     values_d: Values { data: &[0.0, 1.0, 0.0], stride: 1, channels: 3 },
//!     background: &[0.0; 3],
//! };
//! let (mut colour, mut dynamic, mut trans_end) = ([0.0; 3], [0.0], [0.0]);
//! let (mut w_s, mut w_d, mut trans) = ([0.0], [0.0], [0.0]);
//! let out = CompositeBlend {
//!     colour: &mut colour, dynamic: &mut dynamic, trans_end: &mut trans_end,
//!     w_s: &mut w_s, w_d: &mut w_d, trans: &mut trans,
//! };
//! composite_blend(Simd::best(), samples, values, out);
//! assert_eq!((colour, dynamic, trans_end), ([0.75, 0.25, 0.0], [0.25], [0.1875]));
//! ```
//!
//! # Source
//! Gao, Saraf, Kopf, Huang, "Dynamic View Synthesis from Dynamic Monocular Video", 2021, eq. 14 (the paper does not write `T`; it
//! is that of the release); Liu et al., "Robust Dynamic Radiance Fields", 2023, eq. 11.

mod backward;
mod forward;
pub mod reference;

pub use backward::{BlendTrans, CompositeBlendBar, CompositeBlendGrads, composite_blend_backward};
pub use forward::{CompositeBlend, composite_blend};

use super::lanes::{load_part, store_part};
use super::{Values, check_offsets, check_parts, range, rays};
use core::ops::Range;
use float_core::{Vector, vecmath};

/// Optical depths of a batch of rays, static and dynamic, and how they are mixed.
#[derive(Clone, Copy, Debug)]
pub struct BlendSamples<'a> {
    /// `[rays + 1]`, non-decreasing: ray `r` owns the samples `offsets[r] .. offsets[r + 1]`.
    pub offsets: &'a [u32],
    /// `[n]` optical depth of the static part of each interval, dimensionless, `>= 0`; `inf` is opaque.
    pub tau_s: &'a [f32],
    /// `[n]` optical depth of the dynamic part.
    pub tau_d: &'a [f32],
    /// `[n]` share of the dynamic part, in `[0, 1]`.
    pub m: &'a [f32],
}

impl BlendSamples<'_> {
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
pub struct BlendValues<'a> {
    /// Colours of the static part, and whatever else: any number of channels.
    pub values_s: Values<'a>,
    /// Those of the dynamic part, of as many channels.
    pub values_d: Values<'a>,
    /// `[rays][channels]` what is behind the last interval.
    pub background: &'a [f32],
}

impl BlendValues<'_> {
    /// Number of channels.
    fn channels(&self) -> usize {
        self.values_s.channels
    }
}

/// The checks that both ways share.
fn check(samples: BlendSamples<'_>, values: BlendValues<'_>) {
    let (n, rays) = (samples.tau_s.len(), samples.rays());
    check_offsets(samples.offsets, n);
    assert_eq!(samples.tau_d.len(), n, "tau_d and tau_s differ in length");
    assert_eq!(samples.m.len(), n, "m and tau_s differ in length");
    check_parts(values.values_s, values.values_d, values.background, n, rays);
}

/// Samples of one ray are worked on in pieces of this many, held on the stack.
const PIECE: usize = 64;

/// Opacities of a piece, and what passes them.
struct Piece {
    a_s: [f32; PIECE],
    a_d: [f32; PIECE],
    pass_s: [f32; PIECE],
    pass_d: [f32; PIECE],
}

/// One sample of it.
#[derive(Clone, Copy)]
struct Sample {
    /// `1 - exp(-tau)` of the parts.
    a_s: f64,
    a_d: f64,
    /// `m` and `1 - m`.
    m: f64,
    still: f64,
    /// `1 - (1 - m) a_s` and `1 - m a_d`.
    past_s: f64,
    past_d: f64,
}

impl Piece {
    const EMPTY: Self = Self { a_s: [0.0; PIECE], a_d: [0.0; PIECE], pass_s: [0.0; PIECE], pass_d: [0.0; PIECE] };

    /// Those of the samples `at`, at most [`PIECE`] of them.
    #[inline(always)]
    fn load<V: Vector>(&mut self, samples: BlendSamples<'_>, at: Range<usize>) {
        let n = at.len();
        for (tau, a, pass) in [
            (&samples.tau_s[at.clone()], &mut self.a_s, &mut self.pass_s),
            (&samples.tau_d[at], &mut self.a_d, &mut self.pass_d),
        ] {
            for i in (0..n).step_by(V::LANES) {
                let tau = load_part::<V>(&tau[i..]);
                store_part(-vecmath::exp_m1(-tau), &mut a[i..n]);
                store_part(vecmath::exp_neg(tau), &mut pass[i..n]);
            }
        }
    }

    /// Sample `i` of the piece, whose share is `m`.
    #[inline(always)]
    fn at(&self, i: usize, m: f32) -> Sample {
        let (a_s, a_d, m) = (f64::from(self.a_s[i]), f64::from(self.a_d[i]), f64::from(m));
        let still = 1.0 - m;
        let past = |share: f64, rest: f64, a: f64, pass: f32| {
            // Neither cancels: thin matter keeps its digits in `a`, thick matter in what passes.
            if a < 0.5 { 1.0 - share * a } else { rest + share * f64::from(pass) }
        };
        Sample {
            a_s,
            a_d,
            m,
            still,
            past_s: past(still, m, a_s, self.pass_s[i]),
            past_d: past(m, still, a_d, self.pass_d[i]),
        }
    }
}
