//! Gradients of both optical depths, colours and the uncertainty, by one sweep from back to front.
//!
//! With `g_s[i]`, `g_t[i]` what reaches `w_s[i]`, `w_t[i]` from all their uses, `g_end` what reaches `trans_end`, and
//! `Q[i] = sum(w_s[j] g_s[j] + w_t[j] g_t[j], j > i) + trans_end g_end`,
//!
//! ```text
//! as published:   tau_s_bar[i] = T[i] exp(-tau_s[i]) g_s[i] - Q[i]            and so for t
//! proportional:   tau_s_bar[i] = T[i + 1] g[i] + h[i] q_t[i] - Q[i]           g = q_s g_s + q_t g_t
//!                 tau_t_bar[i] = T[i + 1] g[i] - h[i] q_s[i] - Q[i]           h = T (1 - exp(-tau)) / tau (g_s - g_t)
//! ```
//!
//! where `tau = tau_s + tau_t` and `q_s`, `q_t` are the shares of the two in it. Nothing there cancels as `tau` vanishes.

use super::super::lanes::{load_part, load_some, store_part};
use super::super::{Transmittance, Values, block, check_strided, map1};
use super::{Mixture, TwoSamples, TwoValues, check, shares};
use float_core::{Simd, Task, Vector, vecmath};

/// What [`composite_two`](super::composite_two) left for the way back.
#[derive(Clone, Copy, Debug)]
pub struct WeightsTwo<'a> {
    /// `[n]`
    pub w_s: &'a [f32],
    /// `[n]`
    pub w_t: &'a [f32],
    /// `[rays]`
    pub trans_end: &'a [f32],
}

/// Gradients that reach the outputs of [`composite_two`](super::composite_two); `None` where no loss depends on an output.
#[derive(Clone, Copy, Debug)]
pub struct CompositeTwoBar<'a> {
    /// `[rays][channels]`
    pub colour: &'a [f32],
    /// `[rays]`
    pub beta: Option<&'a [f32]>,
    /// `[rays]`
    pub transient: Option<&'a [f32]>,
    /// `[rays]` from other uses of the transmittance.
    pub trans_end: Option<&'a [f32]>,
    /// `[n]` from other uses of the weights.
    pub w_s: Option<&'a [f32]>,
    /// `[n]`
    pub w_t: Option<&'a [f32]>,
}

/// Where [`composite_two_backward`] puts its gradients.
#[derive(Debug)]
pub struct CompositeTwoGrads<'a> {
    /// `[n]` **written**; samples that belong to no ray are left alone, here and below.
    pub tau_s: &'a mut [f32],
    /// `[n]` **written**
    pub tau_t: &'a mut [f32],
    /// `[channels][stride]` with the stride of `values_s`, **written** for the samples of the rays.
    pub values_s: &'a mut [f32],
    /// `[channels][stride]` with the stride of `values_t`, **written** for the samples of the rays.
    pub values_t: &'a mut [f32],
    /// `[n]` **written**
    pub beta: &'a mut [f32],
    /// `[rays][channels]`, added to.
    pub background: Option<&'a mut [f32]>,
}

/// Gradient of [`composite_two`](super::composite_two) with respect to optical depths, colours, uncertainties and
/// background.
///
/// All gradients are **written**, but that of the background, which is added. `mixture` and `values` are those of the
/// forward call.
///
/// # Panics
/// When the lengths disagree, or the offsets decrease or run past the samples.
pub fn composite_two_backward(
    simd: Simd,
    samples: TwoSamples<'_>,
    mixture: Mixture,
    values: TwoValues<'_>,
    forward: WeightsTwo<'_>,
    bar: CompositeTwoBar<'_>,
    grads: CompositeTwoGrads<'_>,
) {
    check(samples, values);
    let (n, rays, channels) = (samples.tau_s.len(), samples.rays(), values.channels());
    let strided = |len, values: Values<'_>, what| check_strided(len, values.stride, channels, n, what);
    strided(grads.values_s.len(), values.values_s, "gradient of the static values");
    strided(grads.values_t.len(), values.values_t, "gradient of the transient values");
    assert_eq!(forward.w_s.len(), n, "w_s and tau_s differ in length");
    assert_eq!(forward.w_t.len(), n, "w_t and tau_s differ in length");
    assert_eq!(forward.trans_end.len(), rays, "trans_end holds one number a ray");
    assert_eq!(bar.colour.len(), rays * channels, "the gradient of colour holds one value a ray and channel");
    for (bar, what) in [(bar.beta, "beta"), (bar.transient, "transient"), (bar.trans_end, "trans_end")] {
        assert!(bar.is_none_or(|x| x.len() == rays), "the gradient of {what} holds one number a ray");
    }
    for (bar, what) in [(bar.w_s, "w_s"), (bar.w_t, "w_t")] {
        assert!(bar.is_none_or(|x| x.len() == n), "the gradient of {what} and tau_s differ in length");
    }
    for (grad, what) in [(&grads.tau_s, "tau_s"), (&grads.tau_t, "tau_t"), (&grads.beta, "beta")] {
        assert_eq!(grad.len(), n, "the gradient of {what} and tau_s differ in length");
    }
    if let Some(b) = &grads.background {
        assert_eq!(b.len(), rays * channels, "the gradient of background holds one value a ray and channel");
    }
    simd.run(BackwardTask { samples, mixture, values, forward, bar, grads });
}

