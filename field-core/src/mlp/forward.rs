//! Forward pass: every layer of a panel while it lies in the L1 cache.

use super::kernel::{panel_from_rows, product, rows_from_panel};
use super::{Mlp, PANEL, Packed};
use float_core::{Simd, Task, Vector};

impl Mlp {
    /// `y = mlp(x)` for `n` samples, keeping the activations that [`Mlp::backward`] needs.
    ///
    /// # Shapes
    /// * `x` `[inputs][x_stride]`, `y` `[outputs][y_stride]` (written), strides `>= n`
    /// * `acts` at least [`Mlp::activations_len`]`(n)` numbers (written; opaque)
    ///
    /// # Panics
    /// Where a buffer is shorter than that.
    #[expect(clippy::too_many_arguments, reason = "two matrices with strides")]
    pub fn forward(
        &self,
        simd: Simd,
        packed: &Packed,
        x: &[f32],
        x_stride: usize,
        n: usize,
        y: &mut [f32],
        y_stride: usize,
        acts: &mut [f32],
    ) {
        assert!(acts.len() >= self.activations_len(n), "mlp: activations");
        self.run_forward(simd, packed, x, x_stride, n, y, y_stride, acts, self.panel_len);
    }

    /// [`Mlp::forward`] that keeps nothing: `scratch` holds [`Mlp::infer_scratch_len`] numbers, whatever `n`.
    ///
    /// # Panics
    /// Where a buffer is too short.
    #[expect(clippy::too_many_arguments, reason = "two matrices with strides")]
    pub fn infer(
        &self,
        simd: Simd,
        packed: &Packed,
        x: &[f32],
        x_stride: usize,
        n: usize,
        y: &mut [f32],
        y_stride: usize,
        scratch: &mut [f32],
    ) {
        assert!(scratch.len() >= self.panel_len, "mlp: scratch");
        self.run_forward(simd, packed, x, x_stride, n, y, y_stride, scratch, 0);
    }

    #[expect(clippy::too_many_arguments, reason = "two matrices with strides")]
    fn run_forward(
        &self,
        simd: Simd,
        packed: &Packed,
        x: &[f32],
        x_stride: usize,
        n: usize,
        y: &mut [f32],
        y_stride: usize,
        acts: &mut [f32],
        acts_step: usize,
    ) {
        if n == 0 {
            return;
        }
        assert_eq!(packed.forward.len(), self.forward_len, "mlp: packed parameters of another network");
        assert!(x_stride >= n && x.len() >= (self.inputs() - 1) * x_stride + n, "mlp: x");
        assert!(y_stride >= n && y.len() >= (self.outputs() - 1) * y_stride + n, "mlp: y");
        simd.run(Forward { mlp: self, packed: &packed.forward, x, x_stride, n, y, y_stride, acts, acts_step });
    }
}

struct Forward<'a> {
    mlp: &'a Mlp,
    packed: &'a [f32],
    x: &'a [f32],
    x_stride: usize,
    n: usize,
    y: &'a mut [f32],
    y_stride: usize,
    acts: &'a mut [f32],
    /// From one panel's activations to the next: 0 to use the same ones over again.
    acts_step: usize,
}

impl Task for Forward<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        let layers = self.mlp.layers();
        for (p, s0) in (0..self.n).step_by(PANEL).enumerate() {
            let count = PANEL.min(self.n - s0);
            let acts = &mut self.acts[p * self.acts_step..][..self.mlp.panel_len];
            let first = &layers[0];
            let panel = &mut acts[..PANEL * first.inputs_pad];
            panel_from_rows(
                self.x,
                self.x_stride,
                first.inputs,
                s0,
                count,
                panel,
                first.inputs_pad,
                0,
                first.inputs_pad,
            );
            for (i, l) in layers.iter().enumerate() {
                let (before, after) = acts.split_at_mut(l.panel + PANEL * l.inputs_pad);
                let input = &before[l.panel..];
                let (out, out_stride) = match layers.get(i + 1) {
                    Some(next) => {
                        if next.skip_inputs > 0 {
                            let panel = &mut after[..PANEL * next.inputs_pad];
                            panel_from_rows(
                                self.x,
                                self.x_stride,
                                first.inputs,
                                s0,
                                count,
                                panel,
                                next.inputs_pad,
                                0,
                                next.inputs_pad,
                            );
                        }
                        (&mut after[next.skip_inputs..], next.inputs_pad)
                    }
                    None => (&mut after[..], l.outputs_pad),
                };
                let weights = &self.packed[l.forward..][..l.inputs * l.outputs_pad];
                let bias = &self.packed[l.forward + l.inputs * l.outputs_pad..][..l.outputs_pad];
                dense::<V>(input, l.inputs_pad, l.inputs, weights, l.outputs_pad, bias, out, out_stride);
                for row in out.chunks_mut(out_stride).take(PANEL) {
                    l.activation.apply::<V>(&mut row[..l.outputs_pad]);
                }
            }
            let last = &layers[layers.len() - 1];
            let panel = &acts[last.panel + PANEL * last.inputs_pad..];
            rows_from_panel::<false>(panel, last.outputs_pad, 0, last.outputs, self.y, self.y_stride, s0, count);
        }
    }
}

/// One layer of a panel. The output may begin inside a wider row (behind skipped inputs): its last row is shorter then.
#[inline(always)]
#[expect(clippy::too_many_arguments, reason = "three matrices with strides")]
fn dense<V: Vector>(
    x: &[f32],
    xs: usize,
    inputs: usize,
    w: &[f32],
    width: usize,
    bias: &[f32],
    y: &mut [f32],
    ys: usize,
) {
    product::<V>(x, xs, inputs, w, width, Some(bias), y, ys, width);
}
