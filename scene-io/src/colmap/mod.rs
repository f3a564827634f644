//! COLMAP sparse models, binary and text.
//!
//! A [`Model`] is what the files `cameras`, `images` and `points3D` hold, either ending; `rigs` and `frames` of newer
//! versions repeat it and are not read. Poses are world-to-camera with CV axes in the files and camera-to-world here;
//! pixel coordinates agree with ours (the upper left corner of the image is the origin).
//!
//! <https://colmap.github.io/format.html>

mod binary;
mod lens;
mod scene;
mod text;

use crate::{ErrorKind, Point, Problem, SceneError};
use render_core::camera::{Lens, Pose};
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

pub(crate) use scene::{dataset_root, find_models, read};

/// A sparse reconstruction.
#[derive(Clone, Debug, Default)]
pub struct Model {
    /// Cameras by id.
    pub cameras: BTreeMap<u32, ModelCamera>,
    /// Registered images, sorted by name.
    pub images: Vec<ModelImage>,
    /// Points by id; empty where the model has no `points3D` file.
    pub points: HashMap<u64, Point>,
    /// What was mended or is missing.
    pub notes: Vec<String>,
    /// Images whose pose cannot be.
    pub problems: Vec<Problem>,
}

/// Intrinsics shared by images.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModelCamera {
    /// Columns of the image.
    pub width: u32,
    /// Rows of the image.
    pub height: u32,
    /// Focal length along x, pixels.
    pub fx: f64,
    /// Focal length along y, pixels.
    pub fy: f64,
    /// Principal point, x.
    pub cx: f64,
    /// Principal point, y.
    pub cy: f64,
    /// Lens model.
    pub lens: Lens,
}

/// A registered image.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelImage {
    /// Id in the model; neither contiguous nor in the order of names.
    pub id: u32,
    /// Name relative to the images' folder.
    pub name: String,
    /// Key of [`Model::cameras`].
    pub camera_id: u32,
    /// Camera-to-world pose.
    pub pose: Pose,
    /// Keys of [`Model::points`] seen in this image.
    pub point_ids: Vec<u64>,
    /// Where they are seen, column and row, in the same order.
    pub pixels: Vec<[f32; 2]>,
}

/// The files of a model.
#[derive(Clone, Debug)]
pub(crate) struct ModelFiles {
    pub(crate) folder: PathBuf,
    pub(crate) cameras: PathBuf,
    pub(crate) images: PathBuf,
    pub(crate) points: Option<PathBuf>,
}

impl ModelFiles {
    /// The files of a folder, binary before text; `None` where cameras or images are not there.
    pub(crate) fn find(folder: &Path) -> Option<Self> {
        let file = |stem: &str| {
            ["bin", "txt"].into_iter().map(|e| folder.join(format!("{stem}.{e}"))).find(|path| path.is_file())
        };
        Some(Self {
            folder: folder.to_path_buf(),
            cameras: file("cameras")?,
            images: file("images")?,
            points: file("points3D"),
        })
    }
}

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
