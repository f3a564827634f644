//! What the density network sees of a point at its time, besides features of the canonical point.

use super::at::At;
use super::octaves::Octaves;
use super::parameters::Parameters;
use super::settings::in_range;
use super::window::Window;
use engine::system::SystemError;
use field_core::encoding::frequency::Identity;
use field_core::tape::{Node, Tape, TapeError};
use serde::{Deserialize, Serialize};

/// What the density network sees besides features.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Sees {
    /// Nothing.
    Place,
    /// The time.
    Time,
    /// The time, and the octaves of the point where it is now.
    Point,
}

/// Settings of what the density network sees besides features.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct DensitySettings {
    /// `place` (nothing), `time`, or `point` (the time and where the point is now).
    pub(crate) sees: Sees,
    /// Octaves of that point, with the point itself.
    #[serde(rename = "sees_octaves")]
    pub(crate) octaves: usize,
}

impl DensitySettings {
    /// Nothing besides features.
    pub(crate) const PLACE: Self = Self { sees: Sees::Place, octaves: 4 };

    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        in_range("sees_octaves", self.octaves, 0..=16)
    }
}

/// Time and place as the density network sees them.
pub(crate) struct DensityInputs {
    sees: Sees,
    time_rows: usize,
    /// `None` where the point is not seen.
    octaves: Option<Octaves>,
}

impl DensityInputs {
    /// `time_rows` is what networks see of the time.
    ///
    /// # Errors
    /// [`SystemError::Config`] for settings that cannot be.
    pub(crate) fn new(
        settings: &DensitySettings,
        time_rows: usize,
        parameters: &Parameters,
    ) -> Result<Self, SystemError> {
        settings.check()?;
        let &DensitySettings { sees, octaves } = settings;
        let octaves = (sees == Sees::Point)
            .then(|| Octaves::new(3, octaves, Identity::Include, Window::Open, parameters.simd))
            .transpose()?;
        Ok(Self { sees, time_rows: if sees == Sees::Place { 0 } else { time_rows }, octaves })
    }

    /// Rows of all nodes of [`DensityInputs::of`].
    pub(crate) fn rows(&self) -> usize {
        self.time_rows + self.octaves.as_ref().map_or(0, Octaves::rows)
    }

    /// Nothing, the time, or the time and `gamma(x)`.
    ///
    /// # Errors
    /// [`TapeError`] for other shapes.
    pub(crate) fn of<'a>(&'a self, tape: &mut Tape<'a>, at: &At<'_>) -> Result<Vec<Node>, TapeError> {
        let mut seen = Vec::with_capacity(2);
        if self.sees != Sees::Place {
            seen.push(at.time);
        }
        if let Some(octaves) = &self.octaves {
            seen.push(octaves.of(tape, at.x)?);
        }
        Ok(seen)
    }
}
