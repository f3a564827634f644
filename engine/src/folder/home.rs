//! Whether the run folder is still the one that the run began in.
//!
//! A folder that is removed or moved away on the way costs nothing but what lay in it: it is made again with everything that the run
//! still knows. Another folder at its place is taken only where it is empty or holds nothing but a run's first files.

use super::lock::FolderLock;
use super::place::refuse_foreign;
use crate::checkpoint;
use crate::error::RunError;
use crate::output::{Storage, make_folder, write_file};
use crate::progress::{Event, Observer};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// What tells one folder from another: device and number; `None` where the system has no such numbers.
type Id = Option<(u64, u64)>;

/// A run folder, and which one it is. Clones know when it was made again.
#[derive(Clone, Debug)]
pub(crate) struct Home {
    folder: PathBuf,
    id: Arc<Mutex<Id>>,
}

/// Where the results of a run are written.
#[derive(Clone, Copy)]
pub(crate) struct Place<'a> {
    pub(crate) storage: &'a dyn Storage,
    pub(crate) folder: &'a Path,
    pub(crate) home: &'a Home,
}

impl Home {
    /// The folder as it is now.
    pub(crate) fn of(folder: &Path) -> Self {
        Self { folder: folder.into(), id: Arc::new(Mutex::new(id_of(folder).flatten())) }
    }

    /// Whether the folder is there and the same.
    pub(crate) fn stands(&self) -> bool {
        let own = *self.id.lock().unwrap_or_else(PoisonError::into_inner);
        id_of(&self.folder).is_some_and(|id| id == own)
    }

    /// Refuse to write where something else lies at the folder's place now. One that is gone may be made again.
    ///
    /// # Errors
    /// [`RunError::Write`] naming the folder.
    fn refuse_others(&self) -> Result<(), RunError> {
        if self.stands() {
            return Ok(());
        }
        let why = match checkpoint::newest_step(&self.folder) {
            Some(_) => "another run lies there now: the folder was replaced while this one went on".into(),
            None => match refuse_foreign(&self.folder) {
                Ok(()) => return Ok(()),
                Err(error) => error.to_string(),
            },
        };
        Err(self.unwritable(why))
    }

    /// What `write` gives, unless something else lies at the folder's place now.
    ///
    /// # Errors
    /// As [`Home::refuse_others`], and those of `write`.
    pub(crate) fn guard<T>(&self, write: impl FnOnce() -> Result<T, RunError>) -> Result<T, RunError> {
        self.refuse_others()?;
        write()
    }

    fn unwritable(&self, why: String) -> RunError {
        RunError::Write { path: self.folder.clone(), source: io::Error::other(why) }
    }

    /// Make the folder again where it is gone: `texts` are its first files, names and content. `true` where that was needed.
    ///
    /// # Errors
    /// [`RunError::Write`] where it cannot be made, or where something else lies there now.
    pub(crate) fn restore(
        &self,
        lock: &mut Option<FolderLock>,
        storage: &dyn Storage,
        texts: &[(&str, String)],
        observer: &mut dyn Observer,
    ) -> Result<bool, RunError> {
        if self.stands() {
            return Ok(false);
        }
        self.refuse_others()?;
        make_folder(&self.folder)?;
        // The old lock is on a file that has no name any more, or it is what an earlier try took here.
        *lock = None;
        *lock = FolderLock::take(&self.folder).map_err(|error| match error {
            // Whoever is there may go again.
            RunError::Busy { .. } => self.unwritable(error.to_string()),
            error => error,
        })?;
        for (name, text) in texts {
            write_file(storage, &self.folder.join(name), text.as_bytes())?;
        }
        *self.id.lock().unwrap_or_else(PoisonError::into_inner) = id_of(&self.folder).flatten();
        let line = format!(
            "`{}` was removed or replaced while the run went on: it is made again; what lay in it before is gone",
            self.folder.display()
        );
        observer.event(Event::Warning(&line));
        Ok(true)
    }
}

/// `None` where there is no folder.
fn id_of(folder: &Path) -> Option<Id> {
    let found = fs::metadata(folder).ok().filter(fs::Metadata::is_dir)?;
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        Some(Some((found.dev(), found.ino())))
    }
    #[cfg(not(unix))]
    {
        let _ = found;
        Some(None)
    }
}
