//! The light of a photo: a code that colours depend on and geometry does not.

use super::codes::CodeTable;
use super::config::{AppearanceKind, WildConfig};
use crate::data::{Batch, Dataset};
use crate::method::{Codes, Outcome};
use crate::system::{SystemError, Tensor, TensorMap};

/// Where the codes of photos come from.
pub(super) enum Light {
    /// They are free (NeRF-W).
    Codes { table: CodeTable, lr: f64, pull: f32 },
}

impl Light {
    /// As configured; `None` where all photos have the same light.
    pub(super) fn new(config: &WildConfig, data: &Dataset, seed: u64) -> Result<Option<Self>, SystemError> {
        Ok(match config.appearance {
            AppearanceKind::None => None,
            AppearanceKind::Codes | AppearanceKind::Encoder => Some(Self::Codes {
                table: CodeTable::new("appearance", data.len(), config.appearance_dims, seed),
                lr: f64::from(config.code_lr),
                pull: config.code_size,
            }),
        })
    }

    pub(super) fn codes(&self) -> Codes<'_> {
        match self {
            Self::Codes { table, .. } => table.codes(),
        }
    }

    /// The batch of a step is drawn.
    pub(super) fn begin(&mut self, _data: &Dataset, _batch: &Batch) -> Result<(), SystemError> {
        match self {
            Self::Codes { .. } => Ok(()),
        }
    }

    /// Returns the count of non-finite gradients.
    pub(super) fn learn(&mut self, outcome: &Outcome<'_>) -> usize {
        match self {
            Self::Codes { table, lr, pull } => {
                table.learn(outcome.simd, outcome.lr * *lr, outcome.batch, outcome.appearance_bar, *pull)
            }
        }
    }

    pub(super) fn encode(&self, _photo: &scene_io::Image) -> Option<Vec<f32>> {
        match self {
            Self::Codes { .. } => None,
        }
    }

    pub(super) fn push_state<'a>(&'a self, out: &mut Vec<Tensor<'a>>) {
        match self {
            Self::Codes { table, .. } => table.push_state(out),
        }
    }

    pub(super) fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        match self {
            Self::Codes { table, .. } => table.load_state(state),
        }
    }

    pub(super) fn len(&self) -> usize {
        match self {
            Self::Codes { table, .. } => table.len(),
        }
    }

    pub(super) fn bytes(&self) -> usize {
        match self {
            Self::Codes { table, .. } => table.bytes(),
        }
    }
}
