//! `transforms.json` as nerfstudio writes and reads it.
//!
//! Like instant-ngp's, plus `camera_model`, masks (black is left out), depth maps (PNG in millimetres unless
//! `depth_unit_scale_factor` says otherwise, `.npy` in units of the world before `applied_scale`), start points in a PLY
//! file and named splits. Frames are sorted by file name. `applied_transform` and `applied_scale` say how the file's frame came from
//! the original one; poses and points are left in the file's frame.

use crate::files::plain_name;
use crate::json::{Document, Object};
use crate::listing::listing;
use crate::reading::{DialectSplits, Reading};
use crate::transforms::{path_inside, raw_frame};
use crate::{ErrorKind, Problem, SceneError, Split, ply};
use std::collections::{HashMap, HashSet};
use std::path::Path;

pub(crate) fn read(document: &Document) -> Result<Reading, SceneError> {
    let format = |p: Problem| SceneError::new(ErrorKind::Format, p);
    let root = document.file.parent().unwrap_or(Path::new(""));
    let mut reading = Reading::new(root);
    reading.splits = DialectSplits::NineOfTen;
    let top = document.top().map_err(format)?;
    let frames = top.objects("frames").map_err(format)?.ok_or_else(|| {
        format(top.problem("frames", "is missing", "is this a transforms file? It needs a list of frames"))
    })?;
    for frame in frames {
        match raw_frame(root, &top, &frame, Split::Train) {
            Ok(raw) => reading.frames.push(raw),
            Err(problem) => reading.problems.push(problem),
        }
    }
    // Stable: frames listed twice stay in the order of the file.
    reading.frames.sort_by(|a, b| a.name.cmp(&b.name));
    if let Err(problem) = named_splits(&top, &mut reading) {
        reading.problems.push(problem);
    }
    if let Err(problem) = world(&top, &mut reading) {
        reading.problems.push(problem);
    }
    if let Some(written) = top.string("ply_file_path").map_err(format)? {
        let path = path_inside(root, &top, "ply_file_path", written).map_err(format)?;
        if path.is_file() {
            reading.points = ply::read_points(&path)?;
            reading.notes.push(format!("{} start points from {written}", reading.points.len()));
        } else {
            let problem = top.problem("ply_file_path", "the file is not there", "add it or remove the field");
            reading.problems.push(problem.warning());
        }
    }
    Ok(reading)
}

/// `train_filenames`, `val_filenames`, `test_filenames`.
fn named_splits(top: &Object<'_>, reading: &mut Reading) -> Result<(), Problem> {
    let lists = [("train_filenames", Split::Train), ("val_filenames", Split::Val), ("test_filenames", Split::Test)];
    if !lists.iter().any(|(key, _)| top.has(key)) {
        return Ok(());
    }
    reading.splits = DialectSplits::Explicit;
    let known: HashSet<&str> = reading.frames.iter().map(|f| f.name.as_str()).collect();
    let mut split_of: HashMap<String, Split> = HashMap::new();
    let mut leaked = Vec::new();
    for (key, split) in lists {
        for written in top.strings(key)?.unwrap_or_default() {
            let name = plain_name(written);
            if !known.contains(name.as_str()) {
                let problem = Problem::new(top.file, "names no frame of this file", "correct the name or remove it");
                return Err(problem.field(key).value(written));
            }
            // Later lists win: what is measured is not trained on.
            if split_of.insert(name.clone(), split) == Some(Split::Train) && split != Split::Train {
                leaked.push(name);
            }
        }
    }
    for frame in &mut reading.frames {
        frame.split = split_of.get(&frame.name).copied().unwrap_or(Split::Unused);
    }
    if !leaked.is_empty() {
        let names: Vec<&str> = leaked.iter().map(String::as_str).collect();
        reading.notes.push(format!("named for training and for measuring, so not trained on: {}", listing(&names)));
    }
    let unused = reading.frames.iter().filter(|f| f.split == Split::Unused).count();
    if unused > 0 {
        reading.notes.push(format!("{unused} frames are in none of the lists of file names: not used"));
    }
    Ok(())
}

/// How the file's world came from the original one: checked and told, not applied.
fn world(top: &Object<'_>, reading: &mut Reading) -> Result<(), Problem> {
    if let Some(unit) = top.number("depth_unit_scale_factor")? {
        if unit <= 0.0 {
            return Err(top.problem("depth_unit_scale_factor", "must be above 0", "correct or remove it"));
        }
        for depth in reading.frames.iter_mut().filter_map(|f| f.depth.as_mut()).filter(|d| d.unit != 1.0) {
            depth.unit = unit;
        }
    }
    if let Some(m) = top.matrix("applied_transform")? {
        let rows: Vec<String> = m.iter().map(|row| format!("{row:?}")).collect();
        let rows = rows.join(" ");
        reading.notes.push(format!("applied_transform {rows} is in the poses already: kept in the file's frame"));
    }
    match top.number("applied_scale")? {
        Some(scale) if scale <= 0.0 => {
            return Err(top.problem("applied_scale", "must be above 0", "correct or remove it"));
        }
        Some(scale) => {
            reading
                .notes
                .push(format!("applied_scale {scale} is in the poses already: kept; depth maps are scaled by it"));
            for depth in reading.frames.iter_mut().filter_map(|f| f.depth.as_mut()) {
                depth.unit *= scale;
            }
        }
        None => {}
    }
    if let Some(method) = top.string("orientation_override")? {
        reading.notes.push(format!("orientation_override `{method}` only turns nerfstudio's viewer: not used"));
    }
    Ok(())
}
