//! Backward pass: input gradients and weight gradients of a panel, last layer to first.

use super::kernel::{outer_product, panel_from_rows, product, rows_from_panel};
use super::{Mlp, PANEL, Packed};
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
    /// Where a buffer is shorter than that.
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
        assert!(acts.len() >= self.activations_len(n), "mlp: activations");
        assert!(y_stride >= n && y_bar.len() >= (self.outputs() - 1) * y_stride + n, "mlp: y_bar");
        assert_eq!(grad.len(), self.grad_len, "mlp: packed gradient");
        assert!(scratch.len() >= self.backward_scratch_len(), "mlp: scratch");
        if let Some((x_bar, stride)) = &x_bar {
            assert!(*stride >= n && x_bar.len() >= (self.inputs() - 1) * stride + n, "mlp: x_bar");
        }
        simd.run(Backward { mlp: self, packed: &packed.backward, acts, y_bar, y_stride, n, x_bar, grad, scratch });
    }
}

struct Backward<'a> {
    mlp: &'a Mlp,
    packed: &'a [f32],
    acts: &'a [f32],
    y_bar: &'a [f32],
    y_stride: usize,
    n: usize,
    x_bar: Option<(&'a mut [f32], usize)>,
    grad: &'a mut [f32],
    scratch: &'a mut [f32],
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
            // Samples past `count` get gradient 0, so they add nothing anywhere below.
            let mut y_column = 0;
            let mut y_stride = last.outputs_pad;
            let panel = &mut y_bar[..PANEL * y_stride];
            panel_from_rows(self.y_bar, self.y_stride, last.outputs, s0, count, panel, y_stride, 0, y_stride);
            let mut out = &acts[last.panel + PANEL * last.inputs_pad..];
            for (i, l) in layers.iter().enumerate().rev() {
                // `y_bar` and `out` hold the layer's output at `y_column` of rows of `y_stride`.
                for s in 0..PANEL {
                    let row = s * y_stride + y_column;
                    let bar = &mut y_bar[row..row + l.outputs_pad];
                    // Padding holds what the product left there: it must not count.
                    bar[l.outputs..].fill(0.0);
                    l.activation.apply_backward::<V>(&out[row..row + l.outputs_pad], bar);
                }
                let input = &acts[l.panel..l.panel + PANEL * l.inputs_pad];
                let grad = &mut self.grad[l.grad..];
                let bars = Strided { data: &y_bar[y_column..], stride: y_stride };
                weight_gradient::<V>(&bars, l.outputs, l.outputs_pad, input, l.inputs_pad, grad);
                let skipped = l.skip_inputs > 0 && self.x_bar.is_some();
                if i > 0 || self.x_bar.is_some() {
                    let weights = &self.packed[l.backward..][..l.outputs * l.inputs_pad];
                    let out = &mut x_bar[..PANEL * l.inputs_pad];
                    product_strided::<V>(&bars, l.outputs, weights, l.inputs_pad, out);
                }
                if let Some((bar, stride)) = self.x_bar.as_mut().filter(|_| i == 0 || skipped) {
                    let rows = layers[0].inputs;
                    rows_from_panel::<true>(x_bar, l.inputs_pad, 0, rows, bar, *stride, s0, count);
                }
                core::mem::swap(&mut y_bar, &mut x_bar);
                (out, y_stride, y_column) = (input, l.inputs_pad, l.skip_inputs);
            }
        }
    }
}

/// Rows that begin inside wider rows.
struct Strided<'a> {
    data: &'a [f32],
    stride: usize,
}

#[inline(always)]
fn product_strided<V: Vector>(bars: &Strided<'_>, outputs: usize, w: &[f32], width: usize, x_bar: &mut [f32]) {
    product::<V>(bars.data, bars.stride, outputs, w, width, None, x_bar, width, width);
}

#[inline(always)]
fn weight_gradient<V: Vector>(
    bars: &Strided<'_>,
    outputs: usize,
    outputs_pad: usize,
    input: &[f32],
    width: usize,
    grad: &mut [f32],
) {
    outer_product::<V>(bars.data, bars.stride, outputs, input, width, width, grad, width);
    let bias = &mut grad[outputs_pad * width..][..outputs];
    for s in 0..PANEL {
        for (g, b) in bias.iter_mut().zip(&bars.data[s * bars.stride..]) {
            *g += b;
        }
    }
}
