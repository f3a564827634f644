//! A network over rows of Gaussians or of points, kept ready for its kernels; its parameters lie among those of others.

use super::network::{fold_gradients, xavier};
use crate::buffers::sized;
use engine::system::{SystemError, Tensor, TensorMap, f32_tensor, push_adam, take_adam, take_numbers};
use field_core::mlp::{Mlp, MlpConfig, MlpError, Packed};
use field_core::rng::Rng;
use float_core::Simd;
use optim::{Adam, AdamConfig};
use std::ops::Range;

/// A network, and where its parameters lie in those of all.
#[derive(Clone)]
pub(crate) struct RowNetwork {
    mlp: Mlp,
    packed: Packed,
    range: Range<usize>,
}

impl RowNetwork {
    /// A network at its start, whose parameters are added to `params`. [`pack`](Self::pack) makes it ready.
    ///
    /// # Errors
    /// [`MlpError`] for a network that cannot be.
    pub(crate) fn new(config: &MlpConfig, rng: Rng, params: &mut Vec<f32>) -> Result<Self, MlpError> {
        let mlp = Mlp::new(config)?;
        let first = params.len();
        params.extend(xavier(&mlp, rng));
        Ok(Self { range: first..params.len(), mlp, packed: Packed::default() })
    }

    /// Have the last layer give 0, whatever comes in.
    pub(crate) fn begin_at_zero(&self, params: &mut [f32]) {
        if let Some(last) = self.mlp.layers().last() {
            params[self.range.clone()][last.weights.clone()].fill(0.0);
        }
    }

    /// Take its parameters from those of all.
    pub(crate) fn pack(&mut self, params: &[f32]) {
        self.mlp.pack(&params[self.range.clone()], &mut self.packed);
    }

    /// Where the biases of the first layer lie in the parameters of all.
    pub(crate) fn first_biases(&self) -> Range<usize> {
        let of_own = self.mlp.layers().first().map_or(0..0, |layer| layer.biases.clone());
        self.range.start + of_own.start..self.range.start + of_own.end
    }

    /// Rows of what comes out.
    pub(crate) fn outputs(&self) -> usize {
        self.mlp.outputs()
    }

    /// Numbers that [`infer`](Self::infer) needs as scratch.
    pub(crate) fn infer_scratch_len(&self) -> usize {
        self.mlp.infer_scratch_len()
    }

    /// `y` `[outputs][n]` of `x` `[inputs][n]`.
    pub(crate) fn infer(&self, simd: Simd, x: &[f32], n: usize, y: &mut [f32], scratch: &mut [f32]) {
        self.mlp.infer(simd, &self.packed, x, n, n, y, n, scratch);
    }

    /// The same; returns what [`backward`](Self::backward) needs.
    pub(crate) fn forward<'a>(
        &self,
        simd: Simd,
        x: &[f32],
        n: usize,
        y: &mut [f32],
        acts: &'a mut Vec<f32>,
    ) -> &'a [f32] {
        let acts = sized(acts, self.mlp.activations_len(n));
        self.mlp.forward(simd, &self.packed, x, n, n, y, n, acts);
        acts
    }

    /// Adds to `x_bar` `[inputs][n]`, and returns the gradient with respect to the parameters, in the order of the kernels.
    pub(crate) fn backward(
        &self,
        simd: Simd,
        acts: &[f32],
        y_bar: &[f32],
        n: usize,
        x_bar: &mut [f32],
        scratch: &mut Vec<f32>,
    ) -> Vec<f32> {
        let mut gradient = vec![0.0; self.mlp.packed_grad_len()];
        let scratch = sized(scratch, self.mlp.backward_scratch_len());
        self.mlp.backward(simd, &self.packed, acts, y_bar, n, n, Some((x_bar, n)), &mut gradient, scratch);
        gradient
    }

    /// The sum of what [`backward`](Self::backward) gave for some chunks, in their order: its part of `gradient`, the gradient with
    /// respect to all parameters.
    pub(crate) fn fold<'g>(
        &self,
        chunks: impl Iterator<Item = &'g [f32]>,
        packed: &mut Vec<f32>,
        gradient: &mut [f32],
    ) {
        fold_gradients(&self.mlp, chunks, packed, &mut gradient[self.range.clone()]);
    }
}

/// The parameters of networks, and their optimiser.
#[derive(Clone)]
pub(crate) struct NetworkParameters {
    /// Name in checkpoints.
    name: &'static str,
    pub(crate) values: Vec<f32>,
    adam: Adam,
}

impl NetworkParameters {
    pub(crate) fn new(name: &'static str, values: Vec<f32>, config: AdamConfig) -> Self {
        Self { name, adam: Adam::new(values.len(), config), values }
    }

    /// One step. Returns how many entries of the gradient were not finite.
    pub(crate) fn step(&mut self, simd: Simd, lr: f64, gradient: &[f32]) -> usize {
        self.adam.step(simd, lr, &mut self.values, gradient)
    }

    /// What its next step depends on.
    pub(crate) fn state(&self) -> Vec<Tensor<'_>> {
        let mut out = vec![f32_tensor(self.name, &self.values)];
        push_adam(&mut out, self.name, &self.adam);
        out
    }

    /// What [`state`](Self::state) wrote. Nothing has changed where it does not fit.
    ///
    /// # Errors
    /// [`SystemError::State`] naming the array that is missing or does not fit.
    pub(crate) fn load(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        let values = take_numbers(state, self.name, self.values.len())?;
        self.adam = take_adam(state, self.name, &self.adam)?;
        self.values = values;
        Ok(())
    }
}
