//! Which dialect a path is written in.

use crate::colmap::{self, ModelFiles};
use crate::json::Document;
use crate::options::{LoadOptions, TrainPhotos};
use crate::unposed::{Unposed, unposed};
use crate::{Dialect, ErrorKind, Problem, SceneError, blender, endonerf};
use std::path::{Path, PathBuf};

/// A dialect and its main file.
#[derive(Debug)]
pub(crate) enum Found {
    /// The training file.
    Blender(PathBuf),
    /// A parsed `transforms.json` of either family.
    Transforms(Dialect, Document),
    /// Dataset folder and models, best first.
    Colmap(PathBuf, Vec<ModelFiles>),
    /// `poses_bounds.npy`.
    Llff(PathBuf),
    /// `precomputed.json`.
    NrNerf(PathBuf),
    /// `dataset.json`.
    Nerfies(PathBuf),
    /// `poses_bounds.npy` of an endoscope.
    EndoNerf(PathBuf),
}

impl Found {
    pub(crate) fn dialect(&self) -> Dialect {
        match self {
            Self::Blender(_) => Dialect::Blender,
            Self::Transforms(dialect, _) => *dialect,
            Self::Colmap(..) => Dialect::Colmap,
            Self::Llff(_) => Dialect::Llff,
            Self::NrNerf(_) => Dialect::NrNerf,
            Self::Nerfies(_) => Dialect::Nerfies,
            Self::EndoNerf(_) => Dialect::EndoNerf,
        }
    }

    /// The main file or folder, for messages.
    pub(crate) fn place(&self) -> &Path {
        match self {
            Self::Blender(path) | Self::Colmap(path, _) | Self::Llff(path) => path,
            Self::NrNerf(path) | Self::Nerfies(path) | Self::EndoNerf(path) => path,
            Self::Transforms(_, document) => &document.file,
        }
    }
}

/// What a folder is searched for, in this order.
const LOOKED_FOR: &str = "transforms_train.json (blender), transforms_train_clutter.json, transforms.json (instant-ngp, nerfstudio), dataset.json \
                          with camera/ (nerfies), precomputed.json (nr-nerf), sparse/0 with cameras and images (colmap), \
                          poses_bounds.npy (llff), the same with the identity in every row (endonerf)";

/// Finds the dialect of a folder or file, and what else the folder holds.
///
/// A folder may hold several dialects; the first of `blender`, `transforms.json`, Nerfies, NR-NeRF, a complete COLMAP
/// model, EndoNeRF or LLFF is taken unless [`LoadOptions::dialect`] says otherwise: COLMAP before LLFF because it knows the
/// lens, those with times before it because it has none. EndoNeRF's pose file is told from LLFF's by its poses, which are
/// all the identity.
pub(crate) fn detect(path: &Path, options: &LoadOptions) -> Result<(Found, Vec<String>), SceneError> {
    if let Err(error) = std::fs::metadata(path) {
        return Err(SceneError::io(path, "open the dataset", error));
    }
    let wanted = |dialect: Dialect| options.dialect.is_none_or(|d| d == dialect);
    if path.is_file() {
        return file(path, options).map(|found| (found, Vec::new()));
    }
    let mut found = Vec::new();
    if wanted(Dialect::Blender)
        && let Some(train) = blender::training_file(path, options)?
    {
        found.push(Found::Blender(train));
    }
    let transforms = path.join("transforms.json");
    if (wanted(Dialect::InstantNgp) || wanted(Dialect::Nerfstudio)) && found.is_empty() && transforms.is_file() {
        found.push(transforms_file(&transforms, options)?);
    }
    let dataset = path.join("dataset.json");
    if wanted(Dialect::Nerfies) && dataset.is_file() && path.join("camera").is_dir() {
        found.push(Found::Nerfies(dataset));
    }
    let precomputed = path.join("precomputed.json");
    if wanted(Dialect::NrNerf) && precomputed.is_file() {
        found.push(Found::NrNerf(precomputed));
    }
    let models = if wanted(Dialect::Colmap) { colmap::find_models(path) } else { Vec::new() };
    if let Some(first) = models.first() {
        let root = if first.folder == path { colmap::dataset_root(path) } else { path.to_path_buf() };
        let root = if path.file_name().is_some_and(|n| n == "sparse") { colmap::dataset_root(path) } else { root };
        found.push(Found::Colmap(root, models));
    }
    if let Some(poses) = endonerf::POSE_FILES.into_iter().map(|name| path.join(name)).find(|p| p.is_file()) {
        found.extend(pose_file(&poses, options));
    }
    let mut found = found.into_iter();
    let Some(first) = found.next() else { return Err(nothing(path, options)) };
    let mut notes: Vec<String> = found
        .map(|other| {
            let (dialect, used) = (other.dialect(), first.dialect());
            format!("holds {} too: `--format {dialect}` reads that instead of {used}", other.place().display())
        })
        .collect();
    notes.sort();
    Ok((first, notes))
}