struct BackwardTask<'a> {
    samples: TwoSamples<'a>,
    mixture: Mixture,
    values: TwoValues<'a>,
    forward: WeightsTwo<'a>,
    bar: CompositeTwoBar<'a>,
    grads: CompositeTwoGrads<'a>,
}

/// Samples of one ray are swept in pieces of this many, held on the stack.
const PIECE: usize = 64;

/// What reaches the weights of one piece.
struct Upstream {
    s: [f32; PIECE],
    t: [f32; PIECE],
    /// `w_s g_s + w_t g_t`, then the suffix behind each sample.
    q: [f32; PIECE],
}

impl Task for BackwardTask<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(mut self) {
        let (samples, rays) = (self.samples, self.samples.rays());
        let mut first = 0;
        while first < rays {
            let rays = block(samples.offsets, first);
            first = rays.end;
            for r in rays.clone() {
                self.depths(r);
            }
            let span = samples.offsets[rays.start] as usize..samples.offsets[rays.end] as usize;
            map1::<V, Transmittance>(&mut self.grads.tau_s[span.clone()]);
            map1::<V, Transmittance>(&mut self.grads.tau_t[span]);
            for r in rays {
                match self.values.channels() {
                    3 => self.sweep::<V, 3>(r, 3),
                    channels => self.sweep::<V, 0>(r, channels),
                }
            }
        }
    }
}

