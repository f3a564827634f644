//! Weights of both parts and composited values, forward.

use super::super::forward::dot;
use super::super::lanes::{load_part, store_part};
use super::super::{Transmittance, block, map1};
use super::{Mixture, TwoSamples, TwoValues, check, shares};
use core::ops::Range;
use float_core::{Simd, Task, Vector, vecmath};

/// Where [`composite_two`] writes.
#[derive(Debug)]
pub struct CompositeTwo<'a> {
    /// `[rays][channels]` composited colours.
    pub colour: &'a mut [f32],
    /// `[rays]` uncertainty `sum(w_t * beta)`, without its lower bound.
    pub beta: &'a mut [f32],
    /// `[rays]` what the transient part covers, `sum(w_t)`.
    pub transient: &'a mut [f32],
    /// `[rays]` transmittance to the background.
    pub trans_end: &'a mut [f32],
    /// `[n]` weight of the static part of each interval. Samples that belong to no ray are left alone.
    pub w_s: &'a mut [f32],
    /// `[n]` weight of the transient part.
    pub w_t: &'a mut [f32],
}

/// Weights of a static and a transient part, and what each ray sees of both.
///
/// `colour[r][c] = sum(w_s[i] * values_s[c][i] + w_t[i] * values_t[c][i]) + trans_end[r] * background[r][c]`,
/// `beta[r] = sum(w_t[i] * beta[i])`, `transient[r] = sum(w_t[i])`; the weights are those of the [`Mixture`]. All outputs
/// are written.
///
/// # Shapes and units
/// See [`TwoSamples`], [`TwoValues`] and [`CompositeTwo`]. Weights are dimensionless and in `[0, 1]`.
///
/// # Numerics
/// Optical depths that are infinite are opaque. Where both are, or beyond `1e37`, [`Mixture::Proportional`] divides the
/// opacity as if they were `1e37`.
///
/// # Panics
/// When the lengths disagree, or the offsets decrease or run past the samples.
///
/// # Source
/// Martin-Brualla et al., "NeRF in the Wild", 2021, eq. 6, 7 and 11. The paper composites `beta` with the transmittance of the
/// transient part alone; here it is the joint one, as for the colour.
pub fn composite_two(
    simd: Simd,
    samples: TwoSamples<'_>,
    mixture: Mixture,
    values: TwoValues<'_>,
    out: CompositeTwo<'_>,
) {
    check(samples, values);
    let (n, rays) = (samples.tau_s.len(), samples.rays());
    assert_eq!(out.colour.len(), rays * values.channels(), "colour holds one value a ray and channel");
    assert_eq!(out.beta.len(), rays, "the uncertainty of rays holds one number a ray");
    assert_eq!(out.transient.len(), rays, "transient holds one number a ray");
    assert_eq!(out.trans_end.len(), rays, "trans_end holds one number a ray");
    assert_eq!(out.w_s.len(), n, "w_s and tau_s differ in length");
    assert_eq!(out.w_t.len(), n, "w_t and tau_s differ in length");
    simd.run(CompositeTask { samples, mixture, values, out });
}

struct CompositeTask<'a> {
    samples: TwoSamples<'a>,
    mixture: Mixture,
    values: TwoValues<'a>,
    out: CompositeTwo<'a>,
}

impl Task for CompositeTask<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { samples, mixture, values, out } = self;
        let channels = values.channels();
        let mut first = 0;
        while first < samples.rays() {
            let rays = block(samples.offsets, first);
            first = rays.end;
            for r in rays.clone() {
                out.trans_end[r] = depths_before(samples, samples.range(r), out.w_s);
            }
            let span = samples.offsets[rays.start] as usize..samples.offsets[rays.end] as usize;
            let (tau_s, tau_t) = (&samples.tau_s[span.clone()], &samples.tau_t[span.clone()]);
            match mixture {
                Mixture::Paper => mix::<V, Separate>(tau_s, tau_t, &mut out.w_s[span.clone()], &mut out.w_t[span]),
                Mixture::Proportional => {
                    mix::<V, Divided>(tau_s, tau_t, &mut out.w_s[span.clone()], &mut out.w_t[span])
                }
            }
            for r in rays {
                let range = samples.range(r);
                let (w_s, w_t) = (&out.w_s[range.clone()], &out.w_t[range.clone()]);
                for c in 0..channels {
                    let s = &values.values_s.data[c * values.values_s.stride..][range.clone()];
                    let t = &values.values_t.data[c * values.values_t.stride..][range.clone()];
                    out.colour[r * channels + c] = dot::<V>(w_s, s) + dot::<V>(w_t, t);
                }
                out.beta[r] = dot::<V>(w_t, &values.beta[range]);
                // In f64: it is a report and a monitor, and costs nothing beside the rest.
                out.transient[r] = w_t.iter().map(|&w| f64::from(w)).sum::<f64>() as f32;
            }
        }
        map1::<V, Transmittance>(out.trans_end);
        if channels > 0 {
            let rays = out.colour.chunks_exact_mut(channels).zip(values.background.chunks_exact(channels));
            for ((colour, background), &trans) in rays.zip(out.trans_end.iter()) {
                for (colour, &background) in colour.iter_mut().zip(background) {
                    *colour += trans * background;
                }
            }
        }
    }
}

/// Optical depth before each sample of one ray; returns that of the whole ray.
#[inline(always)]
fn depths_before(samples: TwoSamples<'_>, range: Range<usize>, out: &mut [f32]) -> f32 {
    let mut depth = 0.0_f64;
    let tau = samples.tau_s[range.clone()].iter().zip(&samples.tau_t[range.clone()]);
    for (out, (&s, &t)) in out[range].iter_mut().zip(tau) {
        *out = depth as f32;
        depth += f64::from(s) + f64::from(t);
    }
    depth as f32
}

/// What a [`Mixture`] does to the samples of one vector. A trait and not a closure: a closure would not be compiled with
/// the level's instructions.
trait Mix {
    fn apply<V: Vector>(depth: V, tau_s: V, tau_t: V) -> (V, V);
}

/// [`Mixture::Paper`].
struct Separate;
/// [`Mixture::Proportional`].
struct Divided;

impl Mix for Separate {
    #[inline(always)]
    fn apply<V: Vector>(depth: V, tau_s: V, tau_t: V) -> (V, V) {
        let trans = vecmath::exp_neg(depth);
        (trans * -vecmath::exp_m1(-tau_s), trans * -vecmath::exp_m1(-tau_t))
    }
}

impl Mix for Divided {
    #[inline(always)]
    fn apply<V: Vector>(depth: V, tau_s: V, tau_t: V) -> (V, V) {
        let (tau, s, t) = shares(tau_s, tau_t);
        let w = vecmath::exp_neg(depth) * -vecmath::exp_m1(-tau);
        (w * s, w * t)
    }
}

/// `w_s` holds the depth before each sample; both weights are written.
#[inline(always)]
fn mix<V: Vector, M: Mix>(tau_s: &[f32], tau_t: &[f32], w_s: &mut [f32], w_t: &mut [f32]) {
    for i in (0..w_s.len()).step_by(V::LANES) {
        let depth = load_part::<V>(&w_s[i..]);
        let (s, t) = M::apply(depth, load_part(&tau_s[i..]), load_part(&tau_t[i..]));
        store_part(s, &mut w_s[i..]);
        store_part(t, &mut w_t[i..]);
    }
}
