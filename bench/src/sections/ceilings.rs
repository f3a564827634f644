//! What the machine can do at most: the denominators of every share of a ceiling.

use crate::bench::Bench;
use crate::error::BenchError;
use crate::machine::level_name;
use crate::measure::{Case, Pools, interleaved};
use crate::page::{Item, Section};
use crate::table::Table;
use float_core::{Simd, SimdLevel, Task, Vector};
use std::hint::black_box;

pub(crate) fn run(bench: &Bench) -> Result<Section, BenchError> {
    let mut table = Table::new(
        "ceilings",
        "Fused multiply-adds on registers (the scalar level multiplies and adds, as its kernels do), streaming reads, \
         and independent reads at random places.",
        &["what", "threads", "figure", "unit"],
    );
    let big = Big::new(bench.pick(96, 256) << 20);
    let mut rows: Vec<(String, usize, f64, &str)> = Vec::new();
    let mut cases = Vec::new();
    for threads in bench.pools.one_and_most() {
        for simd in Simd::available() {
            let (case, flops) = fma(&bench.pools, simd, threads);
            rows.push((format!("f32 multiply-add, {}", level_name(simd.level())), threads, flops * 1e-9, "GFLOP/s"));
            cases.push(case);
        }
        let (case, bytes) = read(&bench.pools, bench.simd, threads, &big);
        rows.push((format!("read, {} MB", big.0.len() * 4 / 1_000_000), threads, bytes * 1e-9, "GB/s"));
        cases.push(case);
        for (size, name) in [(SMALL_TABLE, "4 MiB"), (LARGE_TABLE, "64 MiB")] {
            for (width, of) in [(Width::Word, "8-byte reads"), (Width::Line, "64-byte lines")] {
                let (case, reads) = gather(&bench.pools, threads, &big, size, width);
                rows.push((format!("random {of}, table of {name}"), threads, reads * 1e-6, "M/s"));
                cases.push(case);
            }
        }
    }
    let seconds = interleaved(bench.effort, &mut cases);
    for ((what, threads, amount, unit), seconds) in rows.into_iter().zip(seconds) {
        table.row([what.into(), threads.into(), (amount / seconds).into(), unit.into()])?;
    }
    Ok(Section {
        title: "Ceilings",
        intro: "What this machine gives at most to arithmetic, streams and scattered reads. These are measurements, without an \
                error of their own to state: they compute nothing that is kept. The other sections measure the ceilings that \
                they compare with again, interleaved with the kernels.",
        items: vec![Item::Table(table)],
        goals: Vec::new(),
    })
}

/// Bytes of the tables that are read at random.
pub(crate) const SMALL_TABLE: usize = 4 << 20;
pub(crate) const LARGE_TABLE: usize = 64 << 20;

/// Numbers, more than the caches hold.
pub(crate) struct Big(Vec<f32>);

impl Big {
    /// So many bytes, at least those of the largest table.
    pub(crate) fn new(bytes: usize) -> Self {
        // Not zeros: pages that were never written to share one page of the machine.
        Self((0..bytes.max(LARGE_TABLE) / 4).map(|i| (i % 1013) as f32).collect())
    }
}

/// Multiply-adds on `N` vectors that stay in registers.
struct Fma<const N: usize> {
    rounds: usize,
    factor: f32,
}

impl<const N: usize> Task for Fma<N> {
    type Output = (f32, usize);
    #[inline(always)]
    fn run<V: Vector>(self) -> (f32, usize) {
        let (a, b) = (V::splat(self.factor), V::splat(1.0 - self.factor));
        let mut sums = [V::splat(0.5); N];
        for _ in 0..self.rounds {
            for sum in &mut sums {
                *sum = sum.mul_add(a, b);
            }
        }
        let mut all = V::splat(0.0);
        for sum in sums {
            all = all + sum;
        }
        (all.sum(), 2 * N * V::LANES * self.rounds)
    }
}

