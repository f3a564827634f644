//! COLMAP sparse models, binary and text.
//!
//! A [`Model`] is what the files `cameras`, `images` and `points3D` hold, either ending; `rigs` and `frames` of newer
//! versions repeat it and are not read. Poses are world-to-camera with CV axes in the files and camera-to-world here;
//! pixel coordinates agree with ours (the upper left corner of the image is the origin).
//!
//! <https://colmap.github.io/format.html>

mod binary;
mod lens;
mod model;
mod scene;
mod text;

use crate::{ErrorKind, Point, Problem, SceneError};
use std::collections::HashMap;
use std::path::Path;

pub(crate) use model::ModelFiles;
pub use model::{Model, ModelCamera, ModelImage};
pub(crate) use scene::{dataset_root, find_models, read};

impl Model {
    /// Reads the model of a folder such as `sparse/0`, binary files before text files.
    ///
    /// # Errors
    /// Where `cameras` or `images` are missing, a file is cut off or holds counts that it cannot, or a camera model is
    /// unknown. Images with impossible poses become [`Model::problems`].
    pub fn read(folder: &Path) -> Result<Self, SceneError> {
        let files = ModelFiles::find(folder).ok_or_else(|| {
            let what = "holds no COLMAP model: cameras.bin or cameras.txt with images.bin or images.txt";
            SceneError::new(ErrorKind::Layout, Problem::new(folder, what, "give the folder of a sparse model"))
        })?;
        Self::read_files(&files)
    }

    pub(crate) fn read_files(files: &ModelFiles) -> Result<Self, SceneError> {
        let mut model = Self::default();
        if is_text(&files.cameras) {
            text::cameras(&files.cameras, &mut model)?
        } else {
            binary::cameras(&files.cameras, &mut model)?
        };
        if is_text(&files.images) {
            text::images(&files.images, &mut model)?
        } else {
            binary::images(&files.images, &mut model)?
        };
        match &files.points {
            Some(path) => model.points = read_points(path)?,
            None => model.notes.push("the model has no points3D file".into()),
        }
        model.images.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(model)
    }
}

/// The points of a `points3D` file by id.
pub(crate) fn read_points(path: &Path) -> Result<HashMap<u64, Point>, SceneError> {
    if is_text(path) { text::points(path) } else { binary::points(path) }
}

fn is_text(path: &Path) -> bool {
    path.extension().is_some_and(|e| e == "txt")
}
