//! Forward and backward pass over panels of bf16, on a CPU with `vdpbf16ps`. Step by step what [`super::super::forward`] and
//! [`super::super::backward`] do; panels lie at the same places of the activations and fill half of them.

use super::avx512::{Out, column_sums, interleave, outer_product, product, round_panel, widen};
use super::pairs_len;
use crate::mlp::batch::{Backward, Forward};
use crate::mlp::transpose::{panel_from_rows, rows_from_panel};
use crate::mlp::{Activation, Layer, PANEL};
use float_core::{Bf16, Simd, Task, Vector};

/// The memory of f32 numbers as twice as many of 16 bits.
fn halves(x: &mut [f32]) -> &mut [u16] {
    // SAFETY: the same bytes, whose alignment suffices for `u16`; every bit pattern is valid in both types.
    unsafe { core::slice::from_raw_parts_mut(x.as_mut_ptr().cast(), 2 * x.len()) }
}

/// [`halves`] for reading.
fn halves_of(x: &[f32]) -> &[u16] {
    // SAFETY: as in `halves`.
    unsafe { core::slice::from_raw_parts(x.as_ptr().cast(), 2 * x.len()) }
}

/// An activation on whole vectors.
struct Apply<'a>(Activation, &'a mut [f32]);

impl Task for Apply<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        self.0.apply::<V>(self.1);
    }
}

/// The derivative of an activation at outputs `.1`, on gradients `.2`.
struct ApplyBackward<'a>(Activation, &'a [f32], &'a mut [f32]);

impl Task for ApplyBackward<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        self.0.apply_backward::<V>(self.1, self.2);
    }
}

/// The forward pass; `_bf16` proves that the CPU can.
pub(in crate::mlp) fn forward(_bf16: Bf16, task: Forward<'_>) {
    // SAFETY: the token proves the features.
    unsafe { forward_panels(task) }
}

/// The backward pass.
pub(in crate::mlp) fn backward(_bf16: Bf16, task: Backward<'_>) {
    // SAFETY: the token proves the features.
    unsafe { backward_panels(task) }
}

#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx512bf16")]
fn forward_panels(task: Forward<'_>) {
    let Forward { mlp, simd, packed, x, x_stride, n, y, y_stride, acts, acts_step, last } = task;
    let layers = mlp.layers();
    let inputs = layers[0].inputs;
    for (p, s0) in (0..n).step_by(PANEL).enumerate() {
        let count = PANEL.min(n - s0);
        let acts = &mut acts[p * acts_step..][..mlp.panel_len];
        let (x, first) = (&x[s0..], layers[0].inputs_pad);
        panel_from_rows(simd, x, x_stride, inputs, count, last, first, first);
        round_panel(last, first, first, halves(&mut acts[..PANEL * first]), first);
        let mut weights = &packed.forward_pairs[..];
        for (i, l) in layers.iter().enumerate() {
            let (before, after) = acts.split_at_mut(l.panel + PANEL * l.inputs_pad);
            let input = halves_of(&before[l.panel..]);
            let (w, rest) = weights.split_at(pairs_len(l.inputs, l.outputs_pad));
            weights = rest;
            let bias = Some(&packed.forward[l.forward + l.inputs * l.outputs_pad..][..l.outputs_pad]);
            let Some(next) = layers.get(i + 1) else {
                product(input, l.inputs_pad, l.inputs, w, l.outputs_pad, bias, Out::F32(last), l.outputs_pad);
                continue;
            };
            let (stride, skip) = (next.inputs_pad, next.skip_inputs);
            let out = &mut halves(&mut after[..PANEL * stride])[..PANEL * stride];
            if skip > 0 {
                panel_from_rows(simd, x, x_stride, inputs, count, last, stride, stride);
                round_panel(last, stride, stride, out, stride);
            }
            let out = &mut out[skip..];
            match l.activation {
                Activation::None => {
                    product(input, l.inputs_pad, l.inputs, w, l.outputs_pad, bias, Out::Keep(out), stride);
                }
                Activation::Relu => {
                    product(input, l.inputs_pad, l.inputs, w, l.outputs_pad, bias, Out::Relu(out), stride);
                }
                other => {
                    let panel = &mut last[..PANEL * l.outputs_pad];
                    product(input, l.inputs_pad, l.inputs, w, l.outputs_pad, bias, Out::F32(panel), l.outputs_pad);
                    simd.run(Apply(other, panel));
                    round_panel(panel, l.outputs_pad, l.outputs_pad, out, stride);
                }
            }
        }
        let l = &layers[layers.len() - 1];
        let y = &mut y[s0..];
        if mlp.keeps_outputs() {
            let kept = &mut acts[l.panel + PANEL * l.inputs_pad..][..PANEL * l.outputs];
            rows_from_panel::<false>(simd, last, l.outputs_pad, l.outputs, kept, PANEL, PANEL);
            simd.run(Apply(l.activation, kept));
            for (o, row) in kept.chunks_exact(PANEL).enumerate() {
                y[o * y_stride..][..count].copy_from_slice(&row[..count]);
            }
        } else {
            rows_from_panel::<false>(simd, last, l.outputs_pad, l.outputs, y, y_stride, count);
        }
    }
}