/// Work at the peak of a level, and its floating-point operations a call.
pub(crate) fn fma(pools: &Pools, simd: Simd, threads: usize) -> (Case<'_>, f64) {
    const ROUNDS: usize = 20_000;
    // Enough chains to hide the latency, few enough to stay in the registers: at the scalar level a vector takes two.
    let work = move |factor: f32| match simd.level() {
        SimdLevel::Scalar => simd.run(Fma::<6> { rounds: ROUNDS, factor }),
        _ => simd.run(Fma::<12> { rounds: ROUNDS, factor }),
    };
    let (_, flops) = work(0.5);
    let case = Case::parallel(
        pools,
        threads,
        || 0.9_f32,
        move |factor| {
            black_box(work(black_box(*factor)));
        },
    );
    (case, (flops * threads) as f64)
}

/// The sum of a stream.
struct Sum<'a>(&'a [f32]);

impl Task for Sum<'_> {
    type Output = f32;
    #[inline(always)]
    fn run<V: Vector>(self) -> f32 {
        let mut sums = [V::splat(0.0); 8];
        for block in self.0.chunks_exact(8 * V::LANES) {
            for (k, sum) in sums.iter_mut().enumerate() {
                *sum = *sum + V::load(&block[k * V::LANES..]);
            }
        }
        sums.iter().map(|s| s.sum()).sum()
    }
}

/// Every number once, each thread its part, and the bytes a call.
pub(crate) fn read<'a>(pools: &'a Pools, simd: Simd, threads: usize, big: &'a Big) -> (Case<'a>, f64) {
    let part = big.0.len() / threads;
    let mut parts = big.0.chunks_exact(part);
    let case = Case::parallel(
        pools,
        threads,
        move || parts.next().unwrap_or(&[]),
        move |part| {
            black_box(simd.run(Sum(black_box(part))));
        },
    );
    (case, (part * threads * 4) as f64)
}

/// How much is read at a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Width {
    /// 8 bytes: an entry of two features.
    Word,
    /// 64 bytes: a cache line.
    Line,
}

/// Reads at random places of the first `size` bytes, which all threads share, and their number a call.
pub(crate) fn gather<'a>(pools: &'a Pools, threads: usize, big: &'a Big, size: usize, width: Width) -> (Case<'a>, f64) {
    const READS: usize = 100_000;
    let table = &big.0[..size / 4];
    let mut seed = 0_u64;
    let state = move || {
        seed += 1;
        seed << 40
    };
    let case = Case::parallel(pools, threads, state, move |at: &mut u64| {
        black_box(match width {
            Width::Word => sum_of::<2>(table, *at, READS),
            Width::Line => sum_of::<16>(table, *at, READS),
        });
        *at += READS as u64;
    });
    (case, (READS * threads) as f64)
}

/// Sum of `N` numbers each at `reads` places; no read waits for another.
fn sum_of<const N: usize>(table: &[f32], from: u64, reads: usize) -> f32 {
    let (entries, _) = table.as_chunks::<N>();
    let mask = entries.len() - 1;
    let mut sums = [0.0_f32; N];
    for i in 0..reads as u64 {
        // Two rounds of multiply and shift scatter a counter.
        let h = (from + i).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let h = (h ^ (h >> 32)).wrapping_mul(0xD6E8_FEB8_6659_FD93);
        let entry = &entries[(h >> 32) as usize & mask];
        for (sum, x) in sums.iter_mut().zip(entry) {
            *sum += x;
        }
    }
    sums.iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ceilings_compute_what_they_say() {
        for simd in Simd::available() {
            let (value, flops) = simd.run(Fma::<12> { rounds: 10, factor: 0.5 });
            // x -> x / 2 + 1 / 2 from 1/2 tends to 1.
            let lanes = flops / (2 * 12 * 10);
            let want = (12 * lanes) as f32 * (1.0 - 0.5_f32.powi(11));
            assert!((value - want).abs() < 1e-2 * want, "{simd:?}: {value} {want}");
            assert_eq!(simd.run(Sum(&[1.0; 1024])), 1024.0);
        }
        assert_eq!(sum_of::<2>(&[1.0; 1024], 5, 100), 200.0);
        assert_eq!(sum_of::<16>(&[1.0; 1024], 5, 100), 1600.0);
    }
}
