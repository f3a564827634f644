//! Rigid motions of points, the warp of a deformed field: no ceiling is known of, they are bound by sines and divisions.

use super::found::{Found, Kernel, Row, passes};
use crate::bench::Bench;
use crate::error::BenchError;
use crate::machine::level_name;
use crate::measure::{interleaved, worst};
use field_core::deform::{RigidBars, rigid_points, rigid_points_backward};
use field_core::lie::{se3_exp, se3_exp_derivative};
use field_core::rng::Rng;
use float_core::Simd;
use std::hint::black_box;

const POINTS: usize = 1024;

/// Points, their motions, and the gradients of all; `[3][n]` each.
struct Batch {
    /// Point, rotation vector, translation.
    at: [Vec<f32>; 3],
    out: Vec<f32>,
    bars: [Vec<f32>; 3],
}

impl Kernel for Batch {
    /// The shapes are the batch's own: nothing is refused.
    fn forward(&mut self, simd: Simd) {
        let [x, omega, v] = &self.at;
        let done = rigid_points(simd, black_box(x), omega, v, &mut self.out);
        debug_assert!(done.is_ok());
    }

    /// Gradients; the moved points stand in for their own.
    fn backward(&mut self, simd: Simd) {
        let ([x, omega, v], [x_bar, omega_bar, v_bar]) = (&self.at, &mut self.bars);
        let bars = RigidBars { x: x_bar, omega: omega_bar, v: v_bar };
        let done = rigid_points_backward(simd, black_box(x), omega, v, &self.out, bars);
        debug_assert!(done.is_ok());
    }
}

impl Batch {
    fn new(points: usize) -> Self {
        let rows = |stream: u64, scale: f32| {
            let mut x = vec![0.0; 3 * points];
            Rng::new(1, stream).fill_normal(0, &mut x);
            x.iter_mut().for_each(|x| *x *= scale);
            x
        };
        let zero = || vec![0.0; 3 * points];
        Self { at: [rows(1, 1.0), rows(2, 0.1), rows(3, 0.1)], out: zero(), bars: [zero(), zero(), zero()] }
    }

    /// Errors of places and of the gradients of the rotation vectors against matrices in `f64`.
    fn errors(&mut self, simd: Simd) -> (f64, f64) {
        self.bars.iter_mut().for_each(|bar| bar.fill(0.0));
        self.forward(simd);
        self.backward(simd);
        let n = self.out.len() / 3;
        let (mut places, mut bars) = (vec![0.0; 3 * n], vec![0.0; 3 * n]);
        for s in 0..n {
            let get = |part: usize, r: usize| f64::from(self.at[part][r * n + s]);
            let twist = [get(1, 0), get(1, 1), get(1, 2), get(2, 0), get(2, 1), get(2, 2)];
            let (t, d) = (se3_exp(twist), se3_exp_derivative(twist));
            for i in 0..3 {
                places[i * n + s] = (0..3).map(|j| t[i][j] * get(0, j)).sum::<f64>() + t[i][3];
                for k in 0..3 {
                    let along = (0..3).map(|j| d[i][j][k] * get(0, j)).sum::<f64>() + d[i][3][k];
                    bars[k * n + s] += f64::from(self.out[i * n + s]) * along;
                }
            }
        }
        (worst(&self.out, &places), worst(&self.bars[1], &bars))
    }
}

pub(super) fn run(bench: &Bench, found: &mut Found) -> Result<(), BenchError> {
    let simd = bench.simd;
    let (values, gradients) = Batch::new(256).errors(simd);
    for threads in bench.pools.one_and_most() {
        let state = || Some(Batch::new(POINTS));
        let mut cases = passes(&bench.pools, simd, threads, state);
        let seconds = interleaved(bench.effort, &mut cases);
        for (j, job) in ["forward", "forward+backward"].into_iter().enumerate() {
            found.row(&Row {
                kernel: &format!("rigid motion of points {job}"),
                level: level_name(simd.level()),
                threads,
                rate: (POINTS * threads) as f64 / seconds[j],
                unit: "points",
                ceiling: None,
                error: (Some(values), (j == 1).then_some(gradients)),
            })?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motions_are_as_near_the_twin_as_their_tests_say() {
        for simd in Simd::available() {
            let (values, gradients) = Batch::new(64).errors(simd);
            assert!(values > 0.0 && values < 1e-6 && gradients > 0.0 && gradients < 3e-6, "{values} {gradients}");
        }
    }
}
