//! `summary.json`: what is known about a run besides its scores and its curve.

use crate::data::Dataset;
use crate::error::RunError;
use crate::eval::skips::SkipSummary;
use crate::folder::SUMMARY;
use crate::memory::{ExpectedMemory, resident_bytes};
use crate::progress::Reached;
use crate::system::System;
use scene_io::Scene;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The content of the file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Name of the system.
    pub system: String,
    /// Trainable parameters.
    pub parameters: u64,
    /// The scene.
    pub scene: SceneSummary,
    /// What the plan decided, a line each.
    pub plan: Vec<String>,
    /// Steps done.
    pub steps: u64,
    /// Training seconds.
    pub seconds: f64,
    /// Step the process that wrote this started at, when it resumed a run: its timings and skips count from there.
    pub resumed_at: Option<u64>,
    /// Seconds in each part.
    pub timings: Vec<(String, f64)>,
    /// Work that was skipped.
    pub skips: Vec<SkipSummary>,
    /// Memory.
    pub memory: Memory,
    /// The machine.
    pub machine: Machine,
}

/// What was read.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneSummary {
    /// Its name.
    pub name: String,
    /// Format of the dataset.
    pub format: String,
    /// Views trained on.
    pub train_views: usize,
    /// Names of the held-out views.
    pub held_out: Vec<String>,
    /// Smallest and largest image trained on, `[width, height]` each.
    pub sizes: Option<[[u32; 2]; 2]>,
    /// What the reader noted.
    pub notes: Vec<String>,
}

/// Bytes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Memory {
    /// Decoded images, as expected before the start.
    pub images: u64,
    /// The system: parameters, moments, gradients, scratch.
    pub system: u64,
    /// All that was expected before the start, as it was printed; 0 where it was not asked for.
    #[serde(default)]
    pub expected: u64,
    /// Most the process held; absent where the system does not say.
    pub peak: Option<u64>,
}

/// Where it ran.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Machine {
    /// Model of the processor, where the system says.
    pub cpu: Option<String>,
    /// Threads used.
    pub threads: usize,
}

impl Summary {
    /// Name in the run folder.
    pub const FILE: &'static str = SUMMARY;

    /// Ask `system` and the process. `resumed_at` is the step that the process went on from; `memory` what was expected.
    pub fn new(
        system: &dyn System,
        scene: SceneSummary,
        plan: &[String],
        reached: Reached,
        resumed_at: Option<u64>,
        memory: ExpectedMemory,
    ) -> Self {
        let skip = |row: crate::system::SkipRow| SkipSummary {
            what: row.what.into(),
            skipped: row.skipped,
            total: row.total,
            unit: row.unit.into(),
            bound: row.bound,
            seconds_saved: row.seconds_saved,
            error: row.error,
        };
        Self {
            system: system.name().into(),
            parameters: system.parameter_count() as u64,
            scene,
            plan: plan.to_vec(),
            steps: reached.step,
            seconds: reached.seconds,
            resumed_at,
            timings: system.timings().into_iter().map(|(name, s)| (name.to_string(), s)).collect(),
            skips: system.skips().into_iter().map(skip).collect(),
            memory: Memory {
                images: memory.photos,
                system: memory.system.max(system.memory_bytes() as u64),
                expected: memory.total(),
                peak: resident_bytes().map(|r| r.peak),
            },
            machine: Machine { cpu: cpu(), threads: rayon::current_num_threads() },
        }
    }

    /// The file's text.
    #[expect(clippy::missing_panics_doc, reason = "plain structs always serialise")]
    pub fn json(&self) -> String {
        serde_json::to_string_pretty(self).expect("a plain struct serialises")
    }

    /// Read it from a run folder.
    ///
    /// # Errors
    /// [`RunError::Read`], [`RunError::Content`].
    pub fn read(run: &Path) -> Result<Self, RunError> {
        let path = run.join(Self::FILE);
        let text = std::fs::read_to_string(&path).map_err(RunError::read(&path))?;
        serde_json::from_str(&text).map_err(|e| RunError::Content { path, problem: e.to_string() })
    }
}

impl SceneSummary {
    /// What was read.
    pub fn new(scene: &Scene, train: &Dataset, held_out: &Dataset) -> Self {
        let sizes = train.views().iter().map(|v| [v.camera.width, v.camera.height]);
        let smallest = sizes.clone().min_by_key(|s| u64::from(s[0]) * u64::from(s[1]));
        let largest = sizes.max_by_key(|s| u64::from(s[0]) * u64::from(s[1]));
        Self {
            name: scene.name.clone(),
            format: scene.dialect.name().into(),
            train_views: train.len(),
            held_out: held_out.views().iter().map(|v| v.name.clone()).collect(),
            sizes: smallest.zip(largest).map(|(a, b)| [a, b]),
            notes: scene.notes.clone(),
        }
    }
}

fn cpu() -> Option<String> {
    let info = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = info.lines().find(|l| l.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_string())
}
