//! A free code for each training photo; codes of other photos are fitted.

use super::AppearanceModel;
use super::config::CodeConfig;
use crate::codes::CodeTable;
use crate::photo_model::{Codes, Outcome};
use engine::system::{SystemError, Tensor, TensorMap};

/// The codes.
pub(crate) struct FreeCodes {
    table: CodeTable,
    lr: f64,
    size: f32,
}

impl FreeCodes {
    /// Random codes of `views` photos.
    pub(crate) fn new(settings: &CodeConfig, views: usize, seed: u64) -> Self {
        Self {
            table: CodeTable::new("appearance", views, settings.appearance_dims, seed),
            lr: f64::from(settings.code_lr),
            size: settings.code_size,
        }
    }
}

impl AppearanceModel for FreeCodes {
    fn codes(&self) -> Codes<'_> {
        self.table.codes()
    }

    fn learn(&mut self, outcome: &Outcome<'_>) -> usize {
        let lr = outcome.lr * self.lr;
        self.table.learn(outcome.simd, lr, outcome.batch, outcome.appearance_bar, self.size)
    }

    fn push_state<'a>(&'a self, out: &mut Vec<Tensor<'a>>) {
        self.table.push_state(out);
    }

    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        self.table.load_state(state)
    }

    fn parameter_count(&self) -> usize {
        self.table.len()
    }

    fn memory_bytes(&self) -> usize {
        self.table.bytes()
    }
}