#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx512bf16")]
fn backward_panels(task: Backward<'_>) {
    let Backward { mlp, simd, packed, acts, y_bar, y_stride, n, mut x_bar, grad, scratch } = task;
    let layers = mlp.layers();
    let last = &layers[layers.len() - 1];
    // An f32 panel with room for the outputs' gradient, two panels of gradients, and pairs of samples of a gradient and an
    // input.
    let (panel, rest) = scratch.split_at_mut(PANEL * (mlp.widest + last.outputs_pad));
    let rest = halves(rest);
    let (mut bars, rest) = rest.split_at_mut((PANEL + 1) * mlp.widest);
    let (mut below, rest) = rest.split_at_mut((PANEL + 1) * mlp.widest);
    let (bar_pairs, input_pairs) = rest.split_at_mut(PANEL * mlp.widest);
    for (p, s0) in (0..n).step_by(PANEL).enumerate() {
        let count = PANEL.min(n - s0);
        let acts = &acts[p * mlp.panel_len..][..mlp.panel_len];
        let (mut column, mut stride) = (0, last.outputs_pad);
        let rows = &y_bar[s0..];
        if mlp.keeps_outputs() {
            let kept = &acts[last.panel + PANEL * last.inputs_pad..][..PANEL * last.outputs];
            let (turned, bars) = panel.split_at_mut(PANEL * stride);
            let bars = &mut bars[..kept.len()];
            for (o, bar) in bars.chunks_exact_mut(PANEL).enumerate() {
                bar[..count].copy_from_slice(&rows[o * y_stride..][..count]);
                bar[count..].fill(0.0);
            }
            simd.run(ApplyBackward(last.activation, kept, bars));
            panel_from_rows(simd, bars, PANEL, last.outputs, PANEL, turned, stride, stride);
        } else {
            panel_from_rows(simd, rows, y_stride, last.outputs, count, panel, stride, stride);
        }
        round_panel(panel, stride, stride, bars, stride);
        let mut weights = packed.backward_pairs.len();
        for (i, l) in layers.iter().enumerate().rev() {
            let input = &halves_of(&acts[l.panel..][..PANEL * l.inputs_pad])[..PANEL * l.inputs_pad];
            let from = &bars[column..];
            let (grad, bias) = grad[l.grad..].split_at_mut(l.outputs_pad * l.inputs_pad);
            interleave(from, stride, l.outputs_pad, bar_pairs);
            interleave(input, l.inputs_pad, l.inputs_pad, input_pairs);
            outer_product(bar_pairs, l.outputs_pad, l.outputs, input_pairs, l.inputs_pad, grad);
            if !l.biases.is_empty() {
                column_sums(bar_pairs, l.outputs_pad, bias);
            }
            weights -= pairs_len(l.outputs, l.inputs_pad);
            if i == 0 && x_bar.is_none() {
                break;
            }
            let w = &packed.backward_pairs[weights..];
            let width = l.inputs_pad;
            let fused = match i.checked_sub(1).map(|i| layers[i].activation) {
                Some(Activation::Relu) if l.skip_inputs == 0 => Some(Out::Gate(below, input)),
                Some(Activation::None) if l.skip_inputs == 0 => Some(Out::Keep(below)),
                _ => None,
            };
            if let Some(out) = fused {
                product(from, stride, l.outputs, w, width, None, out, width);
            } else {
                product(from, stride, l.outputs, w, width, None, Out::F32(panel), width);
                if let Some((out, out_stride)) = x_bar.as_mut().filter(|_| i == 0 || l.skip_inputs > 0) {
                    rows_from_panel::<true>(simd, panel, width, layers[0].inputs, &mut out[s0..], *out_stride, count);
                }
                if i > 0 {
                    derivative(simd, &layers[i - 1], input, panel, width, l.skip_inputs);
                    round_panel(panel, width, width, below, width);
                }
            }
            core::mem::swap(&mut bars, &mut below);
            (column, stride) = (l.skip_inputs, width);
        }
    }
}

/// Bring a gradient panel through a layer's activation: the layer's outputs lie in `y`, at `column` of rows of `stride`,
/// their gradients at the same places of `bar`.
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx512bf16")]
fn derivative(simd: Simd, layer: &Layer, y: &[u16], bar: &mut [f32], stride: usize, column: usize) {
    let mut wide = [0.0; 64];
    for s in 0..PANEL {
        let row = s * stride + column..s * stride + column + layer.outputs_pad;
        for (y, bar) in y[row.clone()].chunks(64).zip(bar[row].chunks_mut(64)) {
            let wide = &mut wide[..y.len()];
            widen(y, wide);
            simd.run(ApplyBackward(layer.activation, wide, bar));
        }
    }
}
