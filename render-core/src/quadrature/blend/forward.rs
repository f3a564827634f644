//! Weights of both parts and composited values, forward.

use super::super::forward::dot;
use super::{BlendSamples, BlendValues, PIECE, Piece, check};
use float_core::{Simd, Task, Vector};

/// Where [`composite_blend`] writes.
#[derive(Debug)]
pub struct CompositeBlend<'a> {
    /// `[rays][channels]` composited values.
    pub colour: &'a mut [f32],
    /// `[rays]` how much of the pixel moves, `sum((w_s + w_d) * m)`.
    pub dynamic: &'a mut [f32],
    /// `[rays]` transmittance to the background.
    pub trans_end: &'a mut [f32],
    /// `[n]` weight of the static part of each interval. Samples that belong to no ray are left alone, here and below.
    pub w_s: &'a mut [f32],
    /// `[n]` weight of the dynamic part.
    pub w_d: &'a mut [f32],
    /// `[n]` transmittance in front of each interval.
    pub trans: &'a mut [f32],
}

/// Weights of a static and a dynamic part, mixed sample by sample, and what each ray sees of both.
///
/// `colour[r][c] = sum(w_s[i] * values_s[c][i] + w_d[i] * values_d[c][i]) + trans_end[r] * background[r][c]` with the weights of
/// the [module](super). All outputs are written.
///
/// # Shapes and units
/// See [`BlendSamples`], [`BlendValues`] and [`CompositeBlend`]. Weights are dimensionless, each in `[0, 1]`; their sum can exceed
/// 1, by at most a third.
///
/// # Numerics
/// Optical depths that are infinite are opaque. `m` is not clamped.
///
/// # Panics
/// When the lengths disagree, or the offsets decrease or run past the samples.
///
/// # Source
/// DynamicNeRF, 2021, eq. 14 with `b = 1 - m`; RoDynRF, 2023, eq. 11.
pub fn composite_blend(simd: Simd, samples: BlendSamples<'_>, values: BlendValues<'_>, out: CompositeBlend<'_>) {
    check(samples, values);
    let (n, rays) = (samples.tau_s.len(), samples.rays());
    assert_eq!(out.colour.len(), rays * values.channels(), "colour holds one value a ray and channel");
    assert_eq!(out.dynamic.len(), rays, "dynamic holds one number a ray");
    assert_eq!(out.trans_end.len(), rays, "trans_end holds one number a ray");
    for (out, what) in [(&out.w_s, "w_s"), (&out.w_d, "w_d"), (&out.trans, "trans")] {
        assert_eq!(out.len(), n, "{what} and tau_s differ in length");
    }
    simd.run(ForwardTask { samples, values, out });
}

struct ForwardTask<'a> {
    samples: BlendSamples<'a>,
    values: BlendValues<'a>,
    out: CompositeBlend<'a>,
}

impl Task for ForwardTask<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { samples, values, out } = self;
        let channels = values.channels();
        let mut piece = Piece::EMPTY;
        for r in 0..samples.rays() {
            let range = samples.range(r);
            let (mut trans, mut dynamic) = (1.0_f64, 0.0_f64);
            for start in range.clone().step_by(PIECE) {
                let end = range.end.min(start + PIECE);
                piece.load::<V>(samples, start..end);
                for i in start..end {
                    let s = piece.at(i - start, samples.m[i]);
                    let (w_s, w_d) = (trans * s.still * s.a_s, trans * s.m * s.a_d);
                    out.trans[i] = trans as f32;
                    (out.w_s[i], out.w_d[i]) = (w_s as f32, w_d as f32);
                    dynamic += (w_s + w_d) * s.m;
                    trans *= s.past_s * s.past_d;
                }
            }
            (out.dynamic[r], out.trans_end[r]) = (dynamic as f32, trans as f32);
            for c in 0..channels {
                let s = &values.values_s.data[c * values.values_s.stride..][range.clone()];
                let d = &values.values_d.data[c * values.values_d.stride..][range.clone()];
                let seen = dot::<V>(&out.w_s[range.clone()], s) + dot::<V>(&out.w_d[range.clone()], d);
                out.colour[r * channels + c] = seen + out.trans_end[r] * values.background[r * channels + c];
            }
        }
    }
}
