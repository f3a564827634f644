//! What must be the same: the bits of the checkpoint, the pictures, the scores; and what must not be there.

use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Step of the newest checkpoint; `None` where there is none.
pub(crate) fn newest(run: &Path) -> Option<u64> {
    engine::checkpoint::newest_step(run)
}

/// Views that were measured and kept, with the times their pictures were written, as of a step.
pub(crate) fn kept(run: &Path) -> BTreeMap<PathBuf, SystemTime> {
    let read = || -> Option<Value> { serde_json::from_slice(&fs::read(run.join("eval_views.json")).ok()?).ok() };
    let mut out = BTreeMap::new();
    let Some(content) = read() else { return out };
    for view in content["views"].as_object().into_iter().flat_map(|views| views.values()) {
        let Some(stem) = view["score"]["files"].as_str() else { continue };
        let path = run.join("renders").join(format!("{stem}.png"));
        if let Ok(modified) = fs::metadata(&path).and_then(|m| m.modified()) {
            out.insert(path, modified);
        }
    }
    out
}

/// Pictures of views that are compared with each other (where points went between two moments): both are rendered again for that.
pub(crate) fn compared(run: &Path) -> Vec<String> {
    let read = || -> Option<Value> { serde_json::from_slice(&fs::read(run.join("eval.json")).ok()?).ok() };
    let views = read().and_then(|value| value["views"].as_array().cloned()).unwrap_or_default();
    let compared = views.iter().filter(|view| view["motion"]["flow_error"].is_number());
    compared.filter_map(|view| Some(format!("{}.png", view["files"].as_str()?))).collect()
}

/// Numbers that tell how long something took, and nothing else.
const TIMES: [&str; 7] =
    ["render_seconds", "seconds", "seconds_full", "seconds_saved", "timings", "memory", "resumed_at"];

fn without_times(value: &mut Value) {
    match value {
        Value::Object(map) => {
            map.retain(|key, _| !TIMES.contains(&key.as_str()));
            map.values_mut().for_each(without_times);
        }
        Value::Array(list) => list.iter_mut().for_each(without_times),
        _ => {}
    }
}

fn scores(path: &Path) -> Result<Value, String> {
    let bytes = fs::read(path).map_err(|e| format!("{}: {e}", path.display()))?;
    let mut value = serde_json::from_slice(&bytes).map_err(|e| format!("{}: {e}", path.display()))?;
    without_times(&mut value);
    Ok(value)
}

/// Whether two finished runs of `steps` steps are the same.
pub(crate) fn runs(want: &Path, got: &Path, steps: u64) -> Result<(), String> {
    same_bytes(want, got, &format!("checkpoint/step-{steps:08}.safetensors"))?;
    for name in ["config.toml", "heldout.txt", "schedule.json", "finished.json"] {
        same_bytes(want, got, name)?;
    }
    let name = "eval.json";
    if scores(&want.join(name))? != scores(&got.join(name))? {
        return Err(format!("{name} is another one"));
    }
    for folder in ["renders", "appearance", "masks"] {
        pictures(&want.join(folder), &got.join(folder))?;
    }
    for name in ["summary.json", "report.html", "metrics.csv", "eval.csv"] {
        if !got.join(name).is_file() {
            return Err(format!("{name} is missing"));
        }
    }
    let rows = engine::log::read(&got.join("metrics.csv")).map_err(|e| e.to_string())?;
    match rows.last() {
        Some(row) if row.step == steps && row.psnr_test.is_some() => {}
        last => return Err(format!("the last row of metrics.csv is {last:?}")),
    }
    if got.join("eval_views.json").exists() {
        return Err("eval_views.json stays behind a whole evaluation".into());
    }
    leftovers(got)
}

/// Whether two folders hold the same pictures.
pub(crate) fn pictures(want: &Path, got: &Path) -> Result<(), String> {
    for entry in fs::read_dir(want).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.ends_with(".png") {
            same_bytes(want, got, &name)?;
        }
    }
    Ok(())
}

fn same_bytes(want: &Path, got: &Path, name: &str) -> Result<(), String> {
    let read = |folder: &Path| fs::read(folder.join(name)).map_err(|e| format!("{}: {e}", folder.join(name).display()));
    if read(want)? == read(got)? { Ok(()) } else { Err(format!("{} has other bytes", got.join(name).display())) }
}

/// Files under a temporary name.
pub(crate) fn leftovers(folder: &Path) -> Result<(), String> {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() {
            leftovers(&path)?;
        } else if path.extension().is_some_and(|e| e == "tmp") || path.ends_with(".writable") {
            return Err(format!("{} was left behind", path.display()));
        }
    }
    Ok(())
}
