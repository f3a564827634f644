//! Parameters that learn: with the moments of Adam, the count of gradients that were not finite, and all of it in a checkpoint.

use engine::system::{SystemError, Tensor, TensorMap, f32_tensor, take_counts, take_numbers, u64_tensor};
use float_core::Simd;
use optim::{Adam, AdamConfig, NonFiniteGuard};

/// All parameters of a system of networks.
pub(crate) struct Trained {
    pub(crate) params: Vec<f32>,
    adam: Adam,
    guard: NonFiniteGuard,
}

impl Trained {
    pub(crate) fn new(params: Vec<f32>, config: AdamConfig) -> Self {
        Self { adam: Adam::new(params.len(), config), guard: NonFiniteGuard::default(), params }
    }

    /// Go on counting where another one stopped.
    pub(crate) fn count_on(&mut self, from: &Self) {
        self.guard = from.guard;
    }

    /// One step of Adam. Returns how many entries of the gradient were not finite.
    pub(crate) fn step(&mut self, simd: Simd, lr: f64, grad: &[f32]) -> usize {
        self.adam.step(simd, lr, &mut self.params, grad)
    }

    /// Count a step in which this many entries of the gradient were not finite.
    ///
    /// # Errors
    /// [`SystemError::NonFinite`] past the share a run may have.
    pub(crate) fn record(&mut self, bad: usize) -> Result<(), SystemError> {
        Ok(self.guard.record(bad)?)
    }

    pub(crate) fn state(&self) -> Vec<Tensor<'_>> {
        vec![
            f32_tensor("networks", &self.params),
            f32_tensor("adam.m", self.adam.first_moment()),
            f32_tensor("adam.v", self.adam.second_moment()),
            u64_tensor(
                "counters",
                vec![self.adam.steps(), self.guard.steps(), self.guard.bad_steps(), self.guard.entries()],
            ),
        ]
    }

    /// What [`Trained::state`] gave.
    ///
    /// # Errors
    /// [`SystemError::State`] naming the array that is missing or has another shape.
    pub(crate) fn restored(&self, tensors: &TensorMap) -> Result<Self, SystemError> {
        let n = self.params.len();
        let params = take_numbers(tensors, "networks", n)?;
        let (m, v) = (take_numbers(tensors, "adam.m", n)?, take_numbers(tensors, "adam.v", n)?);
        let counters = take_counts(tensors, "counters", 4)?;
        let adam = Adam::restore(self.adam.config(), m, v, counters[0])
            .map_err(|e| SystemError::State { name: "adam".into(), problem: e.to_string() })?;
        Ok(Self { params, adam, guard: NonFiniteGuard::default().resumed(counters[1], counters[2], counters[3]) })
    }
}
