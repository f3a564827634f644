//! Hash grid, forward and backward, samples along rays as a marcher makes them. With the feature `rayon` on 1 and 2
//! threads, else on one.

use std::hint::black_box;
use std::time::Duration;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use field_core::encoding::hash_grid::{HashGrid, HashGridConfig, Touched};
use field_core::rng::Rng;
use float_core::Simd;

const SAMPLES: usize = 1 << 16;
const SAMPLES_PER_RAY: usize = 32;

/// Samples in order along random chords of the cube.
fn samples() -> Vec<f32> {
    let rng = Rng::new(1, 0);
    let mut x = vec![0.0; 3 * SAMPLES];
    for ray in 0..SAMPLES / SAMPLES_PER_RAY {
        let (from, to) = (rng.uniform4_at(2 * ray as u64), rng.uniform4_at(2 * ray as u64 + 1));
        for i in 0..SAMPLES_PER_RAY {
            // Surfaces are thin: samples crowd on a tenth of the chord.
            let t = from[3] * 0.9 + 0.1 * i as f32 / SAMPLES_PER_RAY as f32;
            for a in 0..3 {
                x[a * SAMPLES + ray * SAMPLES_PER_RAY + i] = from[a] + t * (to[a] - from[a]);
            }
        }
    }
    x
}

fn hash_grid(c: &mut Criterion) {
    let simd = Simd::best();
    let x = samples();
    let mut group = c.benchmark_group("field-core/hash_grid");
    group.sample_size(10).warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(1));
    group.throughput(Throughput::Elements(SAMPLES as u64));
    for (levels, features, log2_table) in [(16, 2, 19), (8, 4, 17)] {
        let grid = HashGrid::new(
            HashGridConfig::default().with_levels(levels).with_features(features).with_log2_table(log2_table),
        )
        .unwrap();
        let mut params = vec![0.0; grid.params_len()];
        Rng::new(2, 0).fill_uniform(0, &mut params);
        let mut out = vec![0.0; grid.out_rows() * SAMPLES];
        let mut grad = vec![0.0; grid.params_len()];
        let mut x_bar = vec![0.0; x.len()];
        let mut touched = Touched::new(&grid);
        for threads in if cfg!(feature = "rayon") { 1..=2 } else { 1..=1 } {
            let name = format!("{levels}x{features}/T{log2_table}/threads{threads}");
            let pool = Pool::new(threads);
            group.bench_function(BenchmarkId::new("forward", &name), |b| {
                b.iter(|| pool.run(|| grid.encode(simd, &params, black_box(&x), black_box(&mut out)).unwrap()));
            });
            group.bench_function(BenchmarkId::new("backward", &name), |b| {
                b.iter(|| pool.run(|| grid.encode_backward(simd, black_box(&x), &out, &mut grad, None).unwrap()));
            });
            group.bench_function(BenchmarkId::new("backward_touched", &name), |b| {
                b.iter(|| pool.run(|| grid.encode_backward(simd, &x, &out, &mut grad, Some(&mut touched)).unwrap()));
            });
            group.bench_function(BenchmarkId::new("backward_x", &name), |b| {
                b.iter(|| pool.run(|| grid.encode_backward_x(simd, &params, &x, &out, &mut x_bar).unwrap()));
            });
        }
    }
    group.finish();
}

/// So many threads.
#[cfg(feature = "rayon")]
struct Pool(rayon::ThreadPool);
#[cfg(feature = "rayon")]
impl Pool {
    fn new(threads: usize) -> Self {
        Self(rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap())
    }
    fn run(&self, f: impl FnOnce() + Send) {
        self.0.install(f);
    }
}
#[cfg(not(feature = "rayon"))]
struct Pool;
#[cfg(not(feature = "rayon"))]
impl Pool {
    fn new(_: usize) -> Self {
        Self
    }
    fn run(&self, f: impl FnOnce()) {
        f();
    }
}

criterion_group!(benches, hash_grid);
criterion_main!(benches);
