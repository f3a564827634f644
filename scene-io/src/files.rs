//! Files, read with errors that name them, and paths that stay inside the dataset.

use crate::{DecodeMemory, ErrorKind, Place, Problem, SceneError};
use std::path::{Component, Path, PathBuf};

/// Refuses folders, which open like files.
pub(crate) fn refuse_folder(path: &Path) -> Result<(), SceneError> {
    if path.is_dir() {
        let problem = Problem::new(path, "is a folder where a file was expected", "remove or rename it");
        return Err(SceneError::new(ErrorKind::Io, problem));
    }
    Ok(())
}

/// The bytes of a file. One that is larger than [`DecodeMemory`] allows is refused.
pub(crate) fn read_bytes(path: &Path) -> Result<Vec<u8>, SceneError> {
    refuse_folder(path)?;
    let length = std::fs::metadata(path).map_or(0, |about| about.len());
    DecodeMemory::of_process().check(path, "the whole file", length)?;
    std::fs::read(path).map_err(|e| SceneError::io(path, "read the file", e))
}

/// The text of a file, without a byte-order mark. Line ends are left as they are.
pub(crate) fn read_text(path: &Path) -> Result<String, SceneError> {
    let bytes = read_bytes(path)?;
    let text = String::from_utf8(bytes).map_err(|e| {
        let offset = e.utf8_error().valid_up_to() as u64;
        let problem = Problem::new(path, "is not UTF-8 text", "save the file as UTF-8").at(Place::Byte(offset));
        SceneError::new(ErrorKind::Format, problem).caused_by(e)
    })?;
    Ok(match text.strip_prefix('\u{feff}') {
        Some(rest) => rest.to_owned(),
        None => text,
    })
}

/// A path written in a dataset, resolved against the dataset's folder without touching the disk (symbolic links are
/// not followed); `None` where it leads out of that folder.
pub(crate) fn inside(root: &Path, written: &str) -> Option<PathBuf> {
    // Files made on Windows write backslashes; no dataset known uses them inside names.
    let written = written.replace('\\', "/");
    let written = Path::new(&written);
    if written.is_absolute() {
        // By the same words as paths that were relative: what lies beside it is found by these.
        let whole = lexical(&std::path::absolute(root).ok()?)?;
        return lexical(written)?.strip_prefix(&whole).ok().map(|relative| root.join(relative));
    }
    lexical(written).map(|relative| root.join(relative))
}

/// The name of a frame: its path without a leading `./`.
pub(crate) fn plain_name(written: &str) -> String {
    let slashes = written.replace('\\', "/");
    let mut name = slashes.as_str();
    while let Some(rest) = name.strip_prefix("./") {
        name = rest.trim_start_matches('/');
    }
    name.to_owned()
}

/// Removes `.` and resolves `..` by the text alone; `None` where `..` would leave the start.
fn lexical(path: &Path) -> Option<PathBuf> {
    let mut out = PathBuf::new();
    let mut depth = 0_usize;
    for component in path.components() {
        match component {
            Component::Prefix(_) | Component::RootDir => out.push(component),
            Component::CurDir => {}
            Component::ParentDir => {
                depth = depth.checked_sub(1)?;
                out.pop();
            }
            Component::Normal(part) => {
                depth += 1;
                out.push(part);
            }
        }
    }
    Some(out)
}

/// Extensions that can be decoded, lower case.
pub(crate) const IMAGE_EXTENSIONS: [&str; 6] = ["png", "jpg", "jpeg", "webp", "exr", "gif"];

/// Whether a file name ends like an image.
pub(crate) fn is_image(path: &Path) -> bool {
    let extension = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    extension.is_some_and(|e| IMAGE_EXTENSIONS.contains(&e.as_str()))
}

/// Whether a picture is not a photo but belongs to one.
pub(crate) fn is_beside(path: &Path) -> bool {
    let inner = path.file_stem().map(Path::new).and_then(Path::extension).and_then(|e| e.to_str());
    inner.is_some_and(|e| ["mask", "segs", "inpaint"].contains(&e))
}

/// The image files of a folder that can be decoded, sorted by name; those that belong to another (see [`crate::Priors`]) left out.
///
/// # Errors
/// [`ErrorKind::Io`] where the folder cannot be listed.
pub fn images_in(folder: &Path) -> Result<Vec<PathBuf>, SceneError> {
    let entries = std::fs::read_dir(folder).map_err(|e| SceneError::io(folder, "list the folder", e))?;
    let mut files = Vec::new();
    for entry in entries {
        let path = entry.map_err(|e| SceneError::io(folder, "list the folder", e))?.path();
        if is_image(&path) && path.is_file() && !is_beside(&path) {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

/// `path` itself where it exists, else `path` with one of the image extensions (either case) appended.
pub(crate) fn with_image_extension(path: &Path) -> Option<PathBuf> {
    if path.is_file() {
        return Some(path.to_path_buf());
    }
    let base = path.as_os_str();
    IMAGE_EXTENSIONS.iter().flat_map(|e| [(*e).to_owned(), e.to_ascii_uppercase()]).find_map(|extension| {
        let mut name = base.to_owned();
        name.push(".");
        name.push(extension);
        let candidate = PathBuf::from(name);
        candidate.is_file().then_some(candidate)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_stay_inside_the_dataset() {
        let root = Path::new("/data/scene");
        assert_eq!(inside(root, "./train/r_0"), Some(root.join("train/r_0")));
        assert_eq!(inside(root, "a/../b.png"), Some(root.join("b.png")));
        assert_eq!(inside(root, "images\\0001.png"), Some(root.join("images/0001.png")));
        assert_eq!(inside(root, "../b.png"), None);
        assert_eq!(inside(root, "a/../../b.png"), None);
        assert_eq!(inside(root, "/data/scene/a.png"), Some(root.join("a.png")));
        assert_eq!(inside(root, "/data/scene/../other/a.png"), None);
        assert_eq!(inside(root, "/etc/passwd"), None);
    }
}
