//! Blender scenes as NeRF published them: `transforms_train.json`, `transforms_val.json`, `transforms_test.json`.
//!
//! RGBA images with straight alpha, `file_path` without extension (`.png` is tried first), horizontal angle of view,
//! camera-to-world matrices with OpenGL axes, cameras 2 to 6 units from what they look at unless the file's `near` and
//! `far` say otherwise, or no image has alpha. `time` (D-NeRF; HDR-HexPlane's frame numbers) is read, see
//! [`crate::time`]; HDR-HexPlane's `exposures` are told, not used; `mask_path` has no agreed meaning in this dialect and is not, except in
//! `transforms_train_clutter.json`: there it is the truth about the clutter (white), which is for scoring only.

use crate::json::Document;
use crate::limits::is_depth_range;
use crate::options::{LoadOptions, Masks, TrainPhotos};
use crate::reading::{DialectSplits, MaskFolder, Reading};
use crate::transforms::raw_frame;
use crate::{ErrorKind, LayoutHint, Problem, SceneError, Split};
use std::path::{Path, PathBuf};

/// Reads the scene of a training file, `…/transforms_train.json` or one of its variants (`transforms_train_clean.json`).
pub(crate) fn read(train: &Path, options: &LoadOptions) -> Result<Reading, SceneError> {
    let root = train.parent().unwrap_or(Path::new("")).to_path_buf();
    let mut reading = Reading::new(&root);
    reading.splits = DialectSplits::Explicit;
    reading.mask_folder = MaskFolder::Unknown;
    let (mut near, mut far) = (None, None);
    let mut ignored_masks = 0;
    let mut exposures: Vec<f64> = Vec::new();
    let is_truth = train.file_name().is_some_and(|name| name == CLUTTER);
    let beside = |name: &str| Some(root.join(name)).filter(|p| p.is_file());
    let files = [
        (Some(train.to_path_buf()), Split::Train),
        (beside("transforms_val.json"), Split::Val),
        (beside("transforms_test.json"), Split::Test),
    ];
    for (file, split) in files {
        let Some(file) = file else {
            reading.notes.push(format!("no transforms_{}.json", split.name()));
            continue;
        };
        let document = Document::read(&file)?;
        let problem = |p: Problem| SceneError::new(ErrorKind::Format, p);
        let top = document.top().map_err(problem)?;
        let frames = top.objects("frames").map_err(problem)?.ok_or_else(|| no_frames(&file))?;
        if frames.is_empty() {
            let what = format!("lists no {} frames", split.name());
            let mut empty = Problem::new(&file, what, "export the split again, or remove the file").field("frames");
            if options.holdout.is_some() {
                empty = empty.warning();
            }
            reading.problems.push(empty);
        }
        near = near.or(top.number("near").map_err(problem)?);
        far = far.or(top.number("far").map_err(problem)?);
        for frame in frames {
            match raw_frame(&root, &top, &frame, split) {
                Ok(mut raw) => {
                    exposures.extend(frame.number("exposures").map_err(problem)?);
                    let mask = raw.mask.take();
                    if is_truth && split == Split::Train {
                        raw.transient = raw.transient.or(mask);
                    } else {
                        ignored_masks += usize::from(mask.is_some());
                    }
                    reading.frames.push(raw);
                }
                Err(problem) => reading.problems.push(problem),
            }
        }
    }
    if ignored_masks > 0 && options.masks == Masks::Auto {
        reading
            .notes
            .push(format!("{ignored_masks} frames name a mask_path, which has no agreed meaning here: not used"));
    }
    exposures.sort_by(f64::total_cmp);
    exposures.dedup();
    if let [first, .., last] = exposures.as_slice() {
        reading.notes.push(format!(
            "photos were taken with {} exposures ({first} to {last}): only systems with an appearance code for each photo \
             can agree with all",
            exposures.len()
        ));
    }
    reading.layout_needs_alpha = near.is_none() && far.is_none();
    let (near, far) = (near.unwrap_or(2.0), far.unwrap_or(6.0));
    if is_depth_range([near, far]) && far > near {
        reading.layout = LayoutHint::Object { near, far };
    } else {
        let problem = Problem::new(train, "must be above 0 and below far", "correct near and far, or remove both");
        reading.problems.push(problem.field("near").value(format!("{near} (far = {far})")));
    }
    Ok(reading)
}

fn no_frames(file: &Path) -> SceneError {
    let problem = Problem::new(file, "is missing", "is this a transforms file? It needs a list of frames");
    SceneError::new(ErrorKind::Format, problem.field("frames"))
}

/// The training file of a folder: `transforms_train.json`, or one of the two variants that hold cluttered and clean
/// photos. Clean ones are never replaced by others.
pub(crate) fn training_file(folder: &Path, options: &LoadOptions) -> Result<Option<PathBuf>, SceneError> {
    let file = |name: &str| Some(folder.join(name)).filter(|p| p.is_file());
    let (plain, clutter, clean) = (file("transforms_train.json"), file(CLUTTER), file("transforms_train_clean.json"));
    match options.train_photos {
        TrainPhotos::Clutter => Ok(plain.or(clutter)),
        TrainPhotos::Clean if clean.is_none() && (plain.is_some() || clutter.is_some()) => {
            let what = "has no transforms_train_clean.json, so no clean photos";
            let problem = Problem::new(folder, what, "train on the cluttered ones, which is the default");
            Err(SceneError::new(ErrorKind::Split, problem))
        }
        TrainPhotos::Clean => Ok(clean),
    }
}

/// Training file of photos with things in the way; white in the masks it names shows where.
const CLUTTER: &str = "transforms_train_clutter.json";

/// The `transforms_train*.json` files of a folder, sorted.
pub(crate) fn training_files(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .filter_map(|entry| entry.ok().map(|e| e.path()))
        .filter(|p| is_training_file(p))
        .collect();
    files.sort();
    files
}

/// Whether a file is called `transforms_train*.json`.
pub(crate) fn is_training_file(path: &Path) -> bool {
    let name = path.file_name().and_then(|n| n.to_str()).unwrap_or("");
    name.starts_with("transforms_train") && name.ends_with(".json")
}
