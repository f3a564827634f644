//! Weights and composited values, forward.

use super::{LastInterval, Opacity, Samples, Transmittance, Values, Weight, block, check_offsets, map1, map2};
use float_core::{Simd, Task, Vector};

/// Where [`composite`] writes.
#[derive(Debug)]
pub struct Composite<'a> {
    /// `[rays][channels]` composited values.
    pub colour: &'a mut [f32],
    /// `[rays]` accumulated opacity, `1 - trans_end` without its cancellation.
    pub opacity: &'a mut [f32],
    /// `[n]` weight of each interval. Samples that belong to no ray are left alone.
    pub w: &'a mut [f32],
    /// `[rays]` transmittance to the background.
    pub trans_end: &'a mut [f32],
}

/// Weight of each interval, and what passes all of them.
///
/// `w[i] = T[i] * (1 - exp(-tau[i]))`, `T[i] = exp(-sum(tau[j], j < i))` within each ray; `trans_end[r]` is the `T`
/// behind the last one. Both are written.
///
/// # Shapes and units
/// * `w`         `[n]`    out, dimensionless, in `[0, 1]`; samples that belong to no ray are left alone
/// * `trans_end` `[rays]` out, dimensionless, in `[0, 1]`; `sum(w) + trans_end = 1` up to rounding
///
/// # Panics
/// When the lengths disagree, or the offsets decrease or run past the samples.
pub fn weights(simd: Simd, samples: Samples<'_>, w: &mut [f32], trans_end: &mut [f32]) {
    samples.check();
    assert_eq!(w.len(), samples.tau.len(), "w and tau differ in length");
    assert_eq!(trans_end.len(), samples.rays(), "trans_end holds one number a ray");
    simd.run(WeightsTask { samples, w, trans_end });
}

/// Weights, opacity and composited values of each ray.
///
/// `colour[r][c] = sum(w[i] * values[c][i]) + trans_end[r] * background[r][c]`. All outputs are written.
///
/// # Shapes and units
/// * `values`     `[channels][stride]` radiance or whatever else is to be composited
/// * `background` `[rays][channels]`   what is behind the last interval
///
/// # Panics
/// When the lengths disagree, or the offsets decrease or run past the samples.
pub fn composite(simd: Simd, samples: Samples<'_>, values: Values<'_>, background: &[f32], out: Composite<'_>) {
    samples.check();
    let (n, rays) = (samples.tau.len(), samples.rays());
    values.check(n);
    assert_eq!(background.len(), rays * values.channels, "background holds one value a ray and channel");
    assert_eq!(out.colour.len(), rays * values.channels, "colour holds one value a ray and channel");
    assert_eq!(out.opacity.len(), rays, "opacity holds one number a ray");
    assert_eq!(out.trans_end.len(), rays, "trans_end holds one number a ray");
    assert_eq!(out.w.len(), n, "w and tau differ in length");
    simd.run(CompositeTask { samples, values, background, out });
}

/// Sums of values under given weights: `out[r][c] = sum(w[i] * values[c][i])`, written.
///
/// For normals, follow it with [`normalise`](super::normalise). The way back is a product:
/// `values_bar[c][i] += w[i] * out_bar[r][c]`, and `w_bar` goes into
/// [`WeightsBar`](super::WeightsBar).
///
/// # Shapes and units
/// * `offsets` `[rays + 1]`, `w` `[n]`, `values` `[channels][stride]`, `out` `[rays][channels]`
///
/// # Panics
/// When the lengths disagree, or the offsets decrease or run past the samples.
pub fn accumulate(simd: Simd, offsets: &[u32], w: &[f32], values: Values<'_>, out: &mut [f32]) {
    check_offsets(offsets, w.len());
    values.check(w.len());
    let rays = offsets.len().saturating_sub(1);
    assert_eq!(out.len(), rays * values.channels, "out holds one value a ray and channel");
    simd.run(AccumulateTask { offsets, w, values, out });
}

struct WeightsTask<'a> {
    samples: Samples<'a>,
    w: &'a mut [f32],
    trans_end: &'a mut [f32],
}

impl Task for WeightsTask<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        let rays = self.samples.rays();
        let mut first = 0;
        while first < rays {
            let rays = block(self.samples.offsets, first);
            first = rays.end;
            block_weights::<V>(self.samples, rays, self.w, self.trans_end);
        }
        map1::<V, Transmittance>(self.trans_end);
    }
}

