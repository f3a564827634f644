//! Backward pass: input gradients and weight gradients of a panel, last layer to first.

use super::batch::Backward;
use super::kernel::{Finish, column_sums, outer_product, product};
use super::transpose::{panel_from_rows, rows_from_panel};
use super::{Activation, Layer, Mlp, PANEL, Packed, reaches};
use float_core::{Simd, Task, Vector};

impl Mlp {
    /// Gradients of the batch that [`Mlp::forward`] saw.
    ///
    /// # Shapes
    /// * `acts` as [`Mlp::forward`] left them
    /// * `y_bar` `[outputs][y_stride]`, gradient of the loss with respect to the output
    /// * `x_bar` `[inputs][stride]` with its stride: **added** to; `None` skips the first layer's input gradient
    /// * `grad` [`Mlp::packed_grad_len`] numbers, **added** to: see [`Mlp::unpack_grad`]
    /// * `scratch` [`Mlp::backward_scratch_len`] numbers
    ///
    /// # Panics
    /// Where a buffer is shorter than that, `grad` is longer, a stride is below `n`, or `packed` was packed for another network
    /// or precision.
    #[expect(clippy::too_many_arguments, reason = "two matrices with strides")]
    pub fn backward(
        &self,
        simd: Simd,
        packed: &Packed,
        acts: &[f32],
        y_bar: &[f32],
        y_stride: usize,
        n: usize,
        x_bar: Option<(&mut [f32], usize)>,
        grad: &mut [f32],
        scratch: &mut [f32],
    ) {
        if n == 0 {
            return;
        }
        assert_eq!(packed.backward.len(), self.backward_len, "mlp: packed parameters of another network");
        assert!(packed.precision == self.precision, "mlp: parameters packed for another precision");
        assert!(acts.len() >= self.activations_len(n), "mlp: activations");
        assert!(y_stride >= n && reaches(self.outputs(), y_stride, n, y_bar.len()), "mlp: y_bar");
        assert_eq!(grad.len(), self.grad_len, "mlp: packed gradient");
        assert!(scratch.len() >= self.backward_scratch_len(), "mlp: scratch");
        if let Some((x_bar, stride)) = &x_bar {
            assert!(*stride >= n && reaches(self.inputs(), *stride, n, x_bar.len()), "mlp: x_bar");
        }
        let task = Backward { mlp: self, simd, packed, acts, y_bar, y_stride, n, x_bar, grad, scratch };
        #[cfg(target_arch = "x86_64")]
        if let Some(bf16) = self.pairs(simd) {
            return super::bf16::pass::backward(bf16, task);
        }
        simd.run(task);
    }
}

impl Task for Backward<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(mut self) {
        let layers = self.mlp.layers();
        let last = &layers[layers.len() - 1];
        let (mut y_bar, mut x_bar) = self.scratch.split_at_mut((PANEL + 1) * self.mlp.widest);
        for (p, s0) in (0..self.n).step_by(PANEL).enumerate() {
            let count = PANEL.min(self.n - s0);
            let acts = &self.acts[p * self.mlp.panel_len..][..self.mlp.panel_len];
            // `y_bar` holds the gradient of a layer's output at `column` of rows of `stride`. Samples past `count` have
            // gradient 0, so they add nothing anywhere.
            let (mut column, mut stride) = (0, last.outputs_pad);
            let rows = &self.y_bar[s0..];
            if self.mlp.keeps_outputs() {
                let bars = &mut x_bar[..PANEL * last.outputs];
                let kept = &acts[last.panel + PANEL * last.inputs_pad..][..bars.len()];
                for (o, bar) in bars.chunks_exact_mut(PANEL).enumerate() {
                    bar[..count].copy_from_slice(&rows[o * self.y_stride..][..count]);
                    bar[count..].fill(0.0);
                }
                last.activation.apply_backward::<V>(kept, bars);
                panel_from_rows(self.simd, bars, PANEL, last.outputs, PANEL, y_bar, stride, stride);
            } else {
                panel_from_rows(self.simd, rows, self.y_stride, last.outputs, count, y_bar, stride, stride);
            }
            self.mlp.round(&mut y_bar[..PANEL * stride]);
            for (i, l) in layers.iter().enumerate().rev() {
                let input = &acts[l.panel..l.panel + PANEL * l.inputs_pad];
                let bars = &y_bar[column..];
                let (grad, bias) = self.grad[l.grad..].split_at_mut(l.outputs_pad * l.inputs_pad);
                outer_product::<V>(bars, stride, l.outputs, input, l.inputs_pad, l.inputs_pad, grad, l.inputs_pad);
                if !l.biases.is_empty() {
                    column_sums::<V>(bars, stride, l.outputs_pad, &mut bias[..l.outputs_pad]);
                }
                if i == 0 && self.x_bar.is_none() {
                    break;
                }
                // The derivative of what came before: in registers where it can be.
                let before = i.checked_sub(1).map(|i| &layers[i]);
                let gated = before.is_some_and(|b| b.activation == Activation::Relu) && l.skip_inputs == 0;
                let finish = if gated { Finish::Gate(input) } else { Finish::Keep };
                let weights = &self.packed.backward[l.backward..][..l.outputs * l.inputs_pad];
                product::<V>(
                    bars,
                    stride,
                    l.outputs,
                    weights,
                    l.inputs_pad,
                    None,
                    finish,
                    x_bar,
                    l.inputs_pad,
                    l.inputs_pad,
                );
                if let Some((out, out_stride)) = self.x_bar.as_mut().filter(|_| i == 0 || l.skip_inputs > 0) {
                    let rows = layers[0].inputs;
                    rows_from_panel::<true>(self.simd, x_bar, l.inputs_pad, rows, &mut out[s0..], *out_stride, count);
                }
                if let Some(before) = before.filter(|_| !gated) {
                    derivative::<V>(before, input, x_bar, l.inputs_pad, l.skip_inputs);
                }
                self.mlp.round(&mut x_bar[..PANEL * l.inputs_pad]);
                core::mem::swap(&mut y_bar, &mut x_bar);
                (column, stride) = (l.skip_inputs, l.inputs_pad);
            }
        }
    }
}

/// Bring a gradient panel through a layer's activation: the layer's outputs lie in `y`, at `column` of rows of `stride`,
/// their gradients at the same places of `bar`.
#[inline(always)]
fn derivative<V: Vector>(layer: &Layer, y: &[f32], bar: &mut [f32], stride: usize, column: usize) {
    for s in 0..PANEL {
        let row = s * stride + column..s * stride + column + layer.outputs_pad;
        layer.activation.apply_backward::<V>(&y[row.clone()], &mut bar[row]);
    }
}
