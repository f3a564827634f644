//! Checkpoints: everything the next step depends on, on disk, whole or not at all.
//!
//! `checkpoint/step-NNNNNNNN.safetensors` holds the arrays of [`System::state`], `step-NNNNNNNN.json` the step, the
//! training seconds, the seed, the dataset's hash, the configuration, and size and SHA-256 of the array file. The JSON
//! file is written last: a checkpoint without it does not exist. Random numbers are functions of (seed, step), so the
//! two are the whole state of the generator. The last two checkpoints are kept; where the disk is full the older one makes room for
//! a new one, once the newer one was read and found whole.
//!
//! Nothing of a file is believed: sizes are compared before anything is read, and every number is held against what a run can be.

mod arrays;

use crate::error::RunError;
pub use crate::identity::sha256;
use crate::options::RunConfig;
use crate::output::{self, Storage, write_file};
use crate::progress::Reached;
use crate::system::System;
use crate::tensors::{MOST_COUNTED, TensorMap};
use arrays::deserialise;
pub use arrays::serialise;
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::{Path, PathBuf};

/// The folder of the checkpoints in that of a run.
pub(crate) const FOLDER: &str = "checkpoint";
/// Checkpoints kept.
const KEPT: usize = 2;
/// Longest JSON file that is read, bytes: a configuration has some thousand.
const LONGEST_JSON: u64 = 16 << 20;
/// How random numbers are made.
const GENERATOR: &str = "philox4x32-10";
/// Version of the layout of the two files.
const FORMAT: u32 = 1;

/// What a checkpoint says besides its arrays.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Meta {
    /// Layout version.
    pub format: u32,
    /// Steps done.
    pub step: u64,
    /// Training seconds so far, evaluation not counted.
    pub seconds: f64,
    /// How random numbers are made from the seed.
    pub rng: RngMeta,
    /// Hash of cameras and images.
    pub dataset: String,
    /// The array file.
    pub tensors: TensorsMeta,
    /// The run's configuration.
    pub config: RunConfig,
}

/// The state of the random numbers.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RngMeta {
    /// `philox4x32-10`, counter-based.
    pub generator: String,
    /// Seed of the run.
    pub seed: u64,
    /// Next step to draw for.
    pub counter: u64,
}

/// Where the arrays are and how to know that they are whole.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TensorsMeta {
    /// File name beside the JSON file.
    pub file: String,
    /// Its size.
    pub bytes: u64,
    /// Its SHA-256, hexadecimal.
    pub sha256: String,
}

/// A checkpoint read back.
#[derive(Clone, Debug)]
pub struct Checkpoint {
    /// What the JSON file says.
    pub meta: Meta,
    /// The arrays.
    pub state: TensorMap,
    /// One line for each newer checkpoint that could not be used.
    pub warnings: Vec<String>,
}

/// Where a run's checkpoints lie.
pub fn folder(run: &Path) -> PathBuf {
    run.join(FOLDER)
}

/// Write a checkpoint of `system` as it is `at` some step, then remove all but the last two up to this one. Returns the path of its JSON file. On a
/// full disk the older of two checkpoints makes room, if the newer one is whole.
///
/// # Errors
/// [`RunError::Write`]; earlier checkpoints are untouched.
///
/// # Panics
/// When an array of the system's state does not fill its shape.
pub fn save(
    storage: &dyn Storage,
    run: &Path,
    system: &dyn System,
    at: Reached,
    config: &RunConfig,
    dataset: &str,
) -> Result<PathBuf, RunError> {
    let Reached { step, seconds } = at;
    let folder = folder(run);
    output::make_folder(&folder)?;
    let stem = format!("step-{step:08}");
    let arrays = serialise(&system.state());
    let array_file = format!("{stem}.safetensors");
    let meta = Meta {
        format: FORMAT,
        step,
        seconds,
        rng: RngMeta { generator: GENERATOR.into(), seed: config.seed, counter: step },
        dataset: dataset.into(),
        tensors: TensorsMeta { file: array_file.clone(), bytes: arrays.len() as u64, sha256: sha256(&arrays) },
        config: config.clone(),
    };
    let text = serde_json::to_string_pretty(&meta).expect("a plain struct serialises");
    let path = folder.join(format!("{stem}.json"));
    let write = || {
        write_file(storage, &folder.join(&array_file), &arrays)?;
        write_file(storage, &path, text.as_bytes())
    };
    match write() {
        Err(error) if error.is_full() && make_room(&folder, step) => write()?,
        written => written?,
    }
    let _ = prune(&folder, step);
    Ok(path)
}

