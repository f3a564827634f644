//! A small dataset on disk, and the program.

use assert_cmd::Command;
use scene_io::synthetic::{TabletopOptions, tabletop, write_blender};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
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
    answer_of(program.args(words).output().unwrap(), words)
}

fn answer_of(output: std::process::Output, words: &[&str]) -> Answer {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let answer =
        Answer { code: output.status.code().unwrap_or(-1), out: text(&output.stdout), err: text(&output.stderr) };
    assert!(!answer.err.contains("panicked"), "{words:?}: {}", answer.err);
    answer
}

pub(crate) fn program() -> Command {
    prepared("nerf-static")
}

/// A program as it is called here: what it says to type begins with it.
pub(crate) fn called(name: &str) -> String {
    Command::cargo_bin(name).unwrap().get_program().to_str().unwrap().to_owned()
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

/// A program that runs beside the test.
pub(crate) struct Running {
    child: Child,
    words: Vec<String>,
}

impl Running {
    /// Start `nerf-static` with `words`.
    pub(crate) fn start(words: &[&str]) -> Self {
        let program = program();
        Self::of(program.get_program(), &[&["--threads", "2"], words].concat())
    }

    /// Type a line as it stands.
    #[cfg(unix)]
    pub(crate) fn typed(line: &str) -> Self {
        Self::of("sh".as_ref(), &["-c", &format!("exec {line}")])
    }

    fn of(program: &std::ffi::OsStr, words: &[&str]) -> Self {
        let mut command = std::process::Command::new(program);
        command.env_remove("WILDFIELD_LPIPS").args(words).stdout(Stdio::piped()).stderr(Stdio::piped());
        let child = command.spawn().unwrap();
        Self { child, words: words.iter().map(ToString::to_string).collect() }
    }

    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    /// Wait until something has happened, for a minute at most, or the program has ended.
    pub(crate) fn until(mut self, what: &str, is_due: impl Fn() -> bool) -> Self {
        let since = Instant::now();
        while !is_due() && self.child.try_wait().unwrap().is_none() {
            assert!(since.elapsed() < Duration::from_secs(60), "waited too long until {what}");
            std::thread::sleep(Duration::from_millis(2));
        }
        self
    }

    /// Ctrl-C, and what came of it.
    #[cfg(unix)]
    pub(crate) fn interrupted(self) -> Answer {
        let id = self.id().to_string();
        // Where it has ended by itself there is nothing to interrupt.
        let _ = std::process::Command::new("kill").args(["-INT", &id]).stderr(Stdio::null()).status();
        self.end()
    }

    pub(crate) fn end(self) -> Answer {
        let output = self.child.wait_with_output().unwrap();
        answer_of(output, &self.words.iter().map(String::as_str).collect::<Vec<_>>())
    }
}

/// Files in a folder; 0 where there is no folder.
pub(crate) fn files_in(folder: &Path) -> usize {
    fs::read_dir(folder).map_or(0, Iterator::count)
}

/// Rows of the curve of a run.
pub(crate) fn rows(run: &Path) -> usize {
    fs::read_to_string(run.join("metrics.csv")).map_or(0, |text| text.lines().count().saturating_sub(1))
}
