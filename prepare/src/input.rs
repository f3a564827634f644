//! What lies at a path: a video, or photos, and what is neither.

use crate::error::PrepareError;
use scene_io::{is_photo, is_video};
use std::path::{Path, PathBuf};

/// Folders within folders that are searched.
const DEEPEST: usize = 4;

/// What cameras are found for.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Input {
    Video(PathBuf),
    Photos(Photos),
}

/// The photos of a folder.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Photos {
    /// Sorted by path.
    pub(crate) files: Vec<PathBuf>,
    /// Files that are not photos.
    pub(crate) others: Vec<PathBuf>,
}

impl Input {
    /// Reads what lies at a path.
    ///
    /// # Errors
    /// [`PrepareError`] where it is neither a video nor a folder of at least two photos.
    pub(crate) fn find(path: &Path) -> Result<Self, PrepareError> {
        let about = path.metadata().map_err(PrepareError::io(path, "open the photos or the video"))?;
        if about.is_dir() {
            let mut photos = Photos::default();
            list(path, DEEPEST, &mut photos)?;
            photos.files.sort();
            photos.others.sort();
            return match (photos.files.len(), photos.others.iter().find(|p| is_video(p))) {
                (0 | 1, Some(video)) => {
                    let what = format!("holds {} photos and a video", photos.files.len());
                    Err(PrepareError::input(path, what, format!("give the video itself: {}", video.display())))
                }
                (0, None) => {
                    let remedy = "give a folder of JPEG, PNG, WebP or HEIC photos, or a video file";
                    Err(PrepareError::input(path, "holds no photos", remedy))
                }
                (1, None) => {
                    Err(PrepareError::input(path, "holds one photo", "cameras need at least two, better thirty"))
                }
                _ => Ok(Self::Photos(photos)),
            };
        }
        if is_photo(path) {
            return Err(PrepareError::input(path, "is one photo", "give the folder of all photos"));
        }
        // A video by its name, or by what ffprobe says of it.
        Ok(Self::Video(path.to_path_buf()))
    }
}

fn list(folder: &Path, deeper: usize, found: &mut Photos) -> Result<(), PrepareError> {
    let entries = std::fs::read_dir(folder).map_err(PrepareError::io(folder, "list the folder"))?;
    for entry in entries {
        let path = entry.map_err(PrepareError::io(folder, "list the folder"))?.path();
        // Hidden files and folders belong to programs: thumbnails, folder settings.
        if path.file_name().is_some_and(|n| n.to_string_lossy().starts_with('.')) {
            continue;
        }
        match () {
            () if path.is_dir() && deeper > 0 => list(&path, deeper - 1, found)?,
            () if path.is_dir() => {}
            () if is_photo(&path) => found.files.push(path),
            () => found.others.push(path),
        }
    }
    Ok(())
}

/// Names for the pictures of a scene: without blanks, which COLMAP's text files cannot hold, each once, folders joined with
/// `_`. In the order of `files`; `ending` is that of each.
pub(crate) fn names(root: &Path, files: &[PathBuf], ending: impl Fn(&Path) -> &'static str) -> Vec<String> {
    let mut used = std::collections::HashSet::new();
    files
        .iter()
        .map(|file| {
            let relative = file.strip_prefix(root).unwrap_or(file).with_extension("");
            let parts: Vec<_> = relative.components().map(|c| c.as_os_str().to_string_lossy()).collect();
            let stem: String =
                parts.join("_").chars().map(|c| if c.is_whitespace() || c.is_control() { '_' } else { c }).collect();
            let stem = if stem.is_empty() { "photo".to_string() } else { stem };
            let ending = ending(file);
            let candidates = std::iter::once(stem.clone()).chain((2..).map(|n| format!("{stem}_{n}")));
            // Some systems do not tell letters of either case apart, and masks go by the stem.
            let free = candidates.into_iter().find(|name| used.insert(name.to_lowercase())).unwrap_or(stem);
            format!("{free}.{ending}")
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder_of(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for name in names {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, b"x").unwrap();
        }
        folder
    }

    #[test]
    fn photos_are_told_from_other_files() {
        let folder = folder_of(&["b.JPG", "a.heic", "notes.txt", ".DS_Store", "deep/er/c.webp", "clip.mov"]);
        let Ok(Input::Photos(photos)) = Input::find(folder.path()) else { panic!() };
        let short = |list: &[PathBuf]| -> Vec<String> {
            list.iter().map(|p| p.strip_prefix(folder.path()).unwrap().to_string_lossy().into_owned()).collect()
        };
        assert_eq!(short(&photos.files), ["a.heic", "b.JPG", "deep/er/c.webp"]);
        assert_eq!(short(&photos.others), ["clip.mov", "notes.txt"]);
    }

    #[test]
    fn what_is_no_capture_is_said() {
        let said = |folder: &tempfile::TempDir| Input::find(folder.path()).unwrap_err().to_string();
        assert!(said(&folder_of(&["a.txt"])).contains("holds no photos"));
        assert!(said(&folder_of(&["a.jpg"])).contains("at least two"));
        assert!(said(&folder_of(&["a.jpg", "b.mp4"])).contains("b.mp4"));
        let one = folder_of(&["a.jpg", "b.mp4"]);
        assert!(Input::find(&one.path().join("a.jpg")).unwrap_err().to_string().contains("is one photo"));
        assert_eq!(Input::find(&one.path().join("b.mp4")).unwrap(), Input::Video(one.path().join("b.mp4")));
        assert!(Input::find(&one.path().join("none")).unwrap_err().to_string().contains("cannot open"));
    }

    #[test]
    fn names_have_no_blanks_and_come_once() {
        let root = Path::new("/p");
        let files = ["a b.jpg", "a_b.png", "sub/A b.HEIC", "sub_a_b.jpg"].map(|f| root.join(f));
        assert_eq!(names(root, &files, |_| "jpg"), ["a_b.jpg", "a_b_2.jpg", "sub_A_b.jpg", "sub_a_b_2.jpg"]);
    }
}
