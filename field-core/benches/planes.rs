//! Multi-distance interpolation at the two sizes of its method, and planes; samples along rays as a marcher makes them.

use std::hint::black_box;
use std::time::Duration;

use criterion::{
    BenchmarkGroup, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main, measurement::WallTime,
};
use field_core::encoding::EncodingBars;
use field_core::encoding::multi_distance::{MultiDistance, STRIDES};
use field_core::encoding::planes::{Combine, Planes};
use field_core::rng::Rng;
use float_core::Simd;

const SAMPLES: usize = 1 << 15;
const SAMPLES_PER_RAY: usize = 32;

/// Samples in order along random chords of the unit cube, crowded on a tenth of each; the fourth row is one number a ray.
fn samples() -> Vec<f32> {
    let rng = Rng::new(1, 0);
    let mut x = vec![0.0; 4 * SAMPLES];
    for ray in 0..SAMPLES / SAMPLES_PER_RAY {
        let (from, to) = (rng.uniform4_at(2 * ray as u64), rng.uniform4_at(2 * ray as u64 + 1));
        for i in 0..SAMPLES_PER_RAY {
            let t = from[3] * 0.9 + 0.1 * i as f32 / SAMPLES_PER_RAY as f32;
            for a in 0..3 {
                x[a * SAMPLES + ray * SAMPLES_PER_RAY + i] = from[a] + t * (to[a] - from[a]);
            }
            x[3 * SAMPLES + ray * SAMPLES_PER_RAY + i] = to[3];
        }
    }
    x
}

fn group<'c>(c: &'c mut Criterion, name: &str) -> BenchmarkGroup<'c, WallTime> {
    let mut group = c.benchmark_group(format!("field-core/{name}"));
    group.sample_size(10).warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(1));
    group.throughput(Throughput::Elements(SAMPLES as u64));
    group
}

fn multi_distance(c: &mut Criterion) {
    let (simd, x) = (Simd::best(), &samples()[..3 * SAMPLES]);
    let mut group = group(c, "multi_distance");
    for (resolution, features) in [(100, 4), (160, 6)] {
        let grid = MultiDistance::new([resolution; 3], features).unwrap();
        let mut table = vec![0.0; grid.params_len()];
        Rng::new(2, 0).fill_uniform(0, &mut table);
        let (mut out, mut bar) = (vec![0.0; grid.out_rows() * SAMPLES], vec![0.0; grid.params_len()]);
        let (mut x_bar, mut touched) = (vec![0.0; x.len()], vec![0; grid.touched_words()]);
        let name = format!("{resolution}x{features}");
        group.bench_function(BenchmarkId::new("forward", &name), |b| {
            b.iter(|| grid.encode(simd, &table, black_box(x), black_box(&mut out)).unwrap());
        });
        group.bench_function(BenchmarkId::new("backward", &name), |b| {
            b.iter(|| grid.encode_backward(simd, black_box(x), &out, &mut bar).unwrap());
        });
        let part = features * SAMPLES;
        for (s, stride) in STRIDES.into_iter().enumerate() {
            group.bench_function(BenchmarkId::new(format!("backward_touched_{stride}"), &name), |b| {
                let out = &out[s * part..][..part];
                b.iter(|| grid.encode_stride_backward_touched(simd, s, x, out, &mut bar, &mut touched).unwrap());
            });
        }
        group.bench_function(BenchmarkId::new("backward_x", &name), |b| {
            b.iter(|| grid.encode_backward_x(simd, &table, black_box(x), &out, &mut x_bar).unwrap());
        });
        let finer = MultiDistance::new([resolution * 5 / 4; 3], features).unwrap();
        group.bench_function(BenchmarkId::new("upsampled", &name), |b| {
            b.iter(|| black_box(grid.upsampled(&table, &finer)));
        });
    }
    group.finish();
}

fn planes(c: &mut Criterion) {
    // As many samples in [-1, 1].
    let x: Vec<f32> = samples().iter().map(|x| 2.0 * x - 1.0).collect();
    let simd = Simd::best();
    let mut group = group(c, "planes");
    for (name, planes) in [
        ("tri_sum", Planes::tri_plane([256; 3], 16, Combine::Sum)),
        ("k_planes", Planes::k_planes([128, 128, 128, 50], 16)),
        ("hex_plane", Planes::hex_plane([128, 128, 128, 50], 16)),
    ] {
        let planes = planes.unwrap();
        let x = &x[..planes.in_rows() * SAMPLES];
        let mut table = vec![0.0; planes.params_len()];
        Rng::new(2, 0).fill_uniform(0, &mut table);
        let (mut out, mut bar) = (vec![0.0; planes.features() * SAMPLES], vec![0.0; planes.params_len()]);
        let mut x_bar = vec![0.0; x.len()];
        group.bench_function(BenchmarkId::new("forward", name), |b| {
            b.iter(|| planes.encode(simd, &table, black_box(x), black_box(&mut out)).unwrap());
        });
        group.bench_function(BenchmarkId::new("backward", name), |b| {
            b.iter(|| {
                let bars = EncodingBars::both(&mut bar, &mut x_bar);
                planes.encode_backward(simd, &table, black_box(x), &out, bars).unwrap();
            });
        });
    }
    group.finish();
}

criterion_group!(benches, multi_distance, planes);
criterion_main!(benches);
