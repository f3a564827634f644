//! What a run is told and what was decided from it.

use serde::{Deserialize, Serialize};

/// What is composited behind transparent pixels and behind the reconstruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Background {
    /// White.
    White,
    /// Black.
    Black,
    /// A random colour per training ray, so that empty space cannot hide as background; evaluated on white.
    Random,
}

impl Background {
    /// Colour used for evaluation and pictures.
    pub fn colour(self) -> [f32; 3] {
        match self {
            Self::White | Self::Random => [1.0; 3],
            Self::Black => [0.0; 3],
        }
    }

    /// The word on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::White => "white",
            Self::Black => "black",
            Self::Random => "random",
        }
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
