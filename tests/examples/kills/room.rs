//! Where runs lie: a folder, or a small disk of its own that can be filled and made read-only.

use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Room on a small disk: many times what a run needs.
const MIB: u64 = 48;

/// A place for runs; a disk goes away with it.
pub(crate) struct Room {
    path: PathBuf,
    is_disk: bool,
}

impl Room {
    /// A small disk at `path` where one may be mounted, a folder otherwise.
    pub(crate) fn new(path: &Path) -> Result<Self, String> {
        fs::create_dir_all(path).map_err(|e| e.to_string())?;
        let size = format!("size={MIB}m");
        let is_disk = cfg!(target_os = "linux") && did("mount", &["-t", "tmpfs", "-o", &size, "tmpfs"], path);
        Ok(Self { path: path.into(), is_disk })
    }

    /// Whether it can be filled and made read-only.
    pub(crate) fn is_disk(&self) -> bool {
        self.is_disk
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Fill it up but for `left` bytes; until [`Room::empty`].
    pub(crate) fn fill(&self, left: u64) -> Result<(), String> {
        let path = self.path.join("filler");
        let mut filler = File::create(&path).map_err(|e| e.to_string())?;
        let block = [0_u8; 4096];
        while filler.write_all(&block).is_ok() {}
        let size = filler.metadata().map_err(|e| e.to_string())?.len();
        filler.set_len(size.saturating_sub(left)).map_err(|e| e.to_string())
    }

    /// Give the room back.
    pub(crate) fn empty(&self) {
        let _ = fs::remove_file(self.path.join("filler"));
    }

    /// Make the disk read-only or not. `false` where that could not be done: a file is open for writing.
    pub(crate) fn protect(&self, is_protected: bool) -> bool {
        did("mount", &["-o", if is_protected { "remount,ro" } else { "remount,rw" }], &self.path)
    }

    /// Make what lies in a folder unchangeable or not, also while files are open there. `false` where that cannot be done.
    pub(crate) fn seal(folder: &Path, is_sealed: bool) -> bool {
        did("chattr", &["-R", if is_sealed { "+i" } else { "-i" }], folder)
    }
}

impl Drop for Room {
    fn drop(&mut self) {
        if self.is_disk {
            let _ = did("umount", &["-l"], &self.path);
        }
    }
}

fn did(program: &str, words: &[&str], path: &Path) -> bool {
    let command = Command::new(program).args(words).arg(path).stdout(Stdio::null()).stderr(Stdio::null()).status();
    command.is_ok_and(|status| status.success())
}
