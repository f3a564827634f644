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
    /// Steps after which all frames have come in, in the order of time; 0: they are there from the start.
    pub(crate) curriculum: u64,
}

impl RaySettings {
    /// Rays of all frames, anywhere.
    pub(crate) const ANYWHERE: Self = Self { by_error: false, guided: false, curriculum: 0 };

    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        if self.by_error && (self.curriculum > 0 || self.guided) {
            let problem = "rays are drawn in one way: set `by_error=false`, or `curriculum=0` and `guided=false`";
            return Err(SystemError::Config { field: "by_error", value: "true".into(), problem: problem.into() });
        }
        Ok(())
    }
}
