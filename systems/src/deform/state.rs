//! What a checkpoint holds of a deformation.

use super::Deform;
use engine::system::{
    SystemError, Tensor, TensorMap, f32_tensor, push_adam, take_adam, take_counts, take_numbers, u64_tensor,
};

impl Deform {
    /// Everything the next step depends on.
    pub(crate) fn state(&self) -> Vec<Tensor<'_>> {
        let mut out = vec![
            f32_tensor("deform.networks", &self.params),
            f32_tensor("deform.moments", &self.codes),
            u64_tensor("deform.steps", vec![self.steps]),
        ];
        push_adam(&mut out, "deform.networks", &self.adam);
        push_adam(&mut out, "deform.moments", &self.code_adam);
        if !self.planes.is_empty() {
            push_adam(&mut out, "deform.planes", &self.plane_adam);
        }
        out
    }

    /// Put back what [`Deform::state`] gave.
    ///
    /// # Errors
    /// [`SystemError::State`] naming the array that is missing or has another shape.
    pub(crate) fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        let params = take_numbers(state, "deform.networks", self.params.len())?;
        let codes = take_numbers(state, "deform.moments", self.codes.len())?;
        let steps = take_counts(state, "deform.steps", 1)?[0];
        let adam = take_adam(state, "deform.networks", &self.adam)?;
        let code_adam = take_adam(state, "deform.moments", &self.code_adam)?;
        (self.params, self.codes, self.steps) = (params, codes, steps);
        if !self.planes.is_empty() {
            self.plane_adam = take_adam(state, "deform.planes", &self.plane_adam)?;
        }
        (self.adam, self.code_adam) = (adam, code_adam);
        self.renew();
        Ok(())
    }

    /// Trainable numbers.
    pub(crate) fn parameter_count(&self) -> usize {
        self.params.len() + self.codes.len()
    }
}
