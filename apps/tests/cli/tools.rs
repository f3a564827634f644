//! A small dataset on disk, and the program.

use assert_cmd::Command;
use scene_io::synthetic::{TabletopOptions, tabletop, write_blender};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// A Blender-style dataset of 6 training and 2 test views, 24 x 24 pixels, in `DIR/scene`.
pub(crate) fn dataset() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene");
    let options = TabletopOptions { width: 24, height: 24, train: 6, test: 2, rays: 1, ..TabletopOptions::default() };
    write_blender(&tabletop(&options), &scene).unwrap();
    (folder, scene)
}

/// Settings that make `ngp` tiny: the tests are about what stands around it.
pub(crate) const SMALL: [&str; 8] =
    ["--set", "log2_table=10", "--set", "batch_samples=2048", "--set", "occupancy=16", "--set", "levels=4"];

pub(crate) struct Answer {
    pub(crate) code: i32,
    pub(crate) out: String,
    pub(crate) err: String,
}

/// Run `nerf-static`; nothing it may be told makes it panic.
pub(crate) fn nerf(words: &[&str]) -> Answer {
    answer(program(), words)
}

/// Run `nerf-wild`; nor it.
pub(crate) fn nerf_wild(words: &[&str]) -> Answer {
    answer(prepared("nerf-wild"), words)
}

/// Run `nerf-dynamic`; nor that.
pub(crate) fn nerf_dynamic(words: &[&str]) -> Answer {
    answer(prepared("nerf-dynamic"), words)
}

fn answer(mut program: Command, words: &[&str]) -> Answer {
    let output = program.args(words).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let answer =
        Answer { code: output.status.code().unwrap_or(-1), out: text(&output.stdout), err: text(&output.stderr) };
    assert!(!answer.err.contains("panicked"), "{words:?}: {}", answer.err);
    answer
}

pub(crate) fn program() -> Command {
    prepared("nerf-static")
}

pub(crate) fn prepared(name: &str) -> Command {
    let mut command = Command::cargo_bin(name).unwrap();
    command.env_remove("WILDFIELD_LPIPS").args(["--threads", "2"]);
    command
}

/// The error line; the causes below are indented.
pub(crate) fn error_line(answer: &Answer) -> &str {
    let lines: Vec<&str> = answer.err.lines().filter(|l| l.starts_with("error: ")).collect();
    assert_eq!(lines.len(), 1, "one clear line:\n{}", answer.err);
    lines[0]
}

pub(crate) fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Start `program` on a training of many steps, and kill it when `is_due`: no mercy.
pub(crate) fn killed(program: &str, words: &[&str], is_due: impl Fn() -> bool) {
    // A checkpoint after every step.
    let mut child = std::process::Command::new(prepared(program).get_program())
        .args(words)
        .args(["--checkpoint-minutes", "1e-9", "--threads", "1"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let since = Instant::now();
    while !is_due() && since.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
}

/// Checkpoints of a run.
pub(crate) fn checkpoints(run: &Path) -> Vec<u64> {
    let steps = fs::read_dir(run.join("checkpoint")).into_iter().flatten().flatten().filter_map(|e| {
        let name = e.file_name().into_string().ok()?;
        name.strip_prefix("step-")?.strip_suffix(".json")?.parse().ok()
    });
    steps.collect()
}

/// Step of the newest checkpoint; 0 where there is none.
pub(crate) fn newest(run: &Path) -> u64 {
    checkpoints(run).into_iter().max().unwrap_or(0)
}

/// What was learnt, as of a step.
pub(crate) fn arrays(run: &Path, step: u64) -> Vec<u8> {
    fs::read(run.join(format!("checkpoint/step-{step:08}.safetensors"))).unwrap()
}
