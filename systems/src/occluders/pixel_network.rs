//! A small network over the pixels of photos, with its optimiser: part of all models in image space.

use engine::system::{SystemError, Tensor, TensorMap, f32_tensor, push_adam, take_adam, take_numbers};
use field_core::init::Init;
use field_core::mlp::{Mlp, Packed};
use field_core::rng::Rng;
use float_core::Simd;
use optim::{Adam, AdamConfig};
use rayon::prelude::*;
use std::ops::Range;

/// Pixels of one task: fixed, so that sums do not depend on the number of threads.
const TASK: usize = 1024;

/// Network, parameters, moments of Adam.
pub(crate) struct PixelNetwork {
    name: &'static str,
    pub(crate) mlp: Mlp,
    pub(crate) params: Vec<f32>,
    packed: Packed,
    adam: Adam,
    /// The parameters' gradient, and one for each task of a batch.
    grad: Vec<f32>,
    tasks: Vec<Task>,
    n: usize,
}

/// Buffers of a task.
#[derive(Default)]
struct Task {
    x: Vec<f32>,
    x_bar: Vec<f32>,
    y: Vec<f32>,
    y_bar: Vec<f32>,
    acts: Vec<f32>,
    scratch: Vec<f32>,
    grad: Vec<f32>,
}

impl PixelNetwork {
    /// Glorot-uniform weights, zero biases.
    pub(crate) fn new(name: &'static str, mlp: Mlp, rng: Rng) -> Self {
        let mut params = vec![0.0; mlp.param_count()];
        for (i, l) in mlp.layers().iter().enumerate() {
            let weights = &mut params[l.weights.clone()];
            Init::XavierUniform.fill(rng.substream(i as u64), l.inputs, l.outputs, weights);
        }
        let mut net = Self {
            name,
            packed: Packed::default(),
            adam: Adam::new(params.len(), AdamConfig::DEFAULT),
            grad: vec![0.0; params.len()],
            tasks: Vec::new(),
            n: 0,
            mlp,
            params,
        };
        net.pack();
        net
    }