fn file(path: &Path, options: &LoadOptions) -> Result<Found, SceneError> {
    let name = path.file_name().and_then(|n| n.to_str()).unwrap_or("");
    if blender::is_training_file(path) && options.dialect.is_none_or(|d| d == Dialect::Blender) {
        if options.train_photos == TrainPhotos::Clean && !name.ends_with("_clean.json") {
            let what = "is not the file of clean photos, which were asked for";
            return Err(SceneError::new(ErrorKind::Split, Problem::new(path, what, "give the dataset's folder")));
        }
        return Ok(Found::Blender(path.to_path_buf()));
    }
    if ["dataset.json", "metadata.json", "scene.json"].contains(&name)
        && let Some(dataset) = path.parent().map(|p| p.join("dataset.json")).filter(|p| p.is_file())
    {
        return Ok(Found::Nerfies(dataset));
    }
    if name == "precomputed.json" {
        return Ok(Found::NrNerf(path.to_path_buf()));
    }
    if name.ends_with(".json") {
        return transforms_file(path, options);
    }
    if name.ends_with(".npy") {
        return Ok(pose_file(path, options).unwrap_or_else(|| Found::Llff(path.to_path_buf())));
    }
    let stem = path.file_stem().and_then(|n| n.to_str()).unwrap_or("");
    if ["cameras", "images", "points3D"].contains(&stem)
        && let Some(folder) = path.parent()
        && let Some(model) = ModelFiles::find(folder)
    {
        return Ok(Found::Colmap(colmap::dataset_root(folder), vec![model]));
    }
    if options.dialect.is_none()
        && let Some(found) = unposed(path)
    {
        return Err(without_cameras(path, &found));
    }
    let what = "is not a dataset file: expected transforms*.json, poses_bounds.npy or a file of a COLMAP model";
    Err(SceneError::new(ErrorKind::Layout, Problem::new(path, what, "give the dataset's folder")))
}

/// Whose pose file it is: EndoNeRF's if asked for, or if its poses or its name say so.
fn pose_file(path: &Path, options: &LoadOptions) -> Option<Found> {
    let misspelt = path.file_name().is_some_and(|n| n == endonerf::POSE_FILES[1]);
    let endonerf = || Some(Found::EndoNerf(path.to_path_buf()));
    match options.dialect {
        Some(Dialect::EndoNerf) => endonerf(),
        Some(Dialect::Llff) => Some(Found::Llff(path.to_path_buf())),
        Some(_) => None,
        None if misspelt || endonerf::is_still(path) => endonerf(),
        None => Some(Found::Llff(path.to_path_buf())),
    }
}

/// Keys that only nerfstudio writes.
const NERFSTUDIO_TOP: [&str; 8] = [
    "camera_model",
    "applied_transform",
    "applied_scale",
    "ply_file_path",
    "orientation_override",
    "train_filenames",
    "val_filenames",
    "test_filenames",
];

fn transforms_file(path: &Path, options: &LoadOptions) -> Result<Found, SceneError> {
    let document = Document::read(path)?;
    let dialect = match options.dialect {
        Some(dialect @ (Dialect::InstantNgp | Dialect::Nerfstudio)) => dialect,
        _ => {
            let top = document.top().map_err(|p| SceneError::new(ErrorKind::Format, p))?;
            let frame = top.objects("frames").ok().flatten().and_then(|f| f.into_iter().next());
            let in_frame = |key| frame.as_ref().is_some_and(|f| f.has(key));
            let nerfstudio = NERFSTUDIO_TOP.iter().any(|key| top.has(key))
                || ["mask_path", "depth_file_path", "fl_x", "camera_model"].into_iter().any(in_frame);
            let ngp = top.has("aabb_scale") || in_frame("sharpness");
            if nerfstudio && !ngp { Dialect::Nerfstudio } else { Dialect::InstantNgp }
        }
    };
    Ok(Found::Transforms(dialect, document))
}

/// Whether a path holds photos or a video and nothing that says where they were taken.
#[must_use]
pub fn lacks_cameras(path: &Path, options: &LoadOptions) -> bool {
    detect(path, options).is_err_and(|error| error.kind() == ErrorKind::NoCameras)
}

