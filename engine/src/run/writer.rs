//! The right to write into a run's folder.

use super::Run;
use crate::error::RunError;
use crate::folder::FolderLock;
use crate::progress::{Event, Observer};
use std::path::Path;

impl Run<'_> {
    /// The right to write into the folder for a while, where this run does not have it for good.
    pub(super) fn write_lock(&self, observer: &mut dyn Observer) -> Result<Option<FolderLock>, RunError> {
        match self.lock {
            Some(_) => Ok(None),
            None => take_lock(&self.folder, observer),
        }
    }
}

/// The lock of a folder; where the file system knows none, that is said.
pub(super) fn take_lock(folder: &Path, observer: &mut dyn Observer) -> Result<Option<FolderLock>, RunError> {
    let lock = FolderLock::take(folder)?;
    if lock.is_none() {
        let line = format!(
            "the file system of `{}` does not support locks: see to it that nothing else is trained into this folder",
            folder.display()
        );
        observer.event(Event::Warning(&line));
    }
    Ok(lock)
}