    /// Name in a checkpoint.
    pub(crate) fn name(&self) -> &'static str {
        self.name
    }

    /// Its layers, for messages: `60 -> 64 -> 5`.
    pub(crate) fn shape(&self) -> String {
        let widths = self.mlp.layers().iter().map(|layer| format!(" -> {}", layer.outputs));
        format!("{}{}", self.mlp.inputs(), widths.collect::<String>())
    }

    /// Take these parameters, with a new optimiser.
    ///
    /// # Panics
    /// Unless there are as many of them as before.
    pub(crate) fn begin_with(&mut self, params: Vec<f32>) {
        assert_eq!(params.len(), self.params.len(), "{}", self.name);
        self.params = params;
        self.adam = Adam::new(self.params.len(), AdamConfig::DEFAULT);
        self.pack();
    }

    /// Pack the parameters for the kernels.
    pub(crate) fn pack(&mut self) {
        self.mlp.pack(&self.params, &mut self.packed);
    }

    /// Evaluate at `n` pixels: `fill(pixels, x)` writes `[inputs][pixels of the task]`, `take(pixels, y)` reads
    /// `[outputs][pixels of the task]`, in order. Keeps what [`PixelNetwork::backward`] needs.
    pub(crate) fn forward(
        &mut self,
        simd: Simd,
        n: usize,
        fill: impl Fn(Range<usize>, &mut [f32]) + Sync,
        mut take: impl FnMut(Range<usize>, &[f32]),
    ) {
        self.n = n;
        let count = n.div_ceil(TASK);
        if self.tasks.len() < count {
            self.tasks.resize_with(count, Task::default);
        }
        let (mlp, packed) = (&self.mlp, &self.packed);
        self.tasks[..count].par_iter_mut().enumerate().for_each(|(i, task)| {
            let span = i * TASK..((i + 1) * TASK).min(n);
            let len = span.len();
            task.x.resize(mlp.inputs() * len, 0.0);
            task.y.resize(mlp.outputs() * len, 0.0);
            task.acts.resize(mlp.activations_len(len), 0.0);
            fill(span, &mut task.x);
            mlp.forward(simd, packed, &task.x, len, len, &mut task.y, len, &mut task.acts);
        });
        for (i, task) in self.tasks[..count].iter().enumerate() {
            take(i * TASK..((i + 1) * TASK).min(n), &task.y);
        }
    }

    /// Gradients of the pixels of [`PixelNetwork::forward`]: `fill(pixels, y_bar)` writes `[outputs][pixels of the task]`,
    /// `take(pixels, x_bar)` reads `[inputs][pixels of the task]`, in order. The parameters' gradient is summed in order.
    pub(crate) fn backward(
        &mut self,
        simd: Simd,
        fill: impl Fn(Range<usize>, &mut [f32]) + Sync,
        mut take: impl FnMut(Range<usize>, &[f32]),
    ) {
        let (n, count) = (self.n, self.n.div_ceil(TASK));
        let (mlp, packed) = (&self.mlp, &self.packed);
        self.tasks[..count].par_iter_mut().enumerate().for_each(|(i, task)| {
            let span = i * TASK..((i + 1) * TASK).min(n);
            let len = span.len();
            task.y_bar.resize(mlp.outputs() * len, 0.0);
            task.x_bar.clear();
            task.x_bar.resize(mlp.inputs() * len, 0.0);
            task.scratch.resize(mlp.backward_scratch_len(), 0.0);
            task.grad.clear();
            task.grad.resize(mlp.packed_grad_len(), 0.0);
            fill(span, &mut task.y_bar);
            let x_bar = Some((&mut task.x_bar[..], len));
            let Task { y_bar, acts, grad, scratch, .. } = task;
            mlp.backward(simd, packed, acts, y_bar, len, len, x_bar, grad, scratch);
        });
        let mut sum = vec![0.0; self.mlp.packed_grad_len()];
        for (i, task) in self.tasks[..count].iter().enumerate() {
            sum.iter_mut().zip(&task.grad).for_each(|(sum, g)| *sum += g);
            take(i * TASK..((i + 1) * TASK).min(n), &task.x_bar);
        }
        self.grad.fill(0.0);
        self.mlp.unpack_grad(&sum, &mut self.grad);
    }

    /// Gradient of the parameters, as [`PixelNetwork::backward`] left it: other terms may add to it.
    pub(crate) fn grad_mut(&mut self) -> &mut [f32] {
        &mut self.grad
    }

    /// Adam on that gradient. Returns the count of non-finite gradients.
    pub(crate) fn step(&mut self, simd: Simd, lr: f64) -> usize {
        let bad = self.adam.step(simd, lr, &mut self.params, &self.grad);
        self.pack();
        bad
    }

    /// Evaluate at `n` pixels from many threads, keeping nothing: `[outputs]` of each pixel, one after the other.
    pub(crate) fn infer(&self, simd: Simd, n: usize, fill: impl Fn(Range<usize>, &mut [f32]) + Sync) -> Vec<f32> {
        let mut out = vec![0.0; n * self.mlp.outputs()];
        let outputs = self.mlp.outputs();
        out.par_chunks_mut(TASK * outputs).enumerate().for_each(|(i, out)| {
            let span = i * TASK..((i + 1) * TASK).min(n);
            let len = span.len();
            let (mut x, mut y) = (vec![0.0; self.mlp.inputs() * len], vec![0.0; outputs * len]);
            let mut scratch = vec![0.0; self.mlp.infer_scratch_len()];
            fill(span, &mut x);
            self.mlp.infer(simd, &self.packed, &x, len, len, &mut y, len, &mut scratch);
            for (j, out) in out.chunks_exact_mut(outputs).enumerate() {
                out.iter_mut().enumerate().for_each(|(k, out)| *out = y[k * len + j]);
            }
        });
        out
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        let task = |t: &Task| t.x.capacity() + t.x_bar.capacity() + t.acts.capacity() + t.grad.capacity();
        4 * (6 * self.params.len() + self.tasks.iter().map(task).sum::<usize>())
    }

    pub(crate) fn push_state<'a>(&'a self, out: &mut Vec<Tensor<'a>>) {
        out.push(f32_tensor(format!("{}.network", self.name), &self.params));
        push_adam(out, self.name, &self.adam);
    }

    pub(crate) fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        let params = take_numbers(state, &format!("{}.network", self.name), self.params.len())?;
        self.adam = take_adam(state, self.name, &self.adam)?;
        self.params = params;
        self.pack();
        Ok(())
    }
}
