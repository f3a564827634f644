//! A small dataset on disk, and the program.

use assert_cmd::Command;
use scene_io::synthetic::{TabletopOptions, tabletop, write_blender};
use std::path::{Path, PathBuf};
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
