//! Which rays a system for scenes that move is trained with.

use engine::system::SystemError;
use serde::{Deserialize, Serialize};

/// Settings of which rays are drawn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RaySettings {
    /// Whether errors lead half of the rays: what moves is seen by one photo of a time.
    pub(crate) by_error: bool,
    /// Whether masks lead the rays: none through a tool, more where it often is.
    pub(crate) guided: bool,
    /// Share of the schedule after which all frames have come in, in the order of time; 0: they are there from the start.
    pub(crate) curriculum: f64,
}

impl RaySettings {
    /// Rays of all frames, anywhere.
    pub(crate) const ANYWHERE: Self = Self { by_error: false, guided: false, curriculum: 0.0 };

    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        if !(0.0..=1.0).contains(&self.curriculum) {
            let problem = "must be in 0..=1, a share of the schedule".into();
            return Err(SystemError::Config { field: "curriculum", value: self.curriculum.to_string(), problem });
        }
        if self.by_error && (self.curriculum > 0.0 || self.guided) {
            let problem = "rays are drawn in one way: set `by_error=false`, or `curriculum=0` and `guided=false`";
            return Err(SystemError::Config { field: "by_error", value: "true".into(), problem: problem.into() });
        }
        Ok(())
    }
}
