//! Refuses what no machine like this one could hold, before it is made.

use super::human;
use crate::system::SystemError;

/// Bytes of a parameter: itself, its gradient, two moments.
const BYTES: u64 = 16;

/// Refuse a system whose parameters do not fit into the machine's memory. `--memory` reduces settings once the system is made; this
/// is about systems that cannot be made at all.
///
/// # Errors
/// [`SystemError::Config`] naming `field`, the setting that the parameters grow with.
pub fn room_for(field: &'static str, value: usize, parameters: usize) -> Result<(), SystemError> {
    fits(field, value, parameters, scene_io::available_bytes())
}

fn fits(field: &'static str, value: usize, parameters: usize, available: Option<u64>) -> Result<(), SystemError> {
    let bytes = (parameters as u64).saturating_mul(BYTES);
    let Some(available) = available.filter(|&available| bytes > available) else { return Ok(()) };
    let [bytes, available] = [bytes, available].map(human);
    let problem = format!("{parameters} parameters take {bytes} to train, and the machine can give {available}");
    Err(SystemError::Config { field, value: value.to_string(), problem: format!("{problem}: give a smaller one") })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_is_refused_by_name() {
        assert!(fits("voxels", 512, 1000, Some(16_000)).is_ok());
        assert!(fits("voxels", 512, usize::MAX, None).is_ok());
        assert_eq!(
            fits("voxels", 512, 1_000_000_000, Some(2_000_000_000)).unwrap_err().to_string(),
            "`voxels` = 512: 1000000000 parameters take 16.00 GB to train, and the machine can give 2.00 GB: give a smaller one"
        );
        assert!(fits("voxels", 512, usize::MAX, Some(u64::MAX - 1)).is_err());
    }
}
