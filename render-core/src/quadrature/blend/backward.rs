//! Gradients of both optical depths, the shares and the colours, by one sweep from back to front.
//!
//! With `g_s[i]`, `g_d[i]` what reaches `w_s[i]`, `w_d[i]` from all their uses, `g_T[i]` what reaches `T[i]` directly, and
//! `p = m a_d`, `q = (1 - m) a_s`, the whole gradient of a transmittance comes from behind:
//!
//! ```text
//! R[n] = g_end        R[i] = g_T[i] + p g_d + q g_s + (1 - p) (1 - q) R[i + 1]
//! p_bar[i] = T[i] (g_d - (1 - q) R[i + 1])
//! q_bar[i] = T[i] (g_s - (1 - p) R[i + 1])
//! tau_d_bar = p_bar m exp(-tau_d)      tau_s_bar = q_bar (1 - m) exp(-tau_s)
//! m_bar = p_bar a_d - q_bar a_s + D_bar (w_s + w_d)
//! ```

use super::super::lanes::{load_part, load_some, store_part};
use super::super::{Values, check_strided};
use super::{BlendSamples, BlendValues, PIECE, Piece, check};
use float_core::{Simd, Task, Vector};

/// What [`composite_blend`](super::composite_blend) left for the way back.
#[derive(Clone, Copy, Debug)]
pub struct BlendTrans<'a> {
    /// `[n]` transmittance in front of each interval.
    pub trans: &'a [f32],
    /// `[rays]` transmittance to the background.
    pub trans_end: &'a [f32],
}

/// Gradients that reach the outputs of [`composite_blend`](super::composite_blend); `None` where no loss depends on an output.
#[derive(Clone, Copy, Debug)]
pub struct CompositeBlendBar<'a> {
    /// `[rays][channels]`
    pub colour: &'a [f32],
    /// `[rays]`
    pub dynamic: Option<&'a [f32]>,
    /// `[rays]` from other uses of the transmittance to the background.
    pub trans_end: Option<&'a [f32]>,
    /// `[n]` from other uses of the weights.
    pub w_s: Option<&'a [f32]>,
    /// `[n]`
    pub w_d: Option<&'a [f32]>,
    /// `[n]` from other uses of the transmittances in front of the intervals.
    pub trans: Option<&'a [f32]>,
}

/// Where [`composite_blend_backward`] puts its gradients.
#[derive(Debug)]
pub struct CompositeBlendGrads<'a> {
    /// `[n]` **written**; samples that belong to no ray are left alone, here and below.
    pub tau_s: &'a mut [f32],
    /// `[n]` **written**
    pub tau_d: &'a mut [f32],
    /// `[n]` **written**
    pub m: &'a mut [f32],
    /// `[channels][stride]` with the stride of `values_s`, **written** for the samples of the rays.
    pub values_s: &'a mut [f32],
    /// `[channels][stride]` with the stride of `values_d`, **written** for the samples of the rays.
    pub values_d: &'a mut [f32],
    /// `[rays][channels]`, added to.
    pub background: Option<&'a mut [f32]>,
}

/// Gradient of [`composite_blend`](super::composite_blend) with respect to optical depths, shares, colours and background.
///
/// All gradients are **written**, but that of the background, which is added. `samples` and `values` are those of the forward
/// call. A system that must not train its static part, as the second stage of DynamicNeRF, ignores the gradients of that part.
///
/// # Panics
/// When the lengths disagree, or the offsets decrease or run past the samples.
pub fn composite_blend_backward(
    simd: Simd,
    samples: BlendSamples<'_>,
    values: BlendValues<'_>,
    forward: BlendTrans<'_>,
    bar: CompositeBlendBar<'_>,
    grads: CompositeBlendGrads<'_>,
) {
    check(samples, values);
    let (n, rays, channels) = (samples.tau_s.len(), samples.rays(), values.channels());
    let strided = |len, values: Values<'_>, what| check_strided(len, values.stride, channels, n, what);
    strided(grads.values_s.len(), values.values_s, "gradient of the static values");
    strided(grads.values_d.len(), values.values_d, "gradient of the dynamic values");
    assert_eq!(forward.trans.len(), n, "trans and tau_s differ in length");
    assert_eq!(forward.trans_end.len(), rays, "trans_end holds one number a ray");
    assert_eq!(bar.colour.len(), rays * channels, "the gradient of colour holds one value a ray and channel");
    for (bar, what) in [(bar.dynamic, "dynamic"), (bar.trans_end, "trans_end")] {
        assert!(bar.is_none_or(|x| x.len() == rays), "the gradient of {what} holds one number a ray");
    }
    for (bar, what) in [(bar.w_s, "w_s"), (bar.w_d, "w_d"), (bar.trans, "trans")] {
        assert!(bar.is_none_or(|x| x.len() == n), "the gradient of {what} and tau_s differ in length");
    }
    for (grad, what) in [(&grads.tau_s, "tau_s"), (&grads.tau_d, "tau_d"), (&grads.m, "m")] {
        assert_eq!(grad.len(), n, "the gradient of {what} and tau_s differ in length");
    }
    if let Some(b) = &grads.background {
        assert_eq!(b.len(), rays * channels, "the gradient of background holds one value a ray and channel");
    }
    simd.run(BackwardTask { samples, values, forward, bar, grads });
}