/// Weights of the rays of one block. Leaves the optical depth of each whole ray in `depth_end`.
#[inline(always)]
fn block_weights<V: Vector>(samples: Samples<'_>, rays: core::ops::Range<usize>, w: &mut [f32], depth_end: &mut [f32]) {
    let span = samples.offsets[rays.start] as usize..samples.offsets[rays.end] as usize;
    // Optical depth before each sample: the serial part, one f64 addition a sample.
    for r in rays.clone() {
        let range = samples.range(r);
        let mut depth = 0.0_f64;
        for (w, &tau) in w[range.clone()].iter_mut().zip(&samples.tau[range.clone()]) {
            *w = depth as f32;
            depth += f64::from(tau);
        }
        depth_end[r] = depth as f32;
        if samples.last == LastInterval::Opaque && !range.is_empty() {
            // The sample's own optical depth counts as infinite. Its slot keeps the depth before it.
            depth_end[r] = f32::INFINITY;
        }
    }
    if samples.last == LastInterval::Finite {
        map2::<V, Weight>(&mut w[span.clone()], &samples.tau[span]);
    } else {
        // The last sample of a ray needs another factor: remember its depth across the vector pass.
        let mut r = rays.start;
        while r < rays.end {
            let mut kept = [0.0; super::MAX_LANES];
            let end = rays.end.min(r + V::LANES);
            for (kept, r) in kept.iter_mut().zip(r..end) {
                let range = samples.range(r);
                if !range.is_empty() {
                    *kept = w[range.end - 1];
                }
            }
            let span = samples.offsets[r] as usize..samples.offsets[end] as usize;
            map2::<V, Weight>(&mut w[span.clone()], &samples.tau[span]);
            map1::<V, Transmittance>(&mut kept[..V::LANES]);
            for (kept, r) in kept.iter().zip(r..end) {
                let range = samples.range(r);
                if !range.is_empty() {
                    w[range.end - 1] = *kept;
                }
            }
            r = end;
        }
    }
}

struct CompositeTask<'a> {
    samples: Samples<'a>,
    values: Values<'a>,
    background: &'a [f32],
    out: Composite<'a>,
}

impl Task for CompositeTask<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { samples, values, background, out } = self;
        let channels = values.channels;
        let mut first = 0;
        while first < samples.rays() {
            let rays = block(samples.offsets, first);
            first = rays.end;
            block_weights::<V>(samples, rays.clone(), out.w, out.trans_end);
            for r in rays {
                let range = samples.range(r);
                for c in 0..channels {
                    let v = &values.data[c * values.stride..];
                    out.colour[r * channels + c] = dot::<V>(&out.w[range.clone()], &v[range.clone()]);
                }
            }
        }
        out.opacity.copy_from_slice(out.trans_end);
        map1::<V, Opacity>(out.opacity);
        map1::<V, Transmittance>(out.trans_end);
        if channels > 0 {
            let rays = out.colour.chunks_exact_mut(channels).zip(background.chunks_exact(channels));
            for ((colour, background), &trans) in rays.zip(out.trans_end.iter()) {
                for (colour, &background) in colour.iter_mut().zip(background) {
                    *colour += trans * background;
                }
            }
        }
    }
}

struct AccumulateTask<'a> {
    offsets: &'a [u32],
    w: &'a [f32],
    values: Values<'a>,
    out: &'a mut [f32],
}

impl Task for AccumulateTask<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { offsets, w, values, out } = self;
        for (r, ends) in offsets.windows(2).enumerate() {
            let range = ends[0] as usize..ends[1] as usize;
            for c in 0..values.channels {
                let v = &values.data[c * values.stride..];
                out[r * values.channels + c] = dot::<V>(&w[range.clone()], &v[range.clone()]);
            }
        }
    }
}

/// Samples of a ray that are summed in `f32`; longer rays go on in `f64`, or a million samples would cost four digits.
const SHORT: usize = 1024;

/// `sum(a[i] * b[i])`, in an order that depends on the length only.
#[inline(always)]
pub(super) fn dot<V: Vector>(a: &[f32], b: &[f32]) -> f32 {
    if a.len() <= SHORT {
        return dot_short::<V>(a, b);
    }
    a.chunks(SHORT).zip(b.chunks(SHORT)).map(|(a, b)| f64::from(dot_short::<V>(a, b))).sum::<f64>() as f32
}

/// Vectors first, then the tail one by one.
#[inline(always)]
fn dot_short<V: Vector>(a: &[f32], b: &[f32]) -> f32 {
    let body = a.len() / V::LANES * V::LANES;
    let mut acc = V::splat(0.0);
    for (a, b) in a[..body].chunks_exact(V::LANES).zip(b[..body].chunks_exact(V::LANES)) {
        acc = V::load(a).mul_add(V::load(b), acc);
    }
    let mut sum = if body > 0 { acc.sum() } else { 0.0 };
    for (&a, &b) in a[body..].iter().zip(&b[body..]) {
        sum += a * b;
    }
    sum
}
