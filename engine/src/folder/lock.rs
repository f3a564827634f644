//! One writer a run folder: a lock on `RUN/.lock` that the operating system takes back when its process ends, however it ends.
//!
//! The file stays behind, empty; what counts is the lock on it. Whoever only reads (`render`, `view`, `export`) asks for no lock.

use super::layout::LOCK;
use crate::error::RunError;
use crate::output::make_folder;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{ErrorKind, Read, Seek, Write};
use std::path::Path;

/// The right to write into a run folder; given back on drop.
#[derive(Debug)]
pub struct FolderLock {
    /// Open as long as the lock is held.
    file: File,
}

impl FolderLock {
    /// Take the lock of a run folder, which is made if it is not there. `None` where the file system knows no locks.
    ///
    /// # Errors
    /// [`RunError::Busy`] where another process, or another run of this one, holds it; [`RunError::Write`].
    pub fn take(folder: &Path) -> Result<Option<Self>, RunError> {
        make_folder(folder)?;
        let path = folder.join(LOCK);
        let mut file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(&path)
            .map_err(RunError::write(&path))?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let mut holder = String::new();
                // For the message only: where it cannot be read, the process has no number in it.
                let _ = file.read_to_string(&mut holder);
                let pid = holder.trim().parse().ok();
                return Err(RunError::Busy { folder: folder.into(), holder: holder_words(pid) });
            }
            // Some network file systems: better no lock than no training.
            Err(TryLockError::Error(e)) if e.kind() == ErrorKind::Unsupported || is_no_locks(&e) => return Ok(None),
            Err(TryLockError::Error(e)) => return Err(RunError::Write { path, source: e }),
        }
        // For the message of another process; no lock fails over it.
        let _ = file.set_len(0).and_then(|()| file.write_all(std::process::id().to_string().as_bytes()));
        Ok(Some(Self { file }))
    }
}

/// Whether a lock was ever taken in a folder.
pub(crate) fn was_locked(folder: &Path) -> bool {
    folder.join(LOCK).exists()
}

impl Drop for FolderLock {
    fn drop(&mut self) {
        let _ = self.file.set_len(0).and_then(|()| self.file.rewind());
        let _ = self.file.unlock();
    }
}

fn holder_words(pid: Option<u32>) -> String {
    match pid {
        Some(pid) if pid == std::process::id() => "this process".into(),
        Some(pid) => format!("process {pid}"),
        None => "another process".into(),
    }
}

/// `ENOLCK`: what NFS without a lock service answers.
fn is_no_locks(error: &std::io::Error) -> bool {
    const ENOLCK: i32 = 37;
    cfg!(target_os = "linux") && error.raw_os_error() == Some(ENOLCK)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_has_one_lock_and_gets_it_back() {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path().join("run");
        let first = FolderLock::take(&run).unwrap().unwrap();
        let error = FolderLock::take(&run).unwrap_err();
        assert!(matches!(error, RunError::Busy { .. }) && error.to_string().contains("this process"), "{error}");
        drop(first);
        assert_eq!(std::fs::read(run.join(LOCK)).unwrap(), b"");
        FolderLock::take(&run).unwrap().unwrap();
    }

    #[test]
    fn a_lock_that_names_a_dead_process_is_free() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(LOCK), "4194303 and more").unwrap();
        let lock = FolderLock::take(folder.path()).unwrap();
        let written = std::fs::read_to_string(folder.path().join(LOCK)).unwrap();
        assert!(lock.is_some() && written == std::process::id().to_string(), "{written}");
    }
}
