//! Hash grids against random reads.

use super::found::{Found, Row};
use crate::bench::Bench;
use crate::error::BenchError;
use crate::machine::level_name;
use crate::measure::{Case, interleaved};
use crate::sections::ceilings::{Big, LARGE_TABLE, SMALL_TABLE, Width, gather};
use field_core::encoding::hash_grid::{HashGrid, HashGridConfig};
use field_core::rng::Rng;
use float_core::Simd;
use std::collections::HashMap;
use std::hint::black_box;
use testkit::reference::lattice;

const SAMPLES_PER_RAY: usize = 32;

/// `[4][samples]` places in the unit cube, in order along rays, crowded on a tenth of each as around a surface; the last row is a time for
/// each ray.
pub(super) fn along_rays(samples: usize) -> Vec<f32> {
    let rng = Rng::new(1, 0);
    let mut x = vec![0.0; 4 * samples];
    for i in 0..samples {
        let (ray, k) = ((i / SAMPLES_PER_RAY) as u64, i % SAMPLES_PER_RAY);
        let (from, to) = (rng.uniform4_at(2 * ray), rng.uniform4_at(2 * ray + 1));
        let t = from[3] * 0.9 + 0.1 * k as f32 / SAMPLES_PER_RAY as f32;
        for a in 0..3 {
            x[a * samples + i] = from[a] + t * (to[a] - from[a]);
        }
        x[3 * samples + i] = to[3];
    }
    x
}

/// A grid with values, and samples in order along rays, crowded on a tenth of each as around a surface.
pub(crate) struct GridBatch {
    pub(crate) grid: HashGrid,
    params: Vec<f32>,
    x: Vec<f32>,
    out: Vec<f32>,
    grad: Vec<f32>,
}

impl GridBatch {
    pub(crate) fn new(config: HashGridConfig, samples: usize) -> Result<Self, BenchError> {
        let grid = HashGrid::new(config).map_err(BenchError::part)?;
        let mut x = along_rays(samples);
        x.truncate(3 * samples);
        let mut params = vec![0.0; grid.params_len()];
        Rng::new(2, 0).fill_uniform(0, &mut params);
        let (out, grad) = (vec![0.0; grid.out_rows() * samples], vec![0.0; grid.params_len()]);
        Ok(Self { grid, params, x, out, grad })
    }

    pub(crate) fn samples(&self) -> usize {
        self.x.len() / 3
    }

    /// Features of all samples. The shapes are the grid's own: it refuses nothing.
    pub(crate) fn forward(&mut self, simd: Simd) {
        let done = self.grid.encode(simd, &self.params, black_box(&self.x), &mut self.out);
        debug_assert!(done.is_ok());
    }

    /// Gradients of the table; the features stand in for their gradients.
    pub(crate) fn backward(&mut self, simd: Simd) {
        let done = self.grid.encode_backward(simd, black_box(&self.x), &self.out, &mut self.grad, None);
        debug_assert!(done.is_ok());
    }

    /// Errors of values and gradients against the twin on all samples: for small batches.
    fn errors(&mut self, simd: Simd) -> (f64, f64) {
        self.grad.fill(0.0);
        self.forward(simd);
        self.backward(simd);
        let (n, features) = (self.samples(), self.grid.config().features);
        let (mut values, mut scale) = (0.0_f64, f64::MIN_POSITIVE);
        let mut bars: HashMap<usize, f64> = HashMap::new();
        for (l, level) in self.grid.levels().iter().enumerate() {
            let entry = |v: [u32; 3]| level.offset + level.entry(v) as usize;
            let scale64 = f64::from(level.scale);
            let twin = lattice::Level {
                scale: scale64,
                shift: f64::from(level.shift),
                last_cell: scale64.ceil(),
                features,
                entry: &entry,
            };
            for i in 0..n {
                let x = [0, 1, 2].map(|a| f64::from(self.x[a * n + i]));
                for (f, want) in twin.forward(&self.params, x).into_iter().enumerate() {
                    let got = f64::from(self.out[(l * features + f) * n + i]);
                    values = values.max((got - want).abs());
                    scale = scale.max(want.abs());
                    for (entry, weight) in twin.corners(x) {
                        *bars.entry(entry * features + f).or_default() += weight * got;
                    }
                }
            }
        }
        let most = bars.values().fold(f64::MIN_POSITIVE, |m, b| m.max(b.abs()));
        // What the twin does not touch must be zero.
        let gradients = self.grad.iter().enumerate().filter(|(i, g)| **g != 0.0 || bars.contains_key(i));
        let gradients = gradients.map(|(i, &g)| (f64::from(g) - bars.get(&i).copied().unwrap_or(0.0)).abs());
        (values / scale, gradients.fold(0.0, f64::max) / most)
    }
}

