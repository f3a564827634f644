//! EndoNeRF: a stereo endoscope that stands still, and tissue that moves before it.
//!
//! | file | holds |
//! | --- | --- |
//! | `poses_bounds.npy` | LLFF's rows, but the columns of the rotation are (right, up, backwards): the identity in every row |
//! | `images/` | one picture a time step, in the order of the names |
//! | `masks/` | tools, white = **tool**: ignore masks here |
//! | `depth/` | depth from stereo along the optical axis, 8 or 16-bit PNG, `.npy` or `.exr`; 0 = not known |
//! | `gt_masks/` | where tools truly are, white = tool: truth to score against |
//!
//! Folders are matched by the order of names (`frame-000000.color.png`, `frame-000000.mask.png`). Poses are not recentred and
//! nothing is scaled: the world unit is that of the depth maps. Times are `i / (n - 1)`. All frames are trained on, as
//! EndoNeRF does, unless the caller holds some out. A frame that its mask covers whole is left out with a warning. The README
//! of EndoNeRF calls the pose file `pose_bounds.npy`; that is read, too.

use crate::depth::DepthSource;
use crate::files::is_image;
use crate::listing::listing;
use crate::llff::{Row, images_of, rows};
use crate::options::{LoadOptions, Masks};
use crate::picture::{Plan, same_shape, with_mask};
use crate::pose::Axes;
use crate::reading::{DialectSplits, Need, RawFrame, Reading};
use crate::{ErrorKind, MaskPolarity, Problem, SceneError, time};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// What the pose file is called, and what the README calls it.
pub(crate) const POSE_FILES: [&str; 2] = ["poses_bounds.npy", "pose_bounds.npy"];

/// Whether a pose file is that of a camera that stands still at the origin, which LLFF's own poses never are.
pub(crate) fn is_still(file: &Path) -> bool {
    const IDENTITY: [f64; 12] = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let is_identity = |row: &[f64; 17]| {
        let pose = (0..15).filter(|at| at % 5 != 4).map(|at| row[at]);
        pose.zip(IDENTITY).all(|(a, b)| (a - b).abs() < 1e-9)
    };
    rows(file).is_ok_and(|rows| !rows.is_empty() && rows.iter().all(is_identity))
}

pub(crate) fn read(file: &Path, options: &LoadOptions, need: Need) -> Result<Reading, SceneError> {
    let root = file.parent().unwrap_or(Path::new(""));
    let mut reading = Reading::new(root);
    reading.splits = DialectSplits::Explicit;
    reading.mask_polarity = MaskPolarity::WhiteIsIgnored;
    if file.file_name().is_some_and(|name| name == POSE_FILES[1]) {
        reading.notes.push(format!("{} is a misspelling of {}: read all the same", POSE_FILES[1], POSE_FILES[0]));
    }
    let rows = rows(file)?;
    let (folder, images) =
        images_of(file, rows.len(), root, options, need).map_err(|e| name_folders(root, &rows, e))?;
    for (i, (image, values)) in images.iter().zip(&rows).enumerate() {
        let field = |at: usize| format!("[{i}, {at}]");
        match (Row { file, image, whole: format!("[{i}, :]"), field: &field, values, axes: Axes::Gl }).frame() {
            Ok(mut raw) => {
                raw.time = Some(time::by_order(i, rows.len()));
                reading.frames.push(raw);
            }
            Err(problem) => reading.problems.push(problem),
        }
    }
    reading.notes.push(format!("times by the order of the {} images' names, 0 to 1", rows.len()));
    // With a bad row left out, the order of names no longer matches; the row is an error anyway.
    if reading.frames.len() == rows.len() {
        companions(&folder, &mut reading, options)?;
        if need == Need::Images {
            sizes(&mut reading);
            leave_out_covered(root, &mut reading)?;
        }
    }
    reading.images_folder = Some(folder);
    Ok(reading)
}

/// What is missing where there are poses alone, in one line.
fn name_folders(root: &Path, rows: &[[f64; 17]], error: SceneError) -> SceneError {
    if error.kind() != ErrorKind::Layout || root.join("images").is_dir() {
        return error;
    }
    let what = format!(
        "holds no folder of images: there are {} poses, and EndoNeRF's form has `images`, `masks` and `depth` beside them",
        rows.len()
    );
    SceneError::new(ErrorKind::Layout, Problem::new(root, what, "add the three folders"))
}

/// Masks, depth maps and truth of the frames, matched by the order of names.
fn companions(folder: &Path, reading: &mut Reading, options: &LoadOptions) -> Result<(), SceneError> {
    if options.masks == Masks::Auto {
        match files_of(folder, "masks", &["png", "jpg", "jpeg"], reading.frames.len())? {
            Some(masks) => put(reading, masks, |frame, mask| frame.mask = Some(mask)),
            None => reading.notes.push("no folder `masks`: nothing counts as a tool".into()),
        }
    }
    match files_of(folder, "depth", &["png", "npy", "exr"], reading.frames.len())? {
        Some(maps) => put(reading, maps, |frame, map| frame.depth = Some(DepthSource::file(map))),
        None => reading.notes.push("no folder `depth`: a camera that stands still shows no depth by itself".into()),
    }
    if let Some(truth) = files_of(folder, "gt_masks", &["png", "jpg", "jpeg"], reading.frames.len())? {
        put(reading, truth, |frame, mask| frame.transient = Some(mask));
    }
    Ok(())
}

