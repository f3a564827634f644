//! What a checkpoint holds of a deformation.

use super::deform::Deform;
use engine::system::{
    SystemError, Tensor, TensorMap, f32_tensor, push_adam, take_adam, take_numbers, take_u64, u64_tensor,
};

impl Deform {
    /// Everything the next step depends on.
    pub(crate) fn state(&self) -> Vec<Tensor<'_>> {
        let mut out = vec![
            f32_tensor("deform.networks", &self.params),
            self.time.learned_tensor(),
            u64_tensor("deform.done", vec![self.done.to_bits()]),
        ];
        if self.began > 0.0 {
            out.push(u64_tensor("deform.began", vec![self.began.to_bits()]));
        }
        push_adam(&mut out, "deform.networks", &self.adam);
        self.time.push_adam(&mut out);
        if self.has_planes() {
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
        let done = take_share(state, "deform.done")?;
        let began = if state.contains_key("deform.began") { take_share(state, "deform.began")? } else { 0.0 };
        let adam = take_adam(state, "deform.networks", &self.adam)?;
        let (learned, time_adam) = self.time.take(state)?;
        if self.has_planes() {
            self.plane_adam = take_adam(state, "deform.planes", &self.plane_adam)?;
        }
        (self.params, self.done, self.began, self.adam) = (params, done, began, adam);
        self.time.put(learned, time_adam);
        self.renew();
        Ok(())
    }

    fn has_planes(&self) -> bool {
        self.deformation.planes().is_some_and(|planes| !planes.is_empty())
    }

    /// Number of trainable parameters.
    pub(crate) fn parameter_count(&self) -> usize {
        self.params.len() + self.time.learned.len()
    }
}

fn take_share(state: &TensorMap, name: &str) -> Result<f64, SystemError> {
    let share = f64::from_bits(take_u64(state, name, 1)?[0]);
    if !(0.0..=1.0).contains(&share) {
        let problem = format!("{share} of a schedule is done; 0 to 1 expected");
        return Err(SystemError::State { name: name.into(), problem });
    }
    Ok(share)
}