/// Remove what no run needs, and the older checkpoint where the newer one is whole; `false` where there is nothing to remove.
fn make_room(folder: &Path, step: u64) -> bool {
    let had_orphans = prune(folder, step);
    let earlier: Vec<u64> = steps(folder).into_iter().filter(|&other| other != step).collect();
    let whole = earlier.last().is_some_and(|&newest| load(folder, newest).is_ok());
    let Some((_, older)) = earlier.split_last().filter(|(_, older)| whole && !older.is_empty()) else {
        return had_orphans;
    };
    for step in older {
        // The JSON file first: what is left of a checkpoint then is none.
        let _ = fs::remove_file(folder.join(format!("step-{step:08}.json")));
        let _ = fs::remove_file(folder.join(format!("step-{step:08}.safetensors")));
    }
    true
}

/// Newest step with a JSON file, readable or not; `None` when there is no checkpoint.
pub fn newest_step(run: &Path) -> Option<u64> {
    steps(&folder(run)).last().copied()
}

/// Read the newest checkpoint that is whole. Broken newer ones become warnings.
///
/// # Errors
/// [`RunError::NoCheckpoint`], [`RunError::AllCheckpointsBroken`].
pub fn load_newest(run: &Path) -> Result<Checkpoint, RunError> {
    load_below(run, None, Vec::new())
}

/// As [`load_newest`], of the checkpoints before `step` where there is one; `problems` are those found so far, a line each.
pub(crate) fn load_below(run: &Path, step: Option<u64>, mut problems: Vec<String>) -> Result<Checkpoint, RunError> {
    let folder = folder(run);
    for step in steps(&folder).into_iter().rev().filter(|&other| step.is_none_or(|step| other < step)) {
        match load(&folder, step) {
            Ok((meta, state)) => {
                let warnings = problems.iter().map(|p| format!("{p}; using step {step} instead")).collect();
                return Ok(Checkpoint { meta, state, warnings });
            }
            Err(problem) => problems.push(format!("checkpoint step-{step:08}: {problem}")),
        }
    }
    Err(match problems.is_empty() {
        true => RunError::NoCheckpoint(run.to_path_buf()),
        false => RunError::AllCheckpointsBroken { folder: run.to_path_buf(), problems },
    })
}

fn load(folder: &Path, step: u64) -> Result<(Meta, TensorMap), String> {
    let text = read_json(&folder.join(format!("step-{step:08}.json")))?;
    let meta: Meta = serde_json::from_str(&text).map_err(|e| format!("JSON file is broken: {e}"))?;
    if meta.format != FORMAT {
        return Err(format!("layout version {} (this program reads {FORMAT})", meta.format));
    }
    if meta.step != step {
        return Err(format!("JSON file is of step {}", meta.step));
    }
    plausible(&meta)?;
    let file = Path::new(&meta.tensors.file);
    if file.components().count() != 1 || file.file_name().is_none() {
        return Err(format!("array file `{}` lies outside the checkpoint folder", meta.tensors.file));
    }
    let size = fs::metadata(folder.join(file)).map_err(|e| format!("array file `{}`: {e}", meta.tensors.file))?.len();
    if size != meta.tensors.bytes {
        return Err(format!("array file is truncated or replaced: {size} bytes, expected {}", meta.tensors.bytes));
    }
    let bytes = fs::read(folder.join(file)).map_err(|e| format!("array file `{}`: {e}", meta.tensors.file))?;
    if bytes.len() as u64 != meta.tensors.bytes {
        return Err(format!(
            "array file is truncated or replaced: {} bytes, expected {}",
            bytes.len(),
            meta.tensors.bytes
        ));
    }
    if sha256(&bytes) != meta.tensors.sha256 {
        return Err("array file is corrupted: its SHA-256 is not the one recorded".into());
    }
    let state = deserialise(&bytes)?;
    Ok((meta, state))
}

