//! Which of `images`, `images_2`, `images_4`, … to read, for dialects whose cameras stand apart from the images.

use crate::files::{images_in, is_image};
use crate::options::LoadOptions;
use crate::picture::{Plan, foreign};
use crate::{ErrorKind, Problem, SceneError};
use std::path::{Path, PathBuf};

/// The images' folder: the one the caller names; else of the folders `images*` under the root the smallest whose
/// images have the longest side wanted (the largest where none has, or nothing is wanted); else the root itself, where
/// it holds the first of `names`.
pub(crate) fn find(root: &Path, options: &LoadOptions, names: &[&str]) -> Result<PathBuf, SceneError> {
    if let Some(folder) = &options.images {
        if folder.is_dir() {
            return Ok(folder.clone());
        }
        let problem = Problem::new(folder, "is not a folder", "give the folder of the images");
        return Err(SceneError::new(ErrorKind::Layout, problem));
    }
    let mut sized: Vec<(u32, PathBuf)> =
        candidates(root).into_iter().filter_map(|folder| longest_side(&folder, names).map(|s| (s, folder))).collect();
    sized.sort();
    let wanted = options.longest_side.unwrap_or(u32::MAX);
    let chosen = sized.iter().find(|(side, _)| *side >= wanted).or(sized.last());
    if let Some((_, folder)) = chosen {
        return Ok(folder.clone());
    }
    if names.first().is_some_and(|name| root.join(name).is_file()) {
        return Ok(root.to_path_buf());
    }
    let folders = candidates(root).into_iter().chain([root.to_path_buf()]);
    if let Some(refusal) = folders.filter_map(|folder| foreign::first_in(&folder)).find_map(|p| foreign::refusal(&p)) {
        return Err(refusal);
    }
    let what = "holds no folder of images: looked for `images`, `images_2`, `images_4`, `images_8`, …";
    let remedy = "put the images into `images`, or name their folder";
    Err(SceneError::new(ErrorKind::Layout, Problem::new(root, what, remedy)))
}

/// Folders called `images` or `images_N`.
fn candidates(root: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(root).into_iter().flatten();
    let mut folders: Vec<PathBuf> = entries
        .filter_map(|e| e.ok().map(|e| e.path()))
        .filter(|p| p.is_dir() && p.file_name().and_then(|n| n.to_str()).is_some_and(is_images_name))
        .collect();
    folders.sort();
    folders
}

fn is_images_name(name: &str) -> bool {
    match name.strip_prefix("images") {
        Some("") => true,
        Some(rest) => rest.strip_prefix('_').is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit())),
        None => false,
    }
}

/// The longest side of an image of a folder: of the first readable one; 0 if none is readable; `None` without images.
fn longest_side(folder: &Path, names: &[&str]) -> Option<u32> {
    let named = names.iter().map(|name| folder.join(name)).filter(|p| is_image(p) && p.is_file());
    let any = images_in(folder).unwrap_or_default();
    let mut seen = false;
    for path in named.chain(any) {
        seen = true;
        if let Ok(header) = Plan::of(&path) {
            return Some(header.size.longest_side());
        }
    }
    // Images in subfolders (COLMAP names may hold them) are not listed above.
    let has_named = names.iter().any(|name| folder.join(name).is_file());
    (seen || has_named).then_some(0)
}