fn put(reading: &mut Reading, files: Vec<PathBuf>, mut set: impl FnMut(&mut RawFrame, PathBuf)) {
    reading.frames.iter_mut().zip(files).for_each(|(frame, file)| set(frame, file));
}

/// The files of a folder beside the images' one (`masks_2` beside `images_2`, else `masks`), sorted; `None` without the
/// folder.
fn files_of(images: &Path, name: &str, extensions: &[&str], n: usize) -> Result<Option<Vec<PathBuf>>, SceneError> {
    let beside = images.parent().unwrap_or(Path::new(""));
    let suffix = images.file_name().and_then(|n| n.to_str()).and_then(|n| n.strip_prefix("images")).unwrap_or("");
    let folders = [format!("{name}{suffix}"), name.to_owned()].map(|name| beside.join(name));
    let Some(folder) = folders.into_iter().find(|f| f.is_dir()) else { return Ok(None) };
    let entries = std::fs::read_dir(&folder).map_err(|e| SceneError::io(&folder, "list the folder", e))?;
    let mut files = Vec::new();
    for entry in entries {
        let path = entry.map_err(|e| SceneError::io(&folder, "list the folder", e))?.path();
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
        if extensions.contains(&extension.as_str()) && path.is_file() {
            files.push(path);
        }
    }
    files.sort();
    if files.len() != n {
        let what = format!("holds {} files for {n} images", files.len());
        let remedy = "keep one for each image, in the same order of names, or remove the folder";
        return Err(SceneError::new(ErrorKind::Layout, Problem::new(&folder, what, remedy)));
    }
    Ok(Some(files))
}

/// Masks and depth pictures of another size than their images are errors.
fn sizes(reading: &mut Reading) {
    let wrong = |frame: &RawFrame| -> Vec<Problem> {
        let Ok(image) = Plan::of(&frame.image) else { return Vec::new() };
        let depth = frame.depth.as_ref().and_then(|d| match &d.place {
            crate::DepthPlace::File(path) if is_image(path) => Some(path),
            _ => None,
        });
        let files = [("mask", frame.mask.as_ref()), ("depth map", depth), ("true mask", frame.transient.as_ref())];
        let mut problems = Vec::new();
        for (kind, file) in files.into_iter().filter_map(|(kind, file)| Some((kind, file?))) {
            match Plan::of(file) {
                Ok(is) if same_shape(is.size, image.size) => {}
                Ok(is) => {
                    let what = format!("the {kind} is {} and its image {}", is.size, image.size);
                    problems.push(Problem::new(file, what, "make it as large as the image").frame(&frame.name));
                }
                Err(error) => problems.push(error.in_frame(&frame.name).into_problem()),
            }
        }
        problems
    };
    let problems: Vec<Problem> = reading.frames.par_iter().flat_map_iter(wrong).collect();
    reading.problems.extend(problems);
}

/// Frames that show nothing but tools are left out; if all do, white means something else.
fn leave_out_covered(root: &Path, reading: &mut Reading) -> Result<(), SceneError> {
    // Shares of tool, `None` without a mask; masks that cannot be decoded are found again, and named, where they are needed.
    let share = |frame: &RawFrame| {
        let share = |grey: Vec<u8>| grey.iter().filter(|v| **v >= 128).count() as f64 / grey.len().max(1) as f64;
        with_mask(frame.mask.as_ref()?, |grey, _| share(grey)).ok()
    };
    let shares: Vec<Option<f64>> = reading.frames.par_iter().map(share).collect();
    let known: Vec<f64> = shares.iter().copied().flatten().collect();
    if known.is_empty() {
        return Ok(());
    }
    if known.len() == reading.frames.len() && known.iter().all(|s| *s == 1.0) {
        let what =
            format!("the masks of all {} frames are white all over: tool everywhere, nothing to train on", known.len());
        let remedy = "white is the tool here: turn the masks round, or give `--masks off`";
        return Err(SceneError::new(ErrorKind::Image, Problem::new(root.join("masks"), what, remedy)));
    }
    reading.notes.push(format!(
        "tools cover {:.1} % of the pixels; {} of {} masks show none",
        100.0 * known.iter().sum::<f64>() / known.len() as f64,
        known.iter().filter(|s| **s == 0.0).count(),
        known.len()
    ));
    let mut covered = shares.iter().map(|share| *share == Some(1.0));
    let (gone, kept): (Vec<RawFrame>, Vec<RawFrame>) =
        std::mem::take(&mut reading.frames).into_iter().partition(|_| covered.next() == Some(true));
    reading.frames = kept;
    if !gone.is_empty() {
        let names: Vec<&str> = gone.iter().map(|f| f.name.as_str()).collect();
        let what = format!("{} frames show nothing but tools and are left out: {}", gone.len(), listing(&names));
        reading.problems.push(Problem::new(root.join("masks"), what, "check their masks").warning());
    }
    Ok(())
}