/// What a run's own JSON file never says, as a line.
fn plausible(meta: &Meta) -> Result<(), String> {
    let Meta { step, seconds, rng, config, .. } = meta;
    let refused = |field: &str, value: &dyn std::fmt::Display, want: &str| {
        Err(format!("JSON file: `{field}` is {value}, expected {want}"))
    };
    if *step > MOST_COUNTED {
        return refused("step", step, &format!("{MOST_COUNTED} at most"));
    }
    if !(seconds.is_finite() && *seconds >= 0.0) {
        return refused("seconds", seconds, "a number from 0 on");
    }
    if rng.generator != GENERATOR {
        return refused("rng.generator", &rng.generator, GENERATOR);
    }
    if rng.counter != *step {
        return refused("rng.counter", &rng.counter, &format!("the step, {step}"));
    }
    if rng.seed != config.seed {
        return refused("rng.seed", &rng.seed, &format!("that of the configuration, {}", config.seed));
    }
    if !(0.0..=1.0).contains(&config.error_budget) {
        return refused("config.error_budget", &config.error_budget, "a number from 0 to 1");
    }
    if config.data.scales.is_some_and(|n| !(1..=12).contains(&n)) {
        return refused("config.data.scales", &config.data.scales.unwrap_or(0), "1 to 12");
    }
    if config.data.longest_side == Some(0) {
        return refused("config.data.longest_side", &0, "1 pixel at least");
    }
    Ok(())
}

/// The text of a JSON file, unless it is longer than any that was written here.
fn read_json(path: &Path) -> Result<String, String> {
    let size = fs::metadata(path).map_err(|e| format!("JSON file: {e}"))?.len();
    if size > LONGEST_JSON {
        return Err(format!("JSON file: {size} bytes; at most {LONGEST_JSON} are read"));
    }
    fs::read_to_string(path).map_err(|e| format!("JSON file: {e}"))
}

/// SHA-256 of the arrays of the checkpoint of `step`, as its JSON file says; `None` where there is no such file.
pub fn digest(run: &Path, step: u64) -> Option<String> {
    let text = read_json(&folder(run).join(format!("step-{step:08}.json"))).ok()?;
    let meta: Meta = serde_json::from_str(&text).ok()?;
    Some(meta.tensors.sha256)
}

/// The arrays of a file, and its SHA-256.
///
/// # Errors
/// What is wrong with the file, as a sentence that does not name it.
pub fn read_arrays(path: &Path) -> Result<(TensorMap, String), String> {
    let bytes = fs::read(path).map_err(|e| format!("cannot be read: {e}"))?;
    Ok((deserialise(&bytes)?, sha256(&bytes)))
}

/// Steps with a JSON file, ascending.
fn steps(folder: &Path) -> Vec<u64> {
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    let mut steps: Vec<u64> = entries.flatten().filter_map(|e| step_of(&e.path(), "json")).collect();
    steps.sort_unstable();
    steps
}

fn step_of(path: &Path, extension: &str) -> Option<u64> {
    if path.extension()? != extension {
        return None;
    }
    path.file_stem()?.to_str()?.strip_prefix("step-")?.parse().ok()
}

/// Remove all but the newest checkpoints of a run that is at `step`, and what killed processes left; whether there was such.
/// Checkpoints of later steps could not be used: the run went on from one before them. Failing to remove costs disk space only.
fn prune(folder: &Path, step: u64) -> bool {
    let steps = steps(folder);
    let reached = &steps[..steps.partition_point(|&other| other <= step)];
    let kept = &reached[reached.len().saturating_sub(KEPT)..];
    for step in steps.iter().filter(|step| !kept.contains(step)) {
        let _ = fs::remove_file(folder.join(format!("step-{step:08}.json")));
    }
    let mut had_orphans = false;
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        let orphan = step_of(&path, "safetensors").is_some_and(|step| !kept.contains(&step));
        if orphan || output::temporary_of(&path).is_some() {
            had_orphans |= fs::remove_file(path).is_ok();
        }
    }
    had_orphans
}
