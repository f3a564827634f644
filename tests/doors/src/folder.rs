//! A valid folder in which one file at a time is replaced.

use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A file: its name in the folder, and what it holds where nothing is replaced (`None`: it is not there).
pub(crate) type File = (String, Option<Vec<u8>>);

/// The folder, and which of its files is not as it was.
pub(crate) struct Folder {
    place: TempDir,
    files: Vec<File>,
    other: Option<usize>,
}

impl Folder {
    /// Writes the files.
    pub(crate) fn new(files: Vec<File>) -> Self {
        // Memory, where the system has a file system in it: a folder is written many thousand times a second.
        let memory = Path::new("/dev/shm");
        let place = if memory.is_dir() { TempDir::with_prefix_in("doors-", memory) } else { TempDir::new() };
        let folder = Self { place: place.expect("a folder for files"), files, other: None };
        for at in 0..folder.files.len() {
            folder.restore(at);
        }
        folder
    }

    pub(crate) fn path(&self) -> &Path {
        self.place.path()
    }

    /// Replaces the file that `which` counts to, from `0`; the one replaced before is as it was again. Returns its name.
    pub(crate) fn replace(&mut self, which: u8, content: &[u8]) -> &str {
        let at = usize::from(which.wrapping_sub(b'0')) % self.files.len();
        if let Some(other) = self.other.replace(at).filter(|other| *other != at) {
            self.restore(other);
        }
        self.write(&self.files[at].0, content);
        &self.files[at].0
    }

    fn restore(&self, at: usize) {
        let (name, content) = &self.files[at];
        match content {
            Some(content) => self.write(name, content),
            None => {
                let _ = fs::remove_file(self.path().join(name));
            }
        }
    }

    fn write(&self, name: &str, content: &[u8]) {
        let path: PathBuf = self.path().join(name);
        if fs::write(&path, content).is_err() {
            fs::create_dir_all(path.parent().expect("a file in a folder")).expect("a folder");
            fs::write(&path, content).expect("a file");
        }
    }
}
