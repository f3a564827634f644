//! What robustness costs a step: kernels and their weights, the trimmed mask of a batch, the static mask of an image.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use losses::heuristics::{Extent, Scratch, Segments, StaticMask};
use losses::kernel::Kernel;
use losses::trimmed::{Border, TrimmedMask};
use losses::uncertainty::Likelihood;
use std::{hint::black_box, time::Duration};

/// Numbers in `[0, 1)`.
fn numbers(n: usize, salt: usize) -> Vec<f32> {
    (0..n).map(|i| ((i + salt) * 7919 % 4099) as f32 / 4099.0).collect()
}

fn bench_kernels(c: &mut Criterion) {
    let mut group = c.benchmark_group("losses/kernel");
    let n = 3 * 4096;
    let e = numbers(n, 0);
    group.throughput(Throughput::Elements(n as u64));
    for (name, kernel) in [
        ("squared", Kernel::Squared),
        ("charbonnier", Kernel::CHARBONNIER_360),
        ("general", Kernel::General { shape: -0.5, c: 0.1 }),
        ("cauchy", Kernel::Cauchy { c: 0.1 }),
        ("geman_mcclure", Kernel::GemanMcClure { c: 0.1 }),
        ("welsch", Kernel::Welsch { c: 0.1 }),
        ("tukey", Kernel::Tukey { c: 0.3 }),
        ("trimmed", Kernel::Trimmed { c: 0.3 }),
    ] {
        group.bench_function(BenchmarkId::new(format!("{name}/value"), n), |b| {
            b.iter(|| black_box(&e).iter().map(|&e| kernel.value(e, 0.0)).sum::<f32>());
        });
        group.bench_function(BenchmarkId::new(format!("{name}/weight"), n), |b| {
            b.iter(|| black_box(&e).iter().map(|&e| kernel.weight(e, 0.0)).sum::<f32>());
        });
    }
    group.finish();
}

fn bench_trimmed(c: &mut Criterion) {
    let mut group = c.benchmark_group("losses/trimmed");
    for patches in [0, 16, 64] {
        let e = numbers(patches * 256, 1);
        let (mut scratch, mut out) = (vec![], vec![0.0; e.len()]);
        group.throughput(Throughput::Elements(e.len() as u64));
        let mask = TrimmedMask::default();
        group.bench_function(BenchmarkId::new("threshold", e.len()), |b| {
            b.iter(|| mask.threshold(black_box(&e), &mut scratch));
        });
        for (name, border) in [("valid", Border::Valid), ("zero", Border::Zero)] {
            let mask = mask.with_border(border);
            group.bench_function(BenchmarkId::new(format!("weights/{name}"), e.len()), |b| {
                b.iter(|| mask.weights(black_box(&e), 0.5, &mut scratch, black_box(&mut out)));
            });
        }
    }
    group.finish();
}

fn bench_likelihood(c: &mut Criterion) {
    let mut group = c.benchmark_group("losses/likelihood");
    for n in [0, 4096] {
        let (x, beta) = (numbers(6 * n, 2), numbers(n, 3));
        let (prediction, target) = x.as_chunks::<3>().0.split_at(n);
        let (mut colour_bar, mut beta_bar) = (vec![[0.0; 3]; n], vec![0.0; n]);
        let likelihood = Likelihood::PHOTOGRAPHS;
        group.throughput(Throughput::Elements(n as u64));
        group.bench_function(BenchmarkId::new("mean", n), |b| {
            b.iter(|| likelihood.mean(black_box(prediction), target, &beta, None));
        });
        group.bench_function(BenchmarkId::new("mean_backward", n), |b| {
            b.iter(|| {
                let bars = (black_box(&mut colour_bar), black_box(&mut beta_bar));
                likelihood.mean_backward(black_box(prediction), target, &beta, None, 1.0, bars.0, bars.1)
            });
        });
    }
    group.finish();
}

fn bench_static_mask(c: &mut Criterion) {
    let mut group = c.benchmark_group("losses/static_mask");
    group.sample_size(10);
    for side in [32, 400] {
        let extent = Extent { width: side, height: side };
        let r = numbers(side * side, 4);
        let h_sfm: Vec<u8> = (0..r.len()).map(|i| u8::from(i % 13 == 0)).collect();
        // Squares of 20 pixels, every fifth of them unassigned.
        let label = |i: usize| ((i / side / 20) * 40 + i % side / 20) as u16;
        let labels: Vec<u16> = (0..r.len()).map(|i| if label(i) % 5 == 0 { 0 } else { label(i) }).collect();
        let (mut scratch, mut out) = (Scratch::default(), vec![0; r.len()]);
        group.throughput(Throughput::Elements(r.len() as u64));
        group.bench_function(BenchmarkId::new("labels", side), |b| {
            b.iter(|| {
                let segments = Segments::Labels(&labels);
                StaticMask::default().run(extent, &h_sfm, black_box(&r), segments, &mut scratch, black_box(&mut out))
            });
        });
    }
    group.finish();
}

fn quick() -> Criterion {
    Criterion::default().warm_up_time(Duration::from_millis(200)).measurement_time(Duration::from_millis(600))
}

criterion_group! {
    name = benches;
    config = quick();
    targets = bench_kernels, bench_trimmed, bench_likelihood, bench_static_mask
}
criterion_main!(benches);
