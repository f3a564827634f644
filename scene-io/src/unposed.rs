//! Photos and videos without cameras: no dataset yet, but what one is made of.

use std::path::{Path, PathBuf};

/// Endings of photos, lower case: those that are decoded here, and those of phones that other programs convert.
const PHOTOS: [&str; 8] = ["jpg", "jpeg", "png", "webp", "heic", "heif", "hif", "jpe"];
/// Endings of videos, lower case.
const VIDEOS: [&str; 12] = ["mp4", "mov", "m4v", "mkv", "webm", "avi", "mts", "m2ts", "3gp", "mpg", "mpeg", "wmv"];

/// What lies at a path that holds no cameras.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Unposed {
    /// A folder of so many photos.
    Photos {
        /// The folder they lie in: the path, or `images` in it.
        folder: PathBuf,
        /// How many there are.
        count: usize,
    },
    /// A video file.
    Video(PathBuf),
}

impl Unposed {
    /// What cameras can be found for: the folder or the file.
    #[must_use]
    pub fn path(&self) -> &Path {
        match self {
            Self::Photos { folder: path, .. } | Self::Video(path) => path,
        }
    }
}

/// Whether a file name ends like a photo.
#[must_use]
pub fn is_photo(path: &Path) -> bool {
    ends_in(path, &PHOTOS)
}

/// Whether a file name ends like a video.
#[must_use]
pub fn is_video(path: &Path) -> bool {
    ends_in(path, &VIDEOS)
}

fn ends_in(path: &Path, endings: &[&str]) -> bool {
    let extension = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    extension.is_some_and(|e| endings.contains(&e.as_str()))
}

/// Photos or a video at a path: a video file, a folder of two photos or more (in it, or in `images` in it), or a folder whose
/// only content of interest is one video. `None` for anything else; whether there is a dataset is not looked at.
#[must_use]
pub fn unposed(path: &Path) -> Option<Unposed> {
    if path.is_file() {
        return is_video(path).then(|| Unposed::Video(path.to_path_buf()));
    }
    for folder in [path.to_path_buf(), path.join("images")] {
        let count = files(&folder).filter(|p| is_photo(p)).count();
        if count >= 2 {
            return Some(Unposed::Photos { folder, count });
        }
    }
    let mut videos = files(path).filter(|p| is_video(p));
    match (videos.next(), videos.next()) {
        (Some(video), None) => Some(Unposed::Video(video)),
        _ => None,
    }
}

fn files(folder: &Path) -> impl Iterator<Item = PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten();
    entries.filter_map(|e| e.ok().map(|e| e.path())).filter(|p| p.is_file())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ErrorKind, LoadOptions, load};

    #[test]
    fn photos_and_videos_without_cameras_are_known_as_such() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        assert_eq!(unposed(folder.path()), None);
        std::fs::write(at("clip.MOV"), b"x").unwrap();
        assert_eq!(unposed(folder.path()), Some(Unposed::Video(at("clip.MOV"))));
        assert_eq!(unposed(&at("clip.MOV")), Some(Unposed::Video(at("clip.MOV"))));
        std::fs::create_dir(at("images")).unwrap();
        for name in ["images/1.heic", "images/2.webp", "3.jpg", "4.JPEG", "5.png"] {
            std::fs::write(at(name), b"x").unwrap();
        }
        assert_eq!(unposed(folder.path()), Some(Unposed::Photos { folder: folder.path().into(), count: 3 }));
        for name in ["3.jpg", "4.JPEG"] {
            std::fs::remove_file(at(name)).unwrap();
        }
        assert_eq!(unposed(folder.path()), Some(Unposed::Photos { folder: at("images"), count: 2 }));
    }

    #[test]
    fn loading_them_says_that_cameras_are_missing() {
        let folder = tempfile::tempdir().unwrap();
        let photos = folder.path().join("my photos");
        std::fs::create_dir(&photos).unwrap();
        for i in 0..3 {
            std::fs::write(photos.join(format!("{i}.jpg")), b"x").unwrap();
        }
        let error = load(&photos, &LoadOptions::default()).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::NoCameras);
        let line = error.to_string();
        assert!(line.contains("3 photos") && line.contains("prepare"), "{line}");
        let video = folder.path().join("walk.mp4");
        std::fs::write(&video, b"x").unwrap();
        let error = load(&video, &LoadOptions::default()).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::NoCameras);
        assert!(error.to_string().contains("is a video"), "{error}");
    }
}
