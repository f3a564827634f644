//! Keeping a crop: the only file that a page can have written. Its name is fixed, its place is beside what is shown.

use super::scene::Scene3d;
use engine::crop::Crop;
use engine::output::Disk;
use std::sync::{Arc, Mutex, PoisonError};

/// One at a time: all go through one temporary name.
static TURN: Mutex<()> = Mutex::new(());

/// Keep a crop beside what is shown; the name of its file.
///
/// # Errors
/// A sentence for the person.
pub(crate) fn save(scene: Option<&Arc<dyn Scene3d>>, crop: &Crop) -> Result<String, String> {
    let scene = scene.ok_or("there is nothing to crop yet")?;
    let path = Crop::path_of(scene.place());
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    crop.write(&Disk, &path).map_err(|e| format!("the crop is not saved: {e}"))?;
    Ok(path.file_name().unwrap_or_default().to_string_lossy().into_owned())
}
