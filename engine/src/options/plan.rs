//! What is decided about a run: the system, its settings, and the reasons.

use super::background::Background;
use super::schedule::Stop;
use std::fmt::Display;
use std::str::FromStr;

/// What a reconstruction is for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Purpose {
    /// Looking at it from new places.
    #[default]
    Viewing,
    /// Points, meshes, densities.
    Geometry,
}

impl FromStr for Purpose {
    type Err = String;

    fn from_str(word: &str) -> Result<Self, String> {
        match word {
            "viewing" => Ok(Self::Viewing),
            "geometry" => Ok(Self::Geometry),
            other => Err(format!("`{other}`: write `viewing` or `geometry`")),
        }
    }
}

/// A system and why it was taken.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// Its name.
    pub system: &'static str,
    /// The reason, with figures.
    pub line: String,
    /// Settings of it that were found on the way; what is set by the user stays.
    pub set: toml::Table,
    /// Their reasons.
    pub lines: Vec<String>,
}

impl Choice {
    /// A system, and why it was taken.
    #[must_use]
    pub fn new(system: &'static str, why: impl Display) -> Self {
        Self { system, line: format!("system: {system} ({why})"), set: toml::Table::new(), lines: Vec::new() }
    }

    /// The same with settings that were found on the way, and their reasons.
    #[must_use]
    pub fn with(self, set: toml::Table, lines: Vec<String>) -> Self {
        Self { set, lines, ..self }
    }
}

/// What every system is told besides scene and data.
#[derive(Clone, Debug, PartialEq)]
pub struct RunOptions {
    /// Seed of all randomness.
    pub seed: u64,
    /// Background, or `None` to let the plan decide.
    pub background: Option<Background>,
    /// Error a training or evaluation pixel may have from skipped work, in colour units; `None` lets the plan decide.
    pub error_budget: Option<f32>,
    /// When the training is to stop, where that is known: schedules follow it. A run that is resumed has them in its settings.
    pub stop: Option<Stop>,
    /// `--set key=value`, over whatever the plan decides.
    pub set: toml::Table,
}

/// What was decided about a run, and why.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// One decision a line, for people: `contraction: on, the cameras look outwards (71 % …)`.
    pub lines: Vec<String>,
    /// Background after the decision.
    pub background: Background,
    /// Error budget of evaluation renders after the decision.
    pub error_budget: f32,
    /// Every field of the system's configuration with its value. Building with this as `set` gives the same system.
    pub config: toml::Table,
}
