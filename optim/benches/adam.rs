//! Adam: dense, sparse by scanning, sparse by marks. 4 096 parameters (a tiny MLP) and 12.6 million (a hash table of 12
//! levels of 2^19 entries with two features).

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use float_core::Simd;
use optim::{Adam, AdamConfig, BLOCK, clip, touched_len};
use std::hint::black_box;

/// One block in 50 is touched.
const SPARSE: usize = 50;

fn adam(c: &mut Criterion) {
    let simd = Simd::best();
    for n in [4_096_usize, 1 << 20, 12 << 20] {
        let mut params = vec![0.1_f32; n];
        let dense = vec![0.3_f32; n];
        let mut sparse = vec![0.0_f32; n];
        sparse.chunks_mut(BLOCK).step_by(SPARSE).for_each(|block| block.fill(0.3));
        let mut state = Adam::new(n, AdamConfig::NGP);
        let mut marks = vec![0_u64; touched_len(n)];

        let mut group = c.benchmark_group("optim/adam");
        group.throughput(Throughput::Elements(n as u64)).sample_size(20);
        group.bench_with_input(BenchmarkId::new("step", n), &n, |b, _| {
            b.iter(|| state.step(simd, 1e-2, black_box(&mut params), black_box(&dense)));
        });
        group.bench_with_input(BenchmarkId::new("step_nonzero_2_percent", n), &n, |b, _| {
            b.iter(|| state.step_nonzero(simd, 1e-2, black_box(&mut params), black_box(&sparse)));
        });
        group.bench_with_input(BenchmarkId::new("step_touched_2_percent", n), &n, |b, _| {
            b.iter(|| {
                // The step takes marks and gradients: put them back, as scattering would.
                (0..n / BLOCK).step_by(SPARSE).for_each(|b| marks[b / 64] |= 1 << (b % 64));
                sparse.chunks_mut(BLOCK).step_by(SPARSE).for_each(|block| block.fill(0.3));
                state.step_touched(simd, 1e-2, black_box(&mut params), black_box(&mut sparse), &mut marks)
            });
        });
        group.bench_with_input(BenchmarkId::new("step_touched_nothing", n), &n, |b, _| {
            b.iter(|| state.step_touched(simd, 1e-2, black_box(&mut params), black_box(&mut sparse), &mut marks));
        });
        group.finish();
    }
}

fn clipping(c: &mut Criterion) {
    let simd = Simd::best();
    let n = 1 << 20;
    let mut grad = vec![1e-3_f32; n];
    let mut group = c.benchmark_group("optim/clip");
    group.throughput(Throughput::Elements(n as u64)).sample_size(20);
    group.bench_function("sanitise/1048576", |b| b.iter(|| clip::sanitise(simd, black_box(&mut grad))));
    group.bench_function("global_norm/1048576", |b| b.iter(|| clip::global_norm(simd, [black_box(&grad[..])])));
    group.finish();
}

criterion_group!(benches, adam, clipping);
criterion_main!(benches);
