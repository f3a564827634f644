//! Forward pass: every layer of a panel while it lies in the L1 cache.

use super::batch::Forward;
use super::kernel::{Finish, product};
use super::transpose::{panel_from_rows, rows_from_panel};
use super::{Activation, Mlp, PANEL, Packed, reaches};
use float_core::{Simd, Task, Vector};

impl Mlp {
    /// `y = mlp(x)` for `n` samples, keeping the activations that [`Mlp::backward`] needs.
    ///
    /// # Shapes
    /// * `x` `[inputs][x_stride]`, `y` `[outputs][y_stride]` (written), strides `>= n`
    /// * `acts` at least [`Mlp::activations_len`]`(n)` numbers (written; opaque)
    ///
    /// # Panics
    /// Where a buffer is shorter than that, a stride is below `n`, or `packed` was packed for another network or precision.
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
    /// Where a buffer is too short, a stride is below `n`, or `packed` was packed for another network or precision.
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
        assert!(scratch.len() >= self.infer_scratch_len(), "mlp: scratch");
        self.run_forward(simd, packed, x, x_stride, n, y, y_stride, scratch, 0);
    }

    /// What [`Mlp::forward`] keeps of `n` samples, without the forward pass: for networks of one layer without an
    /// activation, where that is the inputs and nothing else.
    ///
    /// # Panics
    /// Where a buffer is too short.
    pub(crate) fn keep_inputs(&self, simd: Simd, x: &[f32], x_stride: usize, n: usize, acts: &mut [f32]) {
        assert!(self.layers.len() == 1 && !self.keeps_outputs(), "mlp: more to keep than inputs");
        let (inputs, inputs_pad) = (self.inputs(), self.layers[0].inputs_pad);
        for (p, s0) in (0..n).step_by(PANEL).enumerate() {
            let panel = &mut acts[p * self.panel_len..][..PANEL * inputs_pad];
            panel_from_rows(simd, &x[s0..], x_stride, inputs, PANEL.min(n - s0), panel, inputs_pad, inputs_pad);
            self.round(panel);
        }
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
        assert!(packed.precision == self.precision, "mlp: parameters packed for another precision");
        assert!(x_stride >= n && reaches(self.inputs(), x_stride, n, x.len()), "mlp: x");
        assert!(y_stride >= n && reaches(self.outputs(), y_stride, n, y.len()), "mlp: y");
        let (acts, last) = acts.split_at_mut(acts.len() - self.output_panel_len());
        let task = Forward { mlp: self, simd, packed, x, x_stride, n, y, y_stride, acts, acts_step, last };
        #[cfg(target_arch = "x86_64")]
        if let Some(bf16) = self.pairs(simd) {
            return super::bf16::pass::forward(bf16, task);
        }
        simd.run(task);
    }
}

impl Task for Forward<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        let layers = self.mlp.layers();
        let (simd, inputs) = (self.simd, layers[0].inputs);
        for (p, s0) in (0..self.n).step_by(PANEL).enumerate() {
            let count = PANEL.min(self.n - s0);
            let acts = &mut self.acts[p * self.acts_step..][..self.mlp.panel_len];
            let x = &self.x[s0..];
            let first = layers[0].inputs_pad;
            panel_from_rows(simd, x, self.x_stride, inputs, count, &mut acts[..PANEL * first], first, first);
            self.mlp.round(&mut acts[..PANEL * first]);
            for (i, l) in layers.iter().enumerate() {
                let (before, after) = acts.split_at_mut(l.panel + PANEL * l.inputs_pad);
                let input = &before[l.panel..];
                let (out, stride) = match layers.get(i + 1) {
                    Some(next) => {
                        let (stride, skip) = (next.inputs_pad, next.skip_inputs);
                        if skip > 0 {
                            let panel = &mut after[..PANEL * stride];
                            panel_from_rows(simd, x, self.x_stride, inputs, count, panel, stride, stride);
                        }
                        (&mut after[skip..PANEL * stride], stride)
                    }
                    None => (&mut self.last[..], l.outputs_pad),
                };
                let weights = &self.packed.forward[l.forward..][..l.inputs * l.outputs_pad];
                let bias = &self.packed.forward[l.forward + l.inputs * l.outputs_pad..][..l.outputs_pad];
                let relu = l.activation == Activation::Relu;
                let finish = if relu { Finish::Relu } else { Finish::Keep };
                product::<V>(
                    input,
                    l.inputs_pad,
                    l.inputs,
                    weights,
                    l.outputs_pad,
                    Some(bias),
                    finish,
                    out,
                    stride,
                    l.outputs_pad,
                );
                // The last layer's activation waits until lanes are samples: then padding costs nothing.
                if !relu && l.activation != Activation::None && i + 1 < layers.len() {
                    for row in out.chunks_mut(stride).take(PANEL) {
                        l.activation.apply::<V>(&mut row[..l.outputs_pad]);
                    }
                }
                if i + 1 < layers.len() {
                    self.mlp.round(&mut after[..PANEL * stride]);
                }
            }
            let l = &layers[layers.len() - 1];
            let y = &mut self.y[s0..];
            if self.mlp.keeps_outputs() {
                let kept = &mut acts[l.panel + PANEL * l.inputs_pad..][..PANEL * l.outputs];
                rows_from_panel::<false>(simd, self.last, l.outputs_pad, l.outputs, kept, PANEL, PANEL);
                if l.activation != Activation::Relu {
                    l.activation.apply::<V>(kept);
                }
                for (o, row) in kept.chunks_exact(PANEL).enumerate() {
                    y[o * self.y_stride..][..count].copy_from_slice(&row[..count]);
                }
            } else {
                rows_from_panel::<false>(simd, self.last, l.outputs_pad, l.outputs, y, self.y_stride, count);
            }
        }
    }
}
