//! The light of a photo: a code that colours depend on and geometry does not.

use super::codes::CodeTable;
use super::config::{AppearanceKind, WildConfig};
use super::encoder::PhotoEncoder;
use crate::method::{Codes, Drawing, Outcome, Relit, SecondLight};
use engine::data::{Batch, Dataset, Patches, Shape};
use engine::system::{SystemError, Tensor, TensorMap};

/// Where the codes of photos come from.
pub(super) enum Light {
    /// They are free (NeRF-W).
    Codes { table: CodeTable, lr: f64, pull: f32 },
    /// A network looks at the photo (Ha-NeRF), at a few of them in each step.
    Encoder { photos: Box<PhotoEncoder>, drawing: Drawing },
}

impl Light {
    /// As configured; `None` where all photos have the same light.
    pub(super) fn new(config: &WildConfig, data: &Dataset, seed: u64) -> Result<Option<Self>, SystemError> {
        Ok(match config.appearance {
            AppearanceKind::None => None,
            AppearanceKind::Codes => Some(Self::Codes {
                table: CodeTable::new("appearance", data.len(), config.appearance_dims, seed),
                lr: f64::from(config.code_lr),
                pull: config.code_size,
            }),
            AppearanceKind::Encoder => Some(Self::Encoder {
                photos: Box::new(PhotoEncoder::new(config, data, seed)?),
                drawing: match config.lattices {
                    0 => Drawing::Pixels,
                    n => Drawing::Patches(Patches { shape: Shape::Lattice, side: config.lattice as u32 }, n),
                },
            }),
        })
    }

    pub(super) fn codes(&self) -> Codes<'_> {
        match self {
            Self::Codes { table, .. } => table.codes(),
            Self::Encoder { photos, .. } => photos.codes(),
        }
    }

    /// The codes that the field learns with.
    pub(super) fn learning_codes(&self) -> Codes<'_> {
        match self {
            Self::Codes { table, .. } => table.codes(),
            Self::Encoder { photos, .. } => photos.learning_codes(),
        }
    }

    /// How pixels are drawn, where the rest of the method does not mind.
    pub(super) fn drawing(&self) -> Drawing {
        match self {
            Self::Codes { .. } => Drawing::Pixels,
            Self::Encoder { drawing, .. } => *drawing,
        }
    }

    /// The batch of a step is drawn.
    pub(super) fn begin(&mut self, data: &Dataset, batch: &Batch, step: u64) -> Result<(), SystemError> {
        match self {
            Self::Codes { .. } => Ok(()),
            Self::Encoder { photos, .. } => photos.begin(data, batch, step),
        }
    }

    /// See [`crate::method::Method::second_light`].
    pub(super) fn second_light(&self, step: u64) -> Option<SecondLight> {
        match self {
            Self::Codes { .. } => None,
            Self::Encoder { photos, .. } => photos.second_light(step),
        }
    }

    /// See [`crate::method::Method::judge_second`].
    pub(super) fn judge_second(&mut self, relit: &Relit<'_>) -> Vec<[f32; 3]> {
        match self {
            Self::Codes { .. } => vec![[0.0; 3]; relit.other.len()],
            Self::Encoder { photos, .. } => photos.judge_second(relit),
        }
    }

    /// Returns the count of non-finite gradients.
    pub(super) fn learn(&mut self, outcome: &Outcome<'_>) -> usize {
        match self {
            Self::Codes { table, lr, pull } => {
                table.learn(outcome.simd, outcome.lr * *lr, outcome.batch, outcome.appearance_bar, *pull)
            }
            Self::Encoder { photos, .. } => photos.learn(outcome),
        }
    }

    pub(super) fn encode(&self, photo: &scene_io::Image) -> Option<Vec<f32>> {
        match self {
            Self::Codes { .. } => None,
            Self::Encoder { photos, .. } => photos.encode(photo),
        }
    }

    pub(super) fn push_state<'a>(&'a self, out: &mut Vec<Tensor<'a>>) {
        match self {
            Self::Codes { table, .. } => table.push_state(out),
            Self::Encoder { photos, .. } => photos.push_state(out),
        }
    }

    pub(super) fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        match self {
            Self::Codes { table, .. } => table.load_state(state),
            Self::Encoder { photos, .. } => photos.load_state(state),
        }
    }

    pub(super) fn len(&self) -> usize {
        match self {
            Self::Codes { table, .. } => table.len(),
            Self::Encoder { photos, .. } => photos.len(),
        }
    }

    pub(super) fn bytes(&self) -> usize {
        match self {
            Self::Codes { table, .. } => table.bytes(),
            Self::Encoder { photos, .. } => photos.bytes(),
        }
    }
}
