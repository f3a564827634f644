//! Settings of an occupancy grid and of the march through it.

use super::time_bins::MOST_BINS;
use engine::system::SystemError;
use serde::{Deserialize, Serialize};

/// Samples of a ray at most: [`OccupancyConfig::check`] sees to it that no march ends early.
pub(super) const MAX_SAMPLES: u32 = 1 << 16;

/// Settings of an occupancy grid. Lengths are internal.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OccupancyConfig {
    /// Cells along an axis of the occupancy grid.
    pub occupancy: usize,
    /// A cell is empty below this optical thickness at the smallest step.
    pub occupancy_threshold: f32,
    /// Steps in which that threshold rises to its place, from half the thickness of a step through the initial field.
    pub occupancy_settle: u64,
    /// Steps between updates of the occupancy grid.
    pub occupancy_every: u64,
    /// Spans of time that the occupancy grid tells apart, at most as many as the photos have times; 0: it is one for all times. Of use
    /// only where the field depends on the time.
    pub occupancy_times: usize,
    /// Smallest step along the ray.
    pub step_min: f32,
    /// Step per distance from the camera; 0 keeps the step constant.
    pub step_cone: f32,
    /// Samples a ray may have on average in training: where there are more, steps grow until empty space is known.
    pub samples_per_ray: f32,
    /// What lies before the points that photos show is empty from the start.
    pub free_space: bool,
    /// Every ray ends in one more sample, at infinity: the sky, which is a colour for each direction. Only where space is
    /// contracted.
    pub sky: bool,
}

impl OccupancyConfig {
    /// Check the ranges, in a space of `cascades` cubes.
    ///
    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    pub fn check(&self, cascades: usize) -> Result<(), SystemError> {
        let refuse =
            |field, value: String, problem: &str| Err(SystemError::Config { field, value, problem: problem.into() });
        for (field, value) in [
            ("step_min", f64::from(self.step_min)),
            ("samples_per_ray", f64::from(self.samples_per_ray)),
            ("occupancy_every", self.occupancy_every as f64),
            ("occupancy_threshold", f64::from(self.occupancy_threshold)),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return refuse(field, value.to_string(), "must be positive and finite");
            }
        }
        if !(0.0..=1.0).contains(&self.step_cone) {
            return refuse("step_cone", self.step_cone.to_string(), "must be in 0..=1");
        }
        if !(8..=512).contains(&self.occupancy) {
            return refuse("occupancy", self.occupancy.to_string(), "must be in 8..=512");
        }
        if self.occupancy_times > MOST_BINS {
            return refuse("occupancy_times", self.occupancy_times.to_string(), "must be in 0..=64");
        }
        // Along the diagonal of the outermost cube: equal steps, then steps that grow with the distance.
        let diagonal = 3.0_f32.sqrt() * 2.0_f32.powi(cascades as i32);
        let equal = diagonal.min(self.step_min / self.step_cone);
        let steps = equal / self.step_min + (diagonal / equal).ln() / self.step_cone.max(f32::MIN_POSITIVE);
        let shortest = diagonal / 4e6;
        if !(shortest..=100.0).contains(&self.step_min) || steps > MAX_SAMPLES as f32 {
            let problem =
                format!("must be in {shortest:e}..=100, and make at most {MAX_SAMPLES} steps of a ray, not {steps:e}");
            return refuse("step_min", self.step_min.to_string(), &problem);
        }
        Ok(())
    }
}