impl BackwardTask<'_> {
    /// Optical depths whose transmittances the sweep needs, into the places of the gradients: as published, with the
    /// sample's own static and transient depth; proportional, behind and before the sample.
    #[inline(always)]
    fn depths(&mut self, r: usize) {
        let range = self.samples.range(r);
        let tau = self.samples.tau_s[range.clone()].iter().zip(&self.samples.tau_t[range.clone()]);
        let out = self.grads.tau_s[range.clone()].iter_mut().zip(&mut self.grads.tau_t[range]);
        let mut depth = 0.0_f64;
        for ((out_s, out_t), (&s, &t)) in out.zip(tau) {
            let (s, t) = (f64::from(s), f64::from(t));
            let behind = depth + (s + t);
            (*out_s, *out_t) = match self.mixture {
                Mixture::Paper => ((depth + s) as f32, (depth + t) as f32),
                Mixture::Proportional => (behind as f32, depth as f32),
            };
            depth = behind;
        }
    }

    /// One ray. `C` is the number of channels where it is known, else 0.
    #[inline(always)]
    fn sweep<V: Vector, const C: usize>(&mut self, r: usize, channels: usize) {
        let channels = if C > 0 { C } else { channels };
        let range = self.samples.range(r);
        let colour_bar = &self.bar.colour[r * channels..][..channels];
        let background = &self.values.background[r * channels..][..channels];
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
        let mut suffix = f64::from(trans_end) * f64::from(end_bar);
        for piece in (0..range.len().div_ceil(PIECE)).rev() {
            let start = range.start + piece * PIECE;
            let n = PIECE.min(range.end - start);
            let mut up = Upstream { s: [0.0; PIECE], t: [0.0; PIECE], q: [0.0; PIECE] };
            self.upstream::<V, C>(r, start, n, colour_bar, &mut up);
            for q in up.q[..n].iter_mut().rev() {
                let wg = *q;
                *q = suffix as f32;
                suffix += f64::from(wg);
            }
            match self.mixture {
                Mixture::Paper => self.separate::<V>(start, n, &up),
                Mixture::Proportional => self.divided::<V>(start, n, &up),
            }
        }
    }

    /// What reaches the weights of `n` samples from `start` on, and the gradients of their colours and uncertainties.
    #[inline(always)]
    fn upstream<V: Vector, const C: usize>(
        &mut self,
        r: usize,
        start: usize,
        n: usize,
        colour_bar: &[f32],
        up: &mut Upstream,
    ) {
        let channels = if C > 0 { C } else { colour_bar.len() };
        let (end, values) = (start + n, self.values);
        let beta_bar = V::splat(self.bar.beta.map_or(0.0, |x| x[r]));
        let transient_bar = V::splat(self.bar.transient.map_or(0.0, |x| x[r]));
        for i in (start..end).step_by(V::LANES) {
            let w_s = load_part::<V>(&self.forward.w_s[i..end]);
            let w_t = load_part::<V>(&self.forward.w_t[i..end]);
            let mut g_s = load_some::<V>(self.bar.w_s, i, end);
            let mut g_t = load_some::<V>(self.bar.w_t, i, end);
            g_t = load_part::<V>(&values.beta[i..end]).mul_add(beta_bar, g_t + transient_bar);
            store_part(w_t * beta_bar, &mut self.grads.beta[i..end]);
            for (c, &bar) in colour_bar[..channels].iter().enumerate() {
                let bar = V::splat(bar);
                let (s, t) = (c * values.values_s.stride, c * values.values_t.stride);
                g_s = load_part::<V>(&values.values_s.data[s + i..s + end]).mul_add(bar, g_s);
                g_t = load_part::<V>(&values.values_t.data[t + i..t + end]).mul_add(bar, g_t);
                store_part(w_s * bar, &mut self.grads.values_s[s + i..s + end]);
                store_part(w_t * bar, &mut self.grads.values_t[t + i..t + end]);
            }
            // PIECE is a multiple of every vector length: a whole vector fits.
            g_s.store(&mut up.s[i - start..]);
            g_t.store(&mut up.t[i - start..]);
            (w_t * g_t + w_s * g_s).store(&mut up.q[i - start..]);
        }
    }

    /// [`Mixture::Paper`]: the places of the gradients hold `T exp(-tau_s)` and `T exp(-tau_t)`.
    #[inline(always)]
    fn separate<V: Vector>(&mut self, start: usize, n: usize, up: &Upstream) {
        for i in (0..n).step_by(V::LANES) {
            let q = V::load(&up.q[i..]);
            for (out, g) in [(&mut *self.grads.tau_s, &up.s), (&mut *self.grads.tau_t, &up.t)] {
                let out = &mut out[start + i..start + n];
                store_part(load_part::<V>(out) * V::load(&g[i..]) - q, out);
            }
        }
    }

    /// [`Mixture::Proportional`]: the places of the gradients hold the transmittances behind and before each sample.
    #[inline(always)]
    fn divided<V: Vector>(&mut self, start: usize, n: usize, up: &Upstream) {
        for i in (0..n).step_by(V::LANES) {
            let at = start + i..start + n;
            let (g_s, g_t, q) = (V::load(&up.s[i..]), V::load(&up.t[i..]), V::load(&up.q[i..]));
            let tau_s = load_part::<V>(&self.samples.tau_s[at.clone()]);
            let tau_t = load_part::<V>(&self.samples.tau_t[at.clone()]);
            let (tau, s, t) = shares(tau_s, tau_t);
            let behind = load_part::<V>(&self.grads.tau_s[at.clone()]);
            let before = load_part::<V>(&self.grads.tau_t[at.clone()]);
            let mean_opacity = tau.select_positive(-vecmath::exp_m1(-tau) / tau, V::splat(1.0));
            let h = before * mean_opacity * (g_s - g_t);
            let both = behind * (s * g_s + t * g_t) - q;
            store_part(both + h * t, &mut self.grads.tau_s[at.clone()]);
            store_part(both - h * s, &mut self.grads.tau_t[at]);
        }
    }
}
