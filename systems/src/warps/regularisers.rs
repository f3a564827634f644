//! Settings of what a deformation costs besides the error of pixels: elastic and background losses (Nerfies, sections 3.3 and 3.4), and
//! coherence.

use super::settings::in_range;
use engine::system::SystemError;
use losses::coherence;
use serde::{Deserialize, Serialize};

/// Which samples of a ray an elastic loss depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum ElasticAt {
    /// The one behind which half of the transmittance is left.
    Middle,
    /// All, by their weights; those of next to no weight are left out.
    All,
}

/// Settings of the elastic loss.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ElasticSettings {
    /// Factor of the loss; 0: none.
    pub(crate) elastic: f32,
    /// Share of the schedule over which the factor rises from 0; 0: it is there from the start.
    pub(crate) elastic_rise: f64,
    /// Size of a logarithmic stretch from which on it hardly costs more.
    pub(crate) elastic_scale: f32,
    /// Samples it depends on: `middle` (one a ray) or `all` that carry weight.
    pub(crate) elastic_at: ElasticAt,
}

impl ElasticSettings {
    /// No elastic loss.
    pub(crate) const NONE: Self =
        Self { elastic: 0.0, elastic_rise: 0.0, elastic_scale: 0.03, elastic_at: ElasticAt::Middle };

    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        in_range("elastic", self.elastic, 0.0..=1e3)?;
        in_range("elastic_rise", self.elastic_rise, 0.0..=1.0)?;
        in_range("elastic_scale", self.elastic_scale, 1e-6..=1e3)
    }
}

/// Settings of the coherence loss.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct CoherenceSettings {
    /// Factor of the loss, mean over rays, of each the sample where half of the light is gone, by its weight; 0: none.
    pub(crate) coherence: f32,
    /// How far away the neighbour is that a sample is compared with, in sides of the unit cube.
    pub(crate) coherence_reach: f32,
    /// Stretch of the way to the neighbour from which on it costs in proportion, below by its square.
    pub(crate) coherence_scale: f32,
}

impl CoherenceSettings {
    /// No coherence loss. A neighbour is within the cell of the sample: a quarter of it away in an occupancy grid of 64 cells along an
    /// axis, half of it in the inner cube where space is contracted. Nearer, distances in `f32` would have few digits.
    pub(crate) const NONE: Self =
        Self { coherence: 0.0, coherence_reach: 1.0 / 256.0, coherence_scale: coherence::SCALE };

    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        in_range("coherence", self.coherence, 0.0..=1e3)?;
        in_range("coherence_reach", self.coherence_reach, 1e-5..=0.25)?;
        in_range("coherence_scale", self.coherence_scale, 1e-6..=1e3)
    }
}

/// Settings of the background loss.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct BackgroundSettings {
    /// Factor of the loss; 0: none.
    pub(crate) background_loss: f32,
    /// Points of a step for it.
    pub(crate) background_points: usize,
}

impl BackgroundSettings {
    /// No background loss.
    pub(crate) const NONE: Self = Self { background_loss: 0.0, background_points: 1024 };

    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        in_range("background_loss", self.background_loss, 0.0..=1e3)?;
        in_range("background_points", self.background_points, 0..=1 << 20)
    }
}
