//! What is behind the scene.

use field_core::rng::Rng;
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

    /// What is behind training ray `i`: `rng` is the stream of a step's backgrounds.
    #[must_use]
    pub fn of_ray(self, rng: &Rng, i: u64) -> [f32; 3] {
        match self {
            Self::Random => [0, 1, 2].map(|c| rng.uniform_at(3 * i + c)),
            fixed => fixed.colour(),
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