struct BackwardTask<'a> {
    samples: BlendSamples<'a>,
    values: BlendValues<'a>,
    forward: BlendTrans<'a>,
    bar: CompositeBlendBar<'a>,
    grads: CompositeBlendGrads<'a>,
}

/// What reaches the weights of one piece from colours and directly.
struct Upstream {
    s: [f32; PIECE],
    d: [f32; PIECE],
}

impl Task for BackwardTask<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(mut self) {
        let (mut piece, mut up) = (Piece::EMPTY, Upstream { s: [0.0; PIECE], d: [0.0; PIECE] });
        for r in 0..self.samples.rays() {
            self.sweep::<V>(r, &mut piece, &mut up);
        }
    }
}

impl BackwardTask<'_> {
    /// One ray.
    #[inline(always)]
    fn sweep<V: Vector>(&mut self, r: usize, piece: &mut Piece, up: &mut Upstream) {
        let channels = self.values.channels();
        let range = self.samples.range(r);
        let colour_bar = &self.bar.colour[r * channels..][..channels];
        let background = &self.values.background[r * channels..][..channels];
        let trans_end = self.forward.trans_end[r];
        let dynamic_bar = f64::from(self.bar.dynamic.map_or(0.0, |x| x[r]));
        let mut behind = f64::from(self.bar.trans_end.map_or(0.0, |x| x[r]));
        for (c, b) in colour_bar.iter().zip(background) {
            behind += f64::from(*c) * f64::from(*b);
        }
        if let Some(out) = self.grads.background.as_deref_mut() {
            for (out, c) in out[r * channels..][..channels].iter_mut().zip(colour_bar) {
                *out += trans_end * c;
            }
        }
        for nth in (0..range.len().div_ceil(PIECE)).rev() {
            let start = range.start + nth * PIECE;
            let end = range.end.min(start + PIECE);
            piece.load::<V>(self.samples, start..end);
            self.upstream::<V>(start, end, colour_bar, up);
            for i in (start..end).rev() {
                let (s, trans) = (piece.at(i - start, self.samples.m[i]), f64::from(self.forward.trans[i]));
                let moves = dynamic_bar * s.m;
                let (g_s, g_d) = (f64::from(up.s[i - start]) + moves, f64::from(up.d[i - start]) + moves);
                let (p, q) = (s.m * s.a_d, s.still * s.a_s);
                let p_bar = trans * (g_d - s.past_s * behind);
                let q_bar = trans * (g_s - s.past_d * behind);
                self.grads.tau_s[i] = (q_bar * s.still * f64::from(piece.pass_s[i - start])) as f32;
                self.grads.tau_d[i] = (p_bar * s.m * f64::from(piece.pass_d[i - start])) as f32;
                self.grads.m[i] = (p_bar * s.a_d - q_bar * s.a_s + dynamic_bar * trans * (p + q)) as f32;
                let own = f64::from(self.bar.trans.map_or(0.0, |x| x[i]));
                behind = own + p * g_d + q * g_s + s.past_s * s.past_d * behind;
                (up.s[i - start], up.d[i - start]) = ((trans * q) as f32, (trans * p) as f32);
            }
            self.through::<V>(start, end, colour_bar, up);
        }
    }

    /// What reaches the weights of the samples `start..end`, but for what moves.
    #[inline(always)]
    fn upstream<V: Vector>(&self, start: usize, end: usize, colour_bar: &[f32], up: &mut Upstream) {
        let BlendValues { values_s, values_d, .. } = self.values;
        for i in (start..end).step_by(V::LANES) {
            let mut g_s = load_some::<V>(self.bar.w_s, i, end);
            let mut g_d = load_some::<V>(self.bar.w_d, i, end);
            for (c, &bar) in colour_bar.iter().enumerate() {
                let (bar, s, d) = (V::splat(bar), c * values_s.stride, c * values_d.stride);
                g_s = load_part::<V>(&values_s.data[s + i..s + end]).mul_add(bar, g_s);
                g_d = load_part::<V>(&values_d.data[d + i..d + end]).mul_add(bar, g_d);
            }
            // PIECE is a multiple of every vector length: a whole vector fits.
            g_s.store(&mut up.s[i - start..]);
            g_d.store(&mut up.d[i - start..]);
        }
    }

    /// Gradients of the colours of the samples `start..end`, whose weights are in `w`.
    #[inline(always)]
    fn through<V: Vector>(&mut self, start: usize, end: usize, colour_bar: &[f32], w: &Upstream) {
        let BlendValues { values_s, values_d, .. } = self.values;
        for i in (start..end).step_by(V::LANES) {
            let (w_s, w_d) = (V::load(&w.s[i - start..]), V::load(&w.d[i - start..]));
            for (c, &bar) in colour_bar.iter().enumerate() {
                let (bar, s, d) = (V::splat(bar), c * values_s.stride, c * values_d.stride);
                store_part(w_s * bar, &mut self.grads.values_s[s + i..s + end]);
                store_part(w_d * bar, &mut self.grads.values_d[d + i..d + end]);
            }
        }
    }
}
