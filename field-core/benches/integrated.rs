//! Integrated encoding beside the plain one: Gaussians of pixels, where the fine octaves fade, and points.

use std::hint::black_box;
use std::time::Duration;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use field_core::encoding::frequency::{Base, Frequency, Identity};
use field_core::encoding::integrated::{Integrated, Projection, icosahedron};
use field_core::rng::Rng;
use float_core::Simd;

const SAMPLES: usize = 1024;
const OCTAVES: usize = 16;

fn uniform(seed: u64, len: usize, low: f32, high: f32) -> Vec<f32> {
    (0..len).map(|i| low + (high - low) * Rng::new(seed, 0).uniform_at(i as u64)).collect()
}

fn encodings(c: &mut Criterion) {
    let simd = Simd::best();
    let mut group = c.benchmark_group("field-core/integrated");
    group.sample_size(20).warm_up_time(Duration::from_millis(200)).measurement_time(Duration::from_millis(500));
    group.throughput(Throughput::Elements(SAMPLES as u64));
    let mean = uniform(1, 3 * SAMPLES, -1.0, 1.0);
    let (plain, integrated) =
        (Frequency::new(3, OCTAVES, Base::One, Identity::Omit).unwrap(), Integrated::new(3, OCTAVES).unwrap());
    let mut out = vec![0.0; integrated.out_rows() * SAMPLES];
    let bar = uniform(2, out.len(), -1.0, 1.0);
    group.bench_function(BenchmarkId::new("plain", SAMPLES), |b| {
        b.iter(|| plain.encode(simd, black_box(&mean), None, &mut out).unwrap());
    });
    // A pixel of lego at 100 pixels a side is about 0.01 wide, at 800 a thousandth; 0 skips nothing.
    for (name, width) in [("forward_100px", 1e-2_f32), ("forward_800px", 1e-3), ("forward_point", 0.0)] {
        let var = vec![width * width; 3 * SAMPLES];
        group.bench_function(BenchmarkId::new(name, SAMPLES), |b| {
            b.iter(|| integrated.encode(simd, black_box(&mean), &var, &mut out).unwrap());
        });
    }
    let var = vec![1e-6; 3 * SAMPLES];
    let (mut mean_bar, mut var_bar) = (vec![0.0; 3 * SAMPLES], vec![0.0; 3 * SAMPLES]);
    group.bench_function(BenchmarkId::new("backward_800px", SAMPLES), |b| {
        b.iter(|| {
            let bars = (Some(&mut mean_bar[..]), Some(&mut var_bar[..]));
            integrated.encode_backward(simd, black_box(&mean), &var, &bar, bars.0, bars.1).unwrap();
        });
    });
    let projection = Projection::new(&icosahedron(2));
    let cov = uniform(3, 6 * SAMPLES, 0.0, 1e-4);
    let (mut along, mut var) = (vec![0.0; 21 * SAMPLES], vec![0.0; 21 * SAMPLES]);
    group.bench_function(BenchmarkId::new("project_21", SAMPLES), |b| {
        b.iter(|| projection.project(simd, black_box(&mean), &cov, &mut along, &mut var).unwrap());
    });
    group.finish();
}

criterion_group!(benches, encodings);
criterion_main!(benches);
