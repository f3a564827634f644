//! `gamma(t)`: the time, its sines and cosines (D-NeRF).

use super::input::{TimeInput, transposed};
use crate::warps::octaves::frequency;
use engine::system::SystemError;
use field_core::encoding::frequency::{Frequency, Identity};
use float_core::Simd;

/// Octaves of the time, with the time itself.
pub(super) struct Gamma {
    frequency: Frequency,
    simd: Simd,
}

impl Gamma {
    pub(super) fn new(octaves: usize, simd: Simd) -> Result<Self, SystemError> {
        Ok(Self { frequency: frequency(1, octaves, Identity::Include)?, simd })
    }

    /// `[dims][times]`
    pub(super) fn of(&self, times: &[f64]) -> Vec<f32> {
        let t: Vec<f32> = times.iter().map(|&t| t as f32).collect();
        let mut out = vec![0.0; self.dims() * t.len()];
        self.frequency.encode(self.simd, &t, None, &mut out).expect("one row of times");
        out
    }

    pub(super) fn simd(&self) -> Simd {
        self.simd
    }
}

impl TimeInput for Gamma {
    fn dims(&self) -> usize {
        self.frequency.out_rows()
    }

    fn rows(&self, _learned: &[f32], times: &[f64]) -> Vec<f32> {
        transposed(self.dims(), times.len(), &self.of(times))
    }

    fn backward(&self, _learned: &[f32], _rows_bar: &[f32], _learned_bar: &mut [f32]) {}

    fn learns(&self) -> bool {
        false
    }
}
