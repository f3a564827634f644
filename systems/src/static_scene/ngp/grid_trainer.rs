//! The update of a hash grid: the gradient of each level, scattered in sample order, and Adam on the entries it touched.

use super::ADAM;
use super::field::shapes_hold;
use field_core::encoding::hash_grid::{HashGrid, MAX_LEVELS, Touched};
use float_core::Simd;
use optim::Adam;
use rayon::prelude::*;

/// What a chunk of a batch brings to the gradient.
#[derive(Clone, Copy, Debug)]
pub(super) struct Part<'a> {
    /// Samples.
    pub(super) n: usize,
    /// `[3][n]`, positions in the grid.
    pub(super) x: &'a [f32],
    /// `[levels * features][n]`, gradient of the features.
    pub(super) features_bar: &'a [f32],
}

/// Moments and gradient of a grid's parameters.
pub(super) struct GridTrainer {
    /// One for each level of the grid.
    pub(super) adam: Vec<Adam>,
    grad: Vec<f32>,
    touched: Touched,
}

/// What the update of one level writes.
struct LevelJob<'a> {
    adam: &'a mut Adam,
    touched: &'a mut [u64],
    params: &'a mut [f32],
    grad: &'a mut [f32],
}

impl GridTrainer {
    pub(super) fn new(grid: &HashGrid) -> Self {
        Self {
            adam: (0..grid.levels().len()).map(|l| Adam::new(grid.level_range(l).len(), ADAM)).collect(),
            grad: vec![0.0; grid.params_len()],
            touched: Touched::new(grid),
        }
    }

    /// One step of the first `open` levels. The parts add up in order, whatever the number of threads; each level is one task. Returns the count of
    /// non-finite gradients.
    pub(super) fn step(
        &mut self,
        simd: Simd,
        grid: &HashGrid,
        params: &mut [f32],
        lr: f64,
        parts: &[Part<'_>],
        open: usize,
    ) -> usize {
        let features = grid.config().features;
        let mut jobs: [Option<LevelJob<'_>>; MAX_LEVELS] = [const { None }; MAX_LEVELS];
        let (mut params, mut grads) = (params, &mut self.grad[..]);
        for ((level, adam), touched) in self.adam.iter_mut().enumerate().zip(self.touched.levels_mut()) {
            let len = grid.level_range(level).len();
            let (p, rest) = params.split_at_mut(len);
            params = rest;
            let (grad, rest) = grads.split_at_mut(len);
            grads = rest;
            jobs[level] = Some(LevelJob { adam, touched, params: p, grad });
        }
        let update = |(level, job): (usize, &mut Option<LevelJob<'_>>)| {
            let Some(LevelJob { adam, touched, params, grad }) = job else { return 0 };
            for &Part { n, x, features_bar } in parts {
                let bars = &features_bar[level * features * n..][..features * n];
                shapes_hold(grid.encode_level_backward(simd, level, &x[..3 * n], bars, grad, Some(touched)));
            }
            adam.step_touched(simd, lr, params, grad, touched)
        };
        jobs[..open].par_iter_mut().enumerate().map(update).sum()
    }
}
