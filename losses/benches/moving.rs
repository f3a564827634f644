//! Losses of things that move: the elastic energy of many Jacobians, total variation of a plane and of voxels.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use losses::elastic::{SCALE, elastic, elastic_backward};
use losses::kernel::Kernel;
use losses::variation::{total_variation, total_variation_backward};
use std::hint::black_box;

/// Spread over `[-1, 1)`, the same in every run.
fn numbers(len: usize) -> Vec<f32> {
    (0..len).map(|i| (i * 7919 % 10007) as f32 / 5003.5 - 1.0).collect()
}

/// Jacobians at a distance of about `off` from the identity.
fn energy(c: &mut Criterion) {
    let mut group = c.benchmark_group("losses/elastic");
    let n = 4096;
    let w = vec![1e-3; n];
    for off in [1e-4_f32, 0.1, 1.0] {
        let mut j: Vec<f32> = numbers(9 * n).iter().map(|x| off * x).collect();
        for diagonal in [0, 4, 8] {
            j[diagonal * n..(diagonal + 1) * n].iter_mut().for_each(|x| *x += 1.0);
        }
        let mut bar = vec![0.0; 9 * n];
        group.throughput(Throughput::Elements(n as u64));
        group.bench_function(BenchmarkId::new("forward", off), |b| b.iter(|| elastic(black_box(&j), &w, SCALE)));
        group.bench_function(BenchmarkId::new("backward", off), |b| {
            b.iter(|| elastic_backward(black_box(&j), &w, SCALE, 1.0, &mut bar));
        });
    }
    group.finish();
}

fn variation(c: &mut Criterion) {
    let mut group = c.benchmark_group("losses/lattice");
    let kernel = Kernel::Huber { delta: 1.0 };
    for (name, dims, axes) in
        [("plane 128x128x16", vec![128, 128, 16], vec![0, 1]), ("voxels 32^3x6", vec![32, 32, 32, 6], vec![0, 1, 2])]
    {
        let x = numbers(dims.iter().product());
        let mut bar = vec![0.0; x.len()];
        group.throughput(Throughput::Elements(x.len() as u64));
        group.bench_function(BenchmarkId::new("forward", name), |b| {
            b.iter(|| total_variation(black_box(&x), &dims, &axes, kernel));
        });
        group.bench_function(BenchmarkId::new("backward", name), |b| {
            b.iter(|| total_variation_backward(black_box(&x), &dims, &axes, kernel, 1.0, &mut bar));
        });
    }
    group.finish();
}

criterion_group!(benches, energy, variation);
criterion_main!(benches);
