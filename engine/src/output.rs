//! Writing files so that a crash or a full disk never costs what was there before.
//!
//! Every file of a run goes to a temporary name beside its place, is flushed to the disk, and is renamed over it.

use crate::error::RunError;
use serde::de::DeserializeOwned;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{PoisonError, RwLock};
use std::time::{Duration, Instant};

/// Where bytes go. [`Disk`] is the file system; a test may put a full disk in its place.
pub trait Storage: Send + Sync {
    /// Create or truncate a file.
    ///
    /// # Errors
    /// What the file system says.
    fn create(&self, path: &Path) -> io::Result<Box<dyn StorageFile>>;
}

/// A file being written.
pub trait StorageFile: Write {
    /// Bring the bytes to the disk.
    ///
    /// # Errors
    /// What the file system says.
    fn sync(&mut self) -> io::Result<()>;
}

/// The file system.
#[derive(Clone, Copy, Debug, Default)]
pub struct Disk;

impl Storage for Disk {
    fn create(&self, path: &Path) -> io::Result<Box<dyn StorageFile>> {
        Ok(Box::new(File::create(path)?))
    }
}

impl StorageFile for File {
    fn sync(&mut self) -> io::Result<()> {
        self.sync_all()
    }
}

/// Write `bytes` to `path`: temporary name, sync, rename. On failure the temporary file is removed and an earlier file at
/// `path` is untouched.
///
/// # Errors
/// [`RunError::Write`] naming `path`.
pub fn write_file(storage: &dyn Storage, path: &Path, bytes: &[u8]) -> Result<(), RunError> {
    let _writing = WRITING.read().unwrap_or_else(PoisonError::into_inner);
    let temporary = temporary_name(path);
    let written = (|| {
        // A link at that place would lead the bytes elsewhere.
        if fs::symlink_metadata(&temporary).is_ok_and(|file| file.is_symlink()) {
            fs::remove_file(&temporary)?;
        }
        let mut file = storage.create(&temporary)?;
        file.write_all(bytes)?;
        file.flush()?;
        file.sync()?;
        drop(file);
        fs::rename(&temporary, path)?;
        sync_folder(path);
        Ok(())
    })();
    written.map_err(|source| {
        // The write error is what matters; the leftover may be unremovable for the same reason.
        let _ = fs::remove_file(&temporary);
        RunError::Write { path: path.to_path_buf(), source }
    })
}

/// Held by whoever writes a file.
static WRITING: RwLock<()> = RwLock::new(());

/// Wait until no file is half-written, for `most` at most: for a process that ends at once and leaves nothing behind. From then on
/// nothing more is written.
pub fn close_files(most: Duration) {
    let since = Instant::now();
    while since.elapsed() < most {
        if let Ok(guard) = WRITING.try_write() {
            // For good.
            std::mem::forget(guard);
            return;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// What a JSON file of a run holds; `None` where there is no such file.
///
/// # Errors
/// [`RunError::Content`] where it holds something else.
pub(crate) fn read_json<T: DeserializeOwned>(path: &Path) -> Result<Option<T>, RunError> {
    let Ok(text) = fs::read_to_string(path) else { return Ok(None) };
    serde_json::from_str(&text).map(Some).map_err(|e| RunError::Content { path: path.into(), problem: e.to_string() })
}

/// Make a folder and those above it.
///
/// # Errors
/// [`RunError::Write`] naming the folder.
pub fn make_folder(path: &Path) -> Result<(), RunError> {
    fs::create_dir_all(path).map_err(RunError::write(path))
}

/// Note a file that could not be written; other errors are errors.
pub(crate) fn note_unwritten(written: Result<(), RunError>, unwritten: &mut Vec<String>) -> Result<(), RunError> {
    match written {
        Err(error @ RunError::Write { .. }) => unwritten.push(error.with_reason()),
        other => other?,
    }
    Ok(())
}

/// What [`write_file`] adds to a name.
const TEMPORARY: &str = ".tmp";

/// The name that a file was to have, where its own is one of [`write_file`]'s temporaries, left by a process that was killed.
pub(crate) fn temporary_of(path: &Path) -> Option<&str> {
    path.file_name()?.to_str()?.strip_suffix(TEMPORARY)
}

fn temporary_name(path: &Path) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(TEMPORARY);
    path.with_file_name(name)
}

/// A rename is on the disk only when its folder is. Not every file system can do it: then the rename is as safe as it is.
fn sync_folder(path: &Path) {
    if let Some(folder) = path.parent().and_then(|p| File::open(p).ok()) {
        let _ = folder.sync_all();
    }
}
