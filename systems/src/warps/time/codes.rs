//! `w_i`: a free code for each time step (Nerfies, section 3.2), linear in between.

use super::frames::Times;
use super::input::TimeInput;
use crate::codes::fill_uniform;
use field_core::rng::Rng;

/// A code for each time step of the training views.
pub(super) struct Codes {
    dims: usize,
    times: Times,
}

impl Codes {
    /// Their initial values are put into `codes`, `[steps][dims]`.
    pub(super) fn new(dims: usize, times: Times, rng: Rng, codes: &mut Vec<f32>) -> Self {
        codes.resize(dims * times.len(), 0.0);
        fill_uniform(rng, codes);
        Self { dims, times }
    }
}

impl TimeInput for Codes {
    fn dims(&self) -> usize {
        self.dims
    }

    fn rows(&self, codes: &[f32], times: &[f64]) -> Vec<f32> {
        let rows = times.iter().flat_map(|&t| {
            let at = self.times.between(t);
            let code = |step: usize| &codes[step * self.dims..][..self.dims];
            let pair = code(at.before).iter().zip(code(at.after));
            pair.map(|(a, b)| a + at.share * (b - a)).collect::<Vec<f32>>()
        });
        rows.collect()
    }

    fn backward(&self, _codes: &[f32], rows_bar: &[f32], codes_bar: &mut [f32]) {
        for (view, bar) in rows_bar.chunks_exact(self.dims).enumerate() {
            let at = self.times.step(view) * self.dims;
            codes_bar[at..at + self.dims].iter_mut().zip(bar).for_each(|(sum, bar)| *sum += bar);
        }
    }
}
