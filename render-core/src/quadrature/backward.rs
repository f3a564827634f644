//! Gradients of weights and composited values, by one sweep from back to front.
//!
//! With `g[i]` the gradient that reaches `w[i]` from all its uses and `g_end` the one that reaches `trans_end`,
//!
//! ```text
//! tau_bar[i] = T[i + 1] * g[i] - Q[i]        Q[i] = sum(w[j] * g[j], j > i) + trans_end * g_end
//! ```
//!
//! The suffix `Q` is summed in `f64` from the back: what lies behind a surface keeps its digits.

use super::{LastInterval, Samples, Transmittance, Values, Weights, block, check_strided, map1};
use float_core::{Simd, Task, Vector};

/// Gradients that reach the outputs of [`weights`](super::weights).
#[derive(Clone, Copy, Debug)]
pub struct WeightsBar<'a> {
    /// `[n]`
    pub w: &'a [f32],
    /// `[rays]`; `None` when no loss depends on it.
    pub trans_end: Option<&'a [f32]>,
}

/// Gradients that reach the outputs of [`composite`](super::composite).
#[derive(Clone, Copy, Debug)]
pub struct CompositeBar<'a> {
    /// `[rays][channels]`
    pub colour: &'a [f32],
    /// `[n]` from other uses of the weights: depth, distortion, interlevel losses.
    pub w: Option<&'a [f32]>,
    /// `[rays]` from other uses of the transmittance. A loss on the opacity goes in with the sign turned.
    pub trans_end: Option<&'a [f32]>,
}

/// Where [`composite_backward`] puts its gradients.
#[derive(Debug)]
pub struct CompositeGrads<'a> {
    /// `[n]` **written**; samples that belong to no ray are left alone.
    pub tau: &'a mut [f32],
    /// `[channels][stride]` with the stride of the values, **written** for the samples of the rays.
    pub values: &'a mut [f32],
    /// `[rays][channels]`, added to.
    pub background: Option<&'a mut [f32]>,
}

/// Gradient of [`weights`](super::weights) with respect to the optical depths.
///
/// `tau_bar` `[n]` is **written**, not added to (it is scratch on the way); samples that belong to no ray are left alone.
///
/// # Panics
/// When the lengths disagree, or the offsets decrease or run past the samples.
pub fn weights_backward(
    simd: Simd,
    samples: Samples<'_>,
    forward: Weights<'_>,
    bar: WeightsBar<'_>,
    tau_bar: &mut [f32],
) {
    let values = Values { data: &[], stride: samples.tau.len(), channels: 0 };
    let bar = CompositeBar { colour: &[], w: Some(bar.w), trans_end: bar.trans_end };
    let grads = CompositeGrads { tau: tau_bar, values: &mut [], background: None };
    composite_backward(simd, samples, values, &[], forward, bar, grads);
}

/// Gradient of [`composite`](super::composite) with respect to optical depths, values and background.
///
/// The gradients of optical depths and values are **written**, that of the background is added. `background` is the one
/// of the forward call.
///
/// # Panics
/// When the lengths disagree, or the offsets decrease or run past the samples.
pub fn composite_backward(
    simd: Simd,
    samples: Samples<'_>,
    values: Values<'_>,
    background: &[f32],
    forward: Weights<'_>,
    bar: CompositeBar<'_>,
    grads: CompositeGrads<'_>,
) {
    samples.check();
    let (n, rays, channels) = (samples.tau.len(), samples.rays(), values.channels);
    values.check(n);
    check_strided(grads.values.len(), values.stride, channels, n, "gradient of the values");
    assert_eq!(background.len(), rays * channels, "background holds one value a ray and channel");
    assert_eq!(forward.w.len(), n, "w and tau differ in length");
    assert_eq!(forward.trans_end.len(), rays, "trans_end holds one number a ray");
    assert_eq!(bar.colour.len(), rays * channels, "the gradient of colour holds one value a ray and channel");
    assert!(bar.w.is_none_or(|x| x.len() == n), "the gradient of w and tau differ in length");
    assert!(bar.trans_end.is_none_or(|x| x.len() == rays), "the gradient of trans_end holds one number a ray");
    assert_eq!(grads.tau.len(), n, "the gradient of tau and tau differ in length");
    if let Some(b) = &grads.background {
        assert_eq!(b.len(), rays * channels, "the gradient of background holds one value a ray and channel");
    }
    simd.run(BackwardTask { samples, values, background, forward, bar, grads });
}

struct BackwardTask<'a> {
    samples: Samples<'a>,
    values: Values<'a>,
    background: &'a [f32],
    forward: Weights<'a>,
    bar: CompositeBar<'a>,
    grads: CompositeGrads<'a>,
}

