//! Files that appear whole or not at all.

use crate::SceneError;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// Write a file under a temporary name beside `path`, sync it and rename it. Where anything fails, `path` is what it was
/// before and the temporary file is removed. Missing folders are made.
///
/// # Errors
/// Names the file and what the system said.
pub fn write_atomically(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), SceneError> {
    if let Some(folder) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder).map_err(|e| SceneError::io(folder, "make the folder", e))?;
    }
    let mut temporary = path.as_os_str().to_owned();
    // The process number keeps two runs that write the same file apart.
    temporary.push(format!(".{}.tmp", std::process::id()));
    let temporary = Path::new(&temporary);
    let result = fill(temporary, write).and_then(|()| std::fs::rename(temporary, path));
    result.map_err(|e| {
        // Gone already, or unwritable anyway: the first error is the one to tell.
        let _ = std::fs::remove_file(temporary);
        SceneError::io(path, "write the file", e)
    })
}

fn fill(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let mut out = BufWriter::with_capacity(1 << 18, File::create(path)?);
    write(&mut out)?;
    out.into_inner()?.sync_all()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ErrorKind;

    #[test]
    fn files_appear_whole_in_new_folders() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a/b/c.txt");
        write_atomically(&path, |out| out.write_all(b"one")).unwrap();
        write_atomically(&path, |out| out.write_all(b"two")).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"two");
        assert_eq!(std::fs::read_dir(path.parent().unwrap()).unwrap().count(), 1);
    }

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("c.txt");
        write_atomically(&path, |out| out.write_all(b"old")).unwrap();
        let full = || io::Error::from(io::ErrorKind::StorageFull);
        let error = write_atomically(&path, |out| out.write_all(b"half").and_then(|()| Err(full()))).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Io);
        assert!(error.to_string().contains("c.txt") && error.to_string().contains("free some space"), "{error}");
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_folder_in_the_way_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        std::fs::write(&file, b"").unwrap();
        let error = write_atomically(&file.join("x.ply"), |_| Ok(())).unwrap_err();
        assert!(error.to_string().contains("cannot make the folder"), "{error}");
        assert!(write_atomically(folder.path(), |_| Ok(())).is_err());
    }
}