/// Whether a path is a folder in which nothing says where photos were taken: no dataset, no COLMAP model that lacks files, and no folder
/// with a dataset in it. Photos may be there.
#[must_use]
pub fn holds_no_dataset(path: &Path) -> bool {
    let is_none = |error: SceneError| matches!(error.kind(), ErrorKind::Layout | ErrorKind::NoCameras);
    path.is_dir()
        && detect(path, &LoadOptions::default()).is_err_and(is_none)
        && blender::training_files(path).is_empty()
        && incomplete_model(path).is_none()
        && datasets_in(path).is_empty()
}

/// Photos are there, and nothing that says where they were taken.
fn without_cameras(path: &Path, found: &Unposed) -> SceneError {
    let what = match found {
        Unposed::Photos { folder, count } if folder == path => format!("holds {count} photos and no cameras"),
        Unposed::Photos { folder, count } => format!("holds {count} photos (in {}) and no cameras", folder.display()),
        Unposed::Video(video) if video == path => "is a video without cameras".into(),
        Unposed::Video(video) => format!("holds a video without cameras: {}", video.display()),
    };
    let remedy = "find out first where they were taken, with the command `prepare`";
    SceneError::new(ErrorKind::NoCameras, Problem::new(path, what, remedy))
}

fn nothing(path: &Path, options: &LoadOptions) -> SceneError {
    let variants = blender::training_files(path);
    if let [first, ..] = variants.as_slice() {
        let names: Vec<String> = variants.iter().map(|v| v.display().to_string()).collect();
        let what = format!("holds no transforms_train.json, but {}", names.join(", "));
        let remedy = format!("give one of them as the path, for example {}", first.display());
        return SceneError::new(ErrorKind::Layout, Problem::new(path, what, remedy));
    }
    let mut what = match options.dialect {
        Some(dialect) => format!("holds no {dialect} dataset; looked for {LOOKED_FOR}"),
        None => format!("holds no dataset that is known; looked for {LOOKED_FOR}"),
    };
    let incomplete = incomplete_model(path);
    if let Some(folder) = &incomplete {
        what.push_str(&format!("; the COLMAP model in {} lacks its cameras or images file", folder.display()));
    }
    let folders = datasets_in(path);
    if options.dialect.is_none()
        && folders.is_empty()
        && incomplete.is_none()
        && let Some(found) = unposed(path)
    {
        return without_cameras(path, &found);
    }
    let remedy = match folders.first() {
        Some(folder) => format!("a folder in it holds one: {}", folder.display()),
        None => "give the folder that holds one of these".into(),
    };
    SceneError::new(ErrorKind::Layout, Problem::new(path, what, remedy))
}

/// A folder with cameras or images of a COLMAP model; where no model was found, the other file is missing.
fn incomplete_model(path: &Path) -> Option<PathBuf> {
    ["sparse/0", "sparse", "."].iter().map(|s| path.join(s)).find(|folder| {
        let has = |name: &str| folder.join(name).is_file();
        has("cameras.bin") || has("cameras.txt") || has("images.bin") || has("images.txt")
    })
}

/// Folders in a folder that hold a dataset, by name.
fn datasets_in(path: &Path) -> Vec<PathBuf> {
    const FILES: [&str; 5] =
        ["transforms_train.json", "transforms.json", "poses_bounds.npy", "precomputed.json", "dataset.json"];
    let entries = std::fs::read_dir(path).into_iter().flatten();
    let mut folders: Vec<PathBuf> = entries
        .filter_map(|e| e.ok().map(|e| e.path()))
        .filter(|p| FILES.iter().any(|name| p.join(name).is_file()))
        .collect();
    folders.sort();
    folders
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn photos_alone_are_no_dataset_and_a_part_of_one_is_more_than_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir_all(at("rgb")).unwrap();
        std::fs::write(at("rgb/1.jpg"), b"x").unwrap();
        assert!(holds_no_dataset(folder.path()) && holds_no_dataset(&at("rgb")));
        assert!(!holds_no_dataset(&at("rgb/1.jpg")) && !holds_no_dataset(&at("nowhere")));
        for part in ["sparse/0/images.bin", "transforms_train_b.json", "inner/poses_bounds.npy", "transforms.json"] {
            std::fs::create_dir_all(at(part).parent().unwrap()).unwrap();
            std::fs::write(at(part), b"x").unwrap();
            assert!(!holds_no_dataset(folder.path()), "{part}");
            std::fs::remove_file(at(part)).unwrap();
        }
        assert!(holds_no_dataset(folder.path()));
    }
}
