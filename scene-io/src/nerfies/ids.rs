//! Which frames there are, what they are for, and when, how and by which camera each was taken.

use crate::json::{Document, Object};
use crate::{ErrorKind, FrameIds, Problem, SceneError, Split};
use std::collections::{HashMap, HashSet};
use std::path::Path;

/// Frames and their splits, in the order of the files; an id may be listed for both.
pub(super) struct Lists {
    pub(super) frames: Vec<(String, Split)>,
    pub(super) notes: Vec<String>,
    pub(super) problems: Vec<Problem>,
}

fn format(problem: Problem) -> SceneError {
    SceneError::new(ErrorKind::Format, problem)
}

/// `splits/train.json` and `splits/val.json` where both are there, else `train_ids` and `val_ids` of `dataset.json`, else
/// every fourth frame to train on and the ones between to test on.
pub(super) fn lists(root: &Path, dataset: &Document, ids: &HashMap<String, FrameIds>) -> Result<Lists, SceneError> {
    let top = dataset.top().map_err(format)?;
    let list = |key: &str| -> Result<Vec<String>, SceneError> {
        let names = top.strings(key).map_err(format)?.unwrap_or_default();
        Ok(names.into_iter().map(str::to_owned).collect())
    };
    let (all, train, val) = (list("ids")?, list("train_ids")?, list("val_ids")?);
    let mut out = Lists { frames: Vec::new(), notes: Vec::new(), problems: Vec::new() };
    if let Some(count) = top.index("count").map_err(format)?
        && count as usize != all.len()
        && !all.is_empty()
    {
        let problem = top.problem("count", format!("and {} ids are listed", all.len()), "the list is taken");
        out.problems.push(problem.warning());
    }
    let files = ["train", "val"].map(|name| root.join("splits").join(format!("{name}.json")));
    let (train, val, val_name) = if files.iter().all(|f| f.is_file()) {
        let [train, val] = files.map(|file| split_file(&file, ids, &mut out));
        out.notes.push("splits/train.json is trained on, splits/val.json tested on".into());
        (train?, val?, "splits/val.json")
    } else {
        (train, val, "val_ids")
    };
    let everything = if all.is_empty() { train.iter().chain(&val).cloned().collect() } else { all };
    if everything.is_empty() {
        return Err(format(Problem::new(&dataset.file, "lists no frame", "write the frames' names").field("ids")));
    }
    if val.is_empty() && everything.len() >= 3 {
        // HyperNeRF's "interp" scenes, as their authors and TiNeuVox split them.
        let split = |i: usize| match i % 4 {
            0 => Split::Train,
            2 => Split::Test,
            _ => Split::Unused,
        };
        out.frames = everything.into_iter().enumerate().map(|(i, id)| (id, split(i))).collect();
        out.notes.push("val_ids is empty: of four frames the first is trained on, the third tested on".into());
        return Ok(out);
    }
    let (trained, tested): (HashSet<&String>, HashSet<&String>) = (train.iter().collect(), val.iter().collect());
    if train.is_empty() {
        out.frames.extend(everything.iter().filter(|id| !tested.contains(id)).map(|id| (id.clone(), Split::Train)));
    } else {
        let unused = everything.iter().filter(|id| !trained.contains(id) && !tested.contains(id));
        out.frames.extend(train.iter().map(|id| (id.clone(), Split::Train)));
        out.frames.extend(unused.map(|id| (id.clone(), Split::Unused)));
    }
    if !val.is_empty() {
        out.notes.push(format!("{val_name} is what these datasets are measured on: {} test frames", val.len()));
    }
    out.frames.extend(val.into_iter().map(|id| (id, Split::Test)));
    Ok(out)
}

/// `frame_names` of a file of `splits`; its `time_ids` and `camera_ids` are held against `metadata.json`.
fn split_file(file: &Path, ids: &HashMap<String, FrameIds>, out: &mut Lists) -> Result<Vec<String>, SceneError> {
    let document = Document::read(file)?;
    let top = document.top().map_err(format)?;
    let names = top.strings("frame_names").map_err(format)?.ok_or_else(|| {
        format(Problem::new(file, "is missing", "write the names of the frames").field("frame_names"))
    })?;
    for (key, of) in [("time_ids", (|i: &FrameIds| i.time) as fn(&FrameIds) -> u32), ("camera_ids", |i| i.camera)] {
        let Some(said) = top.indices(key).map_err(format)? else { continue };
        if said.len() != names.len() {
            let what = format!("holds {} numbers for {} frames", said.len(), names.len());
            return Err(format(Problem::new(file, what, "write one for each frame").field(key)));
        }
        let other = names
            .iter()
            .zip(&said)
            .filter(|(name, said)| ids.get(**name).is_some_and(|ids| of(ids) as usize != **said));
        let other: Vec<&str> = other.map(|(name, _)| *name).collect();
        if let Some(first) = other.first() {
            let what = format!("says otherwise than metadata.json about {} frames, first {first}", other.len());
            out.problems.push(Problem::new(file, what, "metadata.json is believed").field(key).warning());
        }
    }
    Ok(names.into_iter().map(str::to_owned).collect())
}

/// The ids of every frame of `metadata.json`.
pub(super) fn metadata(document: &Document) -> Result<HashMap<String, FrameIds>, SceneError> {
    let top = document.top().map_err(format)?;
    let mut ids = HashMap::new();
    for name in top.keys() {
        let entry = top.object(name).map_err(format)?;
        if let Some(entry) = entry {
            ids.insert(name.to_owned(), frame_ids(&entry).map_err(|p| format(p.frame(name)))?);
        }
    }
    Ok(ids)
}

fn frame_ids(entry: &Object<'_>) -> Result<FrameIds, Problem> {
    let index = |key: &str| entry.index(key);
    let time = match (index("time_id")?, index("warp_id")?) {
        (Some(time), _) | (None, Some(time)) => time,
        (None, None) => {
            return Err(entry.problem("warp_id", "is missing", "write the number of the frame's time step"));
        }
    };
    Ok(FrameIds { time, appearance: index("appearance_id")?.unwrap_or(time), camera: index("camera_id")?.unwrap_or(0) })
}