/// Samples of one ray are swept in pieces of this many, held on the stack.
const PIECE: usize = 64;

impl Task for BackwardTask<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(mut self) {
        let (samples, rays) = (self.samples, self.samples.rays());
        let mut first = 0;
        while first < rays {
            let rays = block(samples.offsets, first);
            first = rays.end;
            // Transmittance behind each sample, into the place of its gradient.
            for r in rays.clone() {
                let range = samples.range(r);
                let mut depth = 0.0_f64;
                for (out, &tau) in self.grads.tau[range.clone()].iter_mut().zip(&samples.tau[range]) {
                    depth += f64::from(tau);
                    *out = depth as f32;
                }
            }
            let span = samples.offsets[rays.start] as usize..samples.offsets[rays.end] as usize;
            map1::<V, Transmittance>(&mut self.grads.tau[span]);
            for r in rays {
                match self.values.channels {
                    3 => self.sweep::<V, 3>(r, 3),
                    channels => self.sweep::<V, 0>(r, channels),
                }
            }
        }
    }
}

impl BackwardTask<'_> {
    /// One ray. `C` is the number of channels where it is known, else 0.
    #[inline(always)]
    fn sweep<V: Vector, const C: usize>(&mut self, r: usize, channels: usize) {
        let channels = if C > 0 { C } else { channels };
        let range = self.samples.range(r);
        let colour_bar = &self.bar.colour[r * channels..][..channels];
        let background = &self.background[r * channels..][..channels];
        let trans_end = self.forward.trans_end[r];
        let mut end_bar = self.bar.trans_end.map_or(0.0, |x| x[r]);
        for (c, b) in colour_bar.iter().zip(background) {
            end_bar += c * b;
        }
        if let Some(out) = self.grads.background.as_deref_mut() {
            for (out, c) in out[r * channels..][..channels].iter_mut().zip(colour_bar) {
                *out += trans_end * c;
            }
        }
        if range.is_empty() {
            return;
        }
        let mut suffix = f64::from(trans_end) * f64::from(end_bar);
        let pieces = range.len().div_ceil(PIECE);
        for piece in (0..pieces).rev() {
            let start = range.start + piece * PIECE;
            let n = PIECE.min(range.end - start);
            let (mut g, mut q) = ([0.0_f32; PIECE], [0.0_f32; PIECE]);
            self.upstream::<V, C>(start, colour_bar, &mut g[..n], &mut q[..n]);
            // q holds w * g; turn it into the suffix behind each sample.
            for q in q[..n].iter_mut().rev() {
                let wg = *q;
                *q = suffix as f32;
                suffix += f64::from(wg);
            }
            let tau_bar = &mut self.grads.tau[start..start + n];
            let body = n / V::LANES * V::LANES;
            for i in (0..body).step_by(V::LANES) {
                (V::load(&tau_bar[i..]) * V::load(&g[i..]) - V::load(&q[i..])).store(&mut tau_bar[i..]);
            }
            for i in body..n {
                tau_bar[i] = tau_bar[i] * g[i] - q[i];
            }
        }
        if self.samples.last == LastInterval::Opaque {
            self.grads.tau[range.end - 1] = 0.0;
        }
    }

    /// What reaches the weights of the samples from `start` on, into `g`, and times the weight into `wg`; and the
    /// gradient of their values.
    #[inline(always)]
    fn upstream<V: Vector, const C: usize>(&mut self, start: usize, colour_bar: &[f32], g: &mut [f32], wg: &mut [f32]) {
        let channels = if C > 0 { C } else { colour_bar.len() };
        let stride = self.values.stride;
        let (n, w) = (g.len(), &self.forward.w[start..]);
        let body = n / V::LANES * V::LANES;
        for i in (0..body).step_by(V::LANES) {
            let weight = V::load(&w[i..]);
            let mut sum = match self.bar.w {
                Some(bar) => V::load(&bar[start + i..]),
                None => V::splat(0.0),
            };
            for (c, &bar) in colour_bar[..channels].iter().enumerate() {
                let bar = V::splat(bar);
                sum = V::load(&self.values.data[c * stride + start + i..]).mul_add(bar, sum);
                (weight * bar).store(&mut self.grads.values[c * stride + start + i..]);
            }
            sum.store(&mut g[i..]);
            (sum * weight).store(&mut wg[i..]);
        }
        for i in body..n {
            let mut sum = self.bar.w.map_or(0.0, |bar| bar[start + i]);
            for (c, bar) in colour_bar.iter().enumerate() {
                sum += self.values.data[c * stride + start + i] * bar;
                self.grads.values[c * stride + start + i] = w[i] * bar;
            }
            g[i] = sum;
            wg[i] = sum * w[i];
        }
    }
}
