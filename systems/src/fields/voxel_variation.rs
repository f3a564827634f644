//! Variation of a grid of voxels: neighbours should not differ (DVGO and TiNeuVox, grid variation of the released code).
//!
//! ```text
//! L = factor sum_axes mean over pairs of neighbours (p_i - p_j)^2
//! ```
//!
//! The gradient is that of this loss at the voxels that a step sees, and nothing elsewhere: as sparse as the step itself. The released
//! code has a Huber loss of width 1, which is the same where neighbours differ by less than 1, and sums instead of means.

use field_core::encoding::hash_grid::BLOCK_FLOATS;
use field_core::encoding::multi_distance::MultiDistance;
use rayon::prelude::*;

/// Words of marks of a task.
const WORDS: usize = 32;

/// The three axes of a grid, in parameters.
struct Axes {
    /// From one vertex to the next along x, y, z, and from the first to past the last.
    strides: [usize; 3],
    extents: [usize; 3],
    /// Twice the factor over the pairs along each.
    factors: [f32; 3],
}

impl Axes {
    fn of(grid: &MultiDistance, factor: f64) -> Self {
        let [x, y, z] = grid.vertices().map(|v| v as usize);
        let strides = [grid.features(), grid.features() * x, grid.features() * x * y];
        let extents = [strides[1], strides[2], strides[2] * z];
        let all = grid.params_len() as f64;
        let factors = [x, y, z].map(|n| (2.0 * factor / (all / n as f64 * (n as f64 - 1.0)).max(1.0)) as f32);
        Self { strides, extents, factors }
    }

    /// The derivative of the loss with respect to parameter `i`.
    #[inline]
    fn derivative(&self, params: &[f32], i: usize) -> f32 {
        let mut sum = 0.0;
        for a in 0..3 {
            let (stride, extent) = (self.strides[a], self.extents[a]);
            let at = i % extent;
            let mut differences = 0.0;
            if at >= stride {
                differences += params[i] - params[i - stride];
            }
            if at + stride < extent {
                differences += params[i] - params[i + stride];
            }
            sum += self.factors[a] * differences;
        }
        sum
    }
}

/// Add the gradient of the variation of `params` `[z][y][x][features]`, times `factor`, to the blocks of `grad` that `touched` marks.
pub(super) fn vary(grid: &MultiDistance, factor: f64, params: &[f32], grad: &mut [f32], touched: &[u64]) {
    if factor == 0.0 {
        return;
    }
    let axes = Axes::of(grid, factor);
    let task = WORDS * 64 * BLOCK_FLOATS;
    grad.par_chunks_mut(task).zip(touched.par_chunks(WORDS)).enumerate().for_each(|(k, (grad, touched))| {
        for (word, &marks) in touched.iter().enumerate() {
            let mut left = marks;
            while left != 0 {
                let from = (64 * word + left.trailing_zeros() as usize) * BLOCK_FLOATS;
                if from >= grad.len() {
                    break;
                }
                let to = (from + BLOCK_FLOATS).min(grad.len());
                for (i, bar) in (from..to).zip(&mut grad[from..to]) {
                    *bar += axes.derivative(params, k * task + i);
                }
                left &= left - 1;
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use field_core::rng::Rng;
    use losses::kernel::Kernel;
    use losses::variation::total_variation_backward;

    fn made(resolution: [u32; 3]) -> (MultiDistance, Vec<f32>) {
        let grid = MultiDistance::new(resolution, 2).unwrap();
        let mut params = vec![0.0; grid.params_len()];
        Rng::new(3, 4).fill_uniform(0, &mut params);
        (grid, params)
    }

    #[test]
    fn where_all_is_touched_it_is_the_gradient_of_the_total_variation() {
        for resolution in [[5, 9, 7], [2, 2, 2], [17, 6, 30]] {
            let (grid, params) = made(resolution);
            let (mut grad, mut want) = (vec![0.25; params.len()], vec![0.25; params.len()]);
            vary(&grid, 3.0, &params, &mut grad, &vec![u64::MAX; grid.touched_words()]);
            let [x, y, z] = grid.vertices().map(|v| v as usize);
            let shape = [z, y, x, grid.features()];
            total_variation_backward(&params, &shape, &[0, 1, 2], Kernel::Squared, 3.0, &mut want).unwrap();
            for (i, (got, want)) in grad.iter().zip(&want).enumerate() {
                assert!((got - want).abs() < 1e-5 * want.abs().max(1.0), "{resolution:?} {i}: {got} and {want}");
            }
        }
    }

    #[test]
    fn what_is_not_touched_is_left_alone_and_without_a_factor_all_is() {
        let (grid, params) = made([9, 9, 9]);
        let mut touched = vec![0; grid.touched_words()];
        touched[1] = 0b101;
        let mut grad = vec![0.0; params.len()];
        vary(&grid, 0.0, &params, &mut grad, &touched);
        assert!(grad.iter().all(|&g| g == 0.0));
        vary(&grid, 1.0, &params, &mut grad, &touched);
        let block = |i: usize| i / BLOCK_FLOATS;
        for (i, g) in grad.iter().enumerate() {
            assert_eq!(*g != 0.0, [64, 66].contains(&block(i)), "parameter {i}");
        }
    }

    #[test]
    fn voxels_that_are_all_the_same_cost_nothing() {
        let (grid, params) = made([9, 5, 9]);
        let mut grad = vec![0.0; params.len()];
        vary(&grid, 1.0, &vec![0.7; params.len()], &mut grad, &vec![u64::MAX; grid.touched_words()]);
        assert!(grad.iter().all(|&g| g == 0.0));
    }
}
