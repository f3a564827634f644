//! The most of settings that networks and batches of all fields have.

use crate::error::SystemError;

/// The most of settings that networks and batches of all fields have: units of a layer, layers, rays and samples of a step.
pub const MOST_UNITS: usize = 4096;

/// See [`MOST_UNITS`].
pub const MOST_LAYERS: usize = 64;

/// See [`MOST_UNITS`].
pub const MOST_RAYS: usize = 1 << 20;

/// See [`MOST_UNITS`].
pub const MOST_SAMPLES: usize = 1 << 24;

/// Refuse settings above what any machine can use: `limits` are names, values and the most of each. What a setting multiplies is
/// allocated before anything else could be said about it.
///
/// # Errors
/// [`SystemError::Config`] naming the setting.
pub fn at_most(limits: &[(&'static str, usize, usize)]) -> Result<(), SystemError> {
    match limits.iter().find(|(_, value, most)| value > most) {
        None => Ok(()),
        Some((field, value, most)) => {
            Err(SystemError::Config { field, value: value.to_string(), problem: format!("must be at most {most}") })
        }
    }
}