pub(super) fn run(bench: &Bench, found: &mut Found) -> Result<(), BenchError> {
    let big = Big::new(LARGE_TABLE);
    for (levels, features, log2_table, wanted) in [(16, 2, 19, true), (8, 4, 17, false)] {
        let name = format!("hash grid {levels}x{features}, T = 2^{log2_table}");
        let config = HashGridConfig::default().with_levels(levels).with_features(features).with_log2_table(log2_table);
        let samples = bench.pick(1 << 14, 1 << 16);
        let (values, gradients) = GridBatch::new(config, 512)?.errors(bench.simd);
        // Eight corners a level, each an entry of `4 * features` bytes; a training step reads and then adds to it.
        let reads = (8 * levels) as f64;
        for threads in bench.pools.one_and_most() {
            let pools = &bench.pools;
            let mut batches = [GridBatch::new(config, samples)?, GridBatch::new(config, samples)?];
            let [one, two] = &mut batches;
            let (small, small_reads) = gather(pools, threads, &big, SMALL_TABLE, Width::Word);
            let (large, large_reads) = gather(pools, threads, &big, LARGE_TABLE, Width::Word);
            let mut cases = [
                small,
                large,
                Case::pooled(pools, threads, move || one.forward(bench.simd)),
                Case::pooled(pools, threads, move || {
                    two.forward(bench.simd);
                    two.backward(bench.simd);
                }),
            ];
            let seconds = interleaved(bench.effort, &mut cases);
            let rates = [small_reads / seconds[0], large_reads / seconds[1]];
            // A level at a time: only its table is hot, 4 MiB at most with either layout.
            let (ceiling, words) = (rates[0], "random 8-byte reads, 4 MiB hot (a level at a time)");
            for (job, passes, seconds) in [("forward", 1.0, seconds[2]), ("forward+backward", 2.0, seconds[3])] {
                let row = Row {
                    kernel: &format!("{name} {job}"),
                    level: level_name(bench.simd.level()),
                    threads,
                    rate: samples as f64 / seconds,
                    unit: "samples",
                    ceiling: Some((ceiling / (reads * passes), words)),
                    error: (Some(values), (passes > 1.0).then_some(gradients)),
                };
                found.row(&row)?;
                if wanted && threads == bench.pools.most() && passes > 1.0 {
                    found.goal(&row, 0.6, 0.09);
                    // The same figure, were all levels hot at once as on a GPU.
                    found.row(&Row {
                        kernel: &format!("{name} {job}"),
                        ceiling: Some((rates[1] / (reads * passes), "the same, all 64 MiB hot at once")),
                        ..row
                    })?;
                }
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grid_is_as_near_the_twin_as_its_tests_say() {
        let config = HashGridConfig::default().with_levels(4).with_log2_table(10);
        let (values, gradients) = GridBatch::new(config, 64).unwrap().errors(Simd::best());
        assert!(values > 0.0 && values < 3e-6 && gradients > 0.0 && gradients < 3e-6, "{values} {gradients}");
    }
}
