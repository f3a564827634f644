//! A file of Gaussians, opened for a command.

use crate::show::line;
use engine::RunError;
use std::path::Path;
use systems::splats::Cloud;

/// Read a file, and say how many Gaussians it holds and what was dropped, clamped or ignored.
pub(super) fn open(path: &Path) -> Result<Cloud, RunError> {
    let cloud = Cloud::open(path)?;
    line(format_args!("{}: {} Gaussians", path.display(), cloud.len()));
    for note in cloud.notes() {
        line(format_args!("  {note}"));
    }
    Ok(cloud)
}
