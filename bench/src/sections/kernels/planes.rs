//! Planes of features against random reads of whole cache lines.

use super::found::{Found, Kernel, Row, passes};
use super::grid::along_rays;
use crate::bench::Bench;
use crate::error::BenchError;
use crate::machine::level_name;
use crate::measure::{interleaved, worst};
use crate::sections::ceilings::{Big, SMALL_TABLE, Width, gather};
use field_core::encoding::EncodingBars;
use field_core::encoding::planes::Planes;
use field_core::rng::Rng;
use float_core::Simd;
use std::hint::black_box;
use testkit::reference::planes as twin;

/// A vertex is one cache line.
const FEATURES: usize = 16;

/// Planes with values, and samples in order along rays, each ray at a time of its own.
struct Batch {
    planes: Planes,
    table: Vec<f32>,
    x: Vec<f32>,
    out: Vec<f32>,
    table_bar: Vec<f32>,
    x_bar: Vec<f32>,
}

impl Kernel for Batch {
    /// The shapes are the planes' own: they refuse nothing.
    fn forward(&mut self, simd: Simd) {
        let done = self.planes.encode(simd, &self.table, black_box(&self.x), &mut self.out);
        debug_assert!(done.is_ok());
    }

    /// Gradients of table and places; the features stand in for their gradients.
    fn backward(&mut self, simd: Simd) {
        let bars = EncodingBars::both(&mut self.table_bar, &mut self.x_bar);
        let done = self.planes.encode_backward(simd, &self.table, black_box(&self.x), &self.out, bars);
        debug_assert!(done.is_ok());
    }
}

impl Batch {
    fn new(resolution: [u32; 4], samples: usize) -> Result<Self, BenchError> {
        let planes = Planes::k_planes(resolution, FEATURES).map_err(BenchError::part)?;
        let x: Vec<f32> = along_rays(samples).into_iter().map(|x| 2.0 * x - 1.0).collect();
        let mut table = vec![0.0; planes.params_len()];
        Rng::new(2, 0).fill_uniform(0, &mut table);
        let (out, table_bar) = (vec![0.0; planes.out_rows() * samples], vec![0.0; table.len()]);
        let x_bar = vec![0.0; x.len()];
        Ok(Self { planes, table, x, out, table_bar, x_bar })
    }

    /// Errors of values and of the table's gradients against the twin on all samples: for small batches.
    fn errors(&mut self, simd: Simd) -> (f64, f64) {
        self.table_bar.fill(0.0);
        self.forward(simd);
        self.backward(simd);
        let pairs: Vec<_> = self.planes.pairs().collect();
        let resolution = self.planes.resolution();
        let planes = twin::Planes { resolution, features: FEATURES, pairs: &pairs, combine: twin::Combine::Product };
        let table: Vec<f64> = self.table.iter().map(|&v| v.into()).collect();
        let n = self.x.len() / 4;
        let (mut values, mut bars) = (vec![0.0; self.out.len()], vec![0.0; table.len()]);
        for i in 0..n {
            let x = [0, 1, 2, 3].map(|a| f64::from(self.x[a * n + i]));
            for f in 0..FEATURES {
                let at = f * n + i;
                let point = planes.point(&table, &x, f);
                values[at] = point.value;
                point.by_table.iter().for_each(|(entry, d)| bars[*entry] += d * f64::from(self.out[at]));
            }
        }
        (worst(&self.out, &values), worst(&self.table_bar, &bars))
    }
}

pub(super) fn run(bench: &Bench, found: &mut Found) -> Result<(), BenchError> {
    let big = Big::new(SMALL_TABLE);
    let resolution = [128, 128, 128, 50];
    let samples = bench.pick(1 << 13, 1 << 15);
    let (values, gradients) = Batch::new(resolution, 256)?.errors(bench.simd);
    // Four vertices on each of six planes. The way back reads them again, reads their gradients and adds to these.
    let reads = 24.0;
    for threads in bench.pools.one_and_most() {
        let pools = &bench.pools;
        let (small, small_reads) = gather(pools, threads, &big, SMALL_TABLE, Width::Line);
        // A tile a thread, as the driver does. The shape was legal before.
        let state = || Batch::new(resolution, samples / threads).ok();
        let [forward, both] = passes(pools, bench.simd, threads, state);
        let mut cases = [small, forward, both];
        let seconds = interleaved(bench.effort, &mut cases);
        let rate = small_reads / seconds[0];
        for (job, passes, seconds) in [("forward", 1.0, seconds[1]), ("forward+backward", 3.0, seconds[2])] {
            found.row(&Row {
                kernel: &format!("K-Planes 128x128x128x50 of {FEATURES} {job}"),
                level: level_name(bench.simd.level()),
                threads,
                rate: (samples / threads * threads) as f64 / seconds,
                unit: "samples",
                ceiling: Some((rate / (reads * passes), "random 64-byte reads, 4 MiB hot")),
                error: (Some(values), (passes > 1.0).then_some(gradients)),
            })?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_are_as_near_the_twin_as_their_tests_say() {
        let (values, gradients) = Batch::new([5, 6, 7, 3], 64).unwrap().errors(Simd::best());
        assert!(values > 0.0 && values < 3e-6 && gradients > 0.0 && gradients < 3e-6, "{values} {gradients}");
    }
}
