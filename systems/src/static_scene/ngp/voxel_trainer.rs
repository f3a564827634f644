//! The update of a voxel grid that is seen at three distances: each distance scatters into a gradient of its own, these are
//! added in order, and Adam steps on what was touched.

use super::ADAM;
use super::field::shapes_hold;
use super::grid_trainer::Part;
use field_core::encoding::hash_grid::BLOCK_FLOATS;
use field_core::encoding::multi_distance::{MultiDistance, STRIDES};
use float_core::Simd;
use optim::Adam;
use rayon::prelude::*;

/// Moments and gradients of a grid's parameters.
pub(super) struct VoxelTrainer {
    pub(super) adam: Adam,
    /// One for each distance.
    distances: [Distance; STRIDES.len()],
}

struct Distance {
    grad: Vec<f32>,
    touched: Vec<u64>,
}

impl VoxelTrainer {
    pub(super) fn new(grid: &MultiDistance) -> Self {
        let distance = || Distance { grad: vec![0.0; grid.params_len()], touched: vec![0; grid.touched_words()] };
        Self { adam: Adam::new(grid.params_len(), ADAM), distances: std::array::from_fn(|_| distance()) }
    }

    /// One step; see [`GridTrainer::step`](super::grid_trainer::GridTrainer::step).
    pub(super) fn step(
        &mut self,
        simd: Simd,
        grid: &MultiDistance,
        params: &mut [f32],
        lr: f64,
        parts: &[Part<'_>],
    ) -> usize {
        self.distances.par_iter_mut().enumerate().for_each(|(k, Distance { grad, touched })| {
            for &Part { n, x, features_bar } in parts {
                let rows = grid.features() * n;
                let bars = &features_bar[k * rows..][..rows];
                shapes_hold(grid.encode_stride_backward_touched(simd, k, &x[..3 * n], bars, grad, touched));
            }
        });
        let [all, others @ ..] = &mut self.distances;
        for other in others {
            fold(all, other);
        }
        self.adam.step_touched(simd, lr, params, &mut all.grad, &mut all.touched)
    }
}

/// Add what was touched of one gradient to another, and clear it.
fn fold(all: &mut Distance, other: &mut Distance) {
    for (word, (marks, own)) in all.touched.iter_mut().zip(&mut other.touched).enumerate() {
        *marks |= *own;
        while *own != 0 {
            let block = 64 * word + own.trailing_zeros() as usize;
            let from = block * BLOCK_FLOATS;
            let to = (from + BLOCK_FLOATS).min(all.grad.len());
            for (sum, g) in all.grad[from..to].iter_mut().zip(&mut other.grad[from..to]) {
                *sum += std::mem::take(g);
            }
            *own &= *own - 1;
        }
    }
}
