//! What the files of a sparse model hold.

use crate::{Point, Problem};
use render_core::camera::{Lens, Pose};
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

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
