//! The photos of a film whose cameras are not known. Their order is that of their names, so numbers in them need leading zeros.

use crate::error::PrepareError;
use render_core::camera::{Camera, Pose};
use scene_io::{Frame, ImageSource, MotionFiles, Size, images_in, photo_size};
use std::path::{Path, PathBuf};

/// Names of folders of photos, where several folders beside each other hold pictures.
const FOLDERS: [&str; 3] = ["images", "rgb", "frames"];

/// Photos of one size in the order of their names, which is that of time.
#[derive(Clone, Debug)]
pub struct Film {
    root: PathBuf,
    /// Cameras say how large the photos are, and nothing else.
    frames: Vec<Frame>,
}

impl Film {
    /// The photos in a folder, or in one folder in it: in `images`, `rgb` or `frames`, or in the only one that holds photos. `None` without photos.
    /// Headers are read.
    ///
    /// # Errors
    /// One photo alone, several folders that may be meant, photos of two sizes, and what cannot be read.
    pub fn find(root: &Path) -> Result<Option<Self>, PrepareError> {
        let photos = photos(root)?;
        let Some(first) = photos.first() else { return Ok(None) };
        if photos.len() == 1 {
            return Err(PrepareError::input(root, "holds one photo", "flow needs two at least"));
        }
        let (size, last) = (photo_size(first)?, photos.len() - 1);
        let mut frames = Vec::with_capacity(photos.len());
        for (i, photo) in photos.iter().enumerate() {
            let own = photo_size(photo)?;
            if own != size {
                let what = format!("is {own}, and {} is {size}", name(root, first));
                return Err(PrepareError::input(
                    photo,
                    what,
                    "a film has photos of one size: scale it, or take it away",
                ));
            }
            let mut frame = Frame::new(name(root, photo), ImageSource::File(photo.clone()), no_camera(size));
            frame.time = Some(i as f64 / last as f64);
            frames.push(frame);
        }
        Ok(Some(Self { root: root.to_path_buf(), frames }))
    }

    /// The folder it was found in.
    #[must_use]
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Number of photos, two at least.
    #[must_use]
    pub fn count(&self) -> usize {
        self.frames.len()
    }

    pub(super) fn frames(&self) -> &[Frame] {
        &self.frames
    }
}

/// The path of a photo as seen from the folder.
fn name(root: &Path, photo: &Path) -> String {
    photo.strip_prefix(root).unwrap_or(photo).display().to_string()
}

/// What stands for a camera of which nothing is known but the size of its photos.
fn no_camera(size: Size) -> Camera {
    let (width, height) = (f64::from(size.width), f64::from(size.height));
    let focal = width.max(height);
    Camera::pinhole(size.width, size.height, focal, focal, 0.5 * width, 0.5 * height, Pose::IDENTITY)
}

/// The photos that are meant, sorted by name.
fn photos(root: &Path) -> Result<Vec<PathBuf>, PrepareError> {
    let own = shown(root)?;
    if own.len() > 1 {
        return Ok(own);
    }
    let entries = std::fs::read_dir(root).map_err(PrepareError::io(root, "list the folder"))?;
    let mut inside: Vec<(PathBuf, Vec<PathBuf>)> = Vec::new();
    for entry in entries {
        let folder = entry.map_err(PrepareError::io(root, "list the folder"))?.path();
        // What was made of the photos is none of them.
        if folder.is_dir() && !folder.ends_with(MotionFiles::MADE) && !is_hidden(&folder) {
            let photos = shown(&folder)?;
            inside.extend((!photos.is_empty()).then_some((folder, photos)));
        }
    }
    inside.sort();
    let known = FOLDERS.iter().find_map(|name| inside.iter().position(|(folder, _)| folder.ends_with(name)));
    if let Some(k) = known {
        return Ok(inside.swap_remove(k).1);
    }
    if inside.len() > 1 {
        let names: Vec<String> = inside.iter().map(|(folder, _)| name(root, folder)).collect();
        let what = format!("holds several folders of pictures: {}", names.join(", "));
        return Err(PrepareError::input(root, what, "give the one that holds the photos of the film"));
    }
    Ok(inside.pop().map_or(own, |(_, photos)| photos))
}

/// The photos of one folder. Hidden files belong to programs.
fn shown(folder: &Path) -> Result<Vec<PathBuf>, PrepareError> {
    let mut photos = images_in(folder)?;
    photos.retain(|photo| !is_hidden(photo));
    Ok(photos)
}

fn is_hidden(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'))
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::RgbImage;

    fn folder_of(photos: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for photo in photos {
            write(folder.path(), photo, 6);
        }
        folder
    }

    fn write(folder: &Path, photo: &str, width: u32) {
        let path = folder.join(photo);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        RgbImage::new(width, 4).save(path).unwrap();
    }

    fn names(folder: &Path) -> Vec<String> {
        let film = Film::find(folder).unwrap();
        film.map(|film| film.frames.iter().map(|frame| frame.name.clone()).collect()).unwrap_or_default()
    }

    fn said(folder: &Path) -> String {
        Film::find(folder).unwrap_err().to_string()
    }

    #[test]
    fn photos_are_in_the_order_of_their_names() {
        let folder = folder_of(&["b.png", "a.png", "c.png", ".d.png", "a.mask.png", "deep/e.png"]);
        std::fs::write(folder.path().join("notes.txt"), b"x").unwrap();
        assert_eq!(names(folder.path()), ["a.png", "b.png", "c.png"]);
        let film = Film::find(folder.path()).unwrap().unwrap();
        let times: Vec<Option<f64>> = film.frames().iter().map(|frame| frame.time).collect();
        assert_eq!((times, film.count()), (vec![Some(0.0), Some(0.5), Some(1.0)], 3));
        assert_eq!(Size::from(&film.frames()[0].camera), Size::new(6, 4));
        assert_eq!(film.root(), folder.path());
    }

    #[test]
    fn the_folder_of_the_photos_is_found_in_that_of_the_film() {
        let film = folder_of(&["rgb/2.png", "rgb/1.png", "mask/1.png", "mask/2.png", "priors/1.png", "poster.png"]);
        assert_eq!(names(film.path()), ["rgb/1.png", "rgb/2.png"]);
        let film = folder_of(&["JPEGImages/2.png", "JPEGImages/1.png", ".thumbs/1.png"]);
        assert_eq!(names(film.path()), ["JPEGImages/1.png", "JPEGImages/2.png"]);
        assert!(Film::find(folder_of(&["a/b/1.png", "a/b/2.png"]).path()).unwrap().is_none());
        assert!(Film::find(tempfile::tempdir().unwrap().path()).unwrap().is_none());
    }

    #[test]
    fn what_is_no_film_is_said() {
        let one = folder_of(&["a.png"]);
        assert!(said(one.path()).contains("holds one photo; flow needs two"), "{}", said(one.path()));
        assert!(said(folder_of(&["rgb/a.png"]).path()).contains("holds one photo"));
        let several = folder_of(&["left/1.png", "left/2.png", "right/1.png"]);
        assert!(said(several.path()).contains("several folders of pictures: left, right"), "{}", said(several.path()));
        let sizes = folder_of(&["rgb/a.png", "rgb/b.png"]);
        write(sizes.path(), "rgb/c.png", 5);
        let line = said(sizes.path());
        assert!(line.contains("c.png: is 5x4, and rgb/a.png is 6x4"), "{line}");
        std::fs::write(sizes.path().join("rgb/b.png"), b"no picture").unwrap();
        assert!(said(sizes.path()).contains("b.png"), "{}", said(sizes.path()));
    }
}
