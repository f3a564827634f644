//! Rays and projections a second, and contraction of sample batches.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use float_core::Simd;
use glam::{DVec2, DVec3};
use render_core::camera::{Camera, Lens, Pose, RayTable};
use render_core::contract::{Norm, contract_batch, contract_batch_backward};
use std::hint::black_box;

const LENSES: [(&str, Lens); 5] = [
    ("pinhole", Lens::PINHOLE),
    ("opencv", Lens::Perspective { k: [-0.1, 0.02, 0.0, 0.0, 0.0, 0.0], p: [1e-3, -5e-4] }),
    ("full_opencv", Lens::Perspective { k: [0.9, 0.3, 0.01, 1.2, 0.5, 0.03], p: [1e-3, -5e-4] }),
    ("fisheye", Lens::Fisheye { k: [0.02, -0.006, 0.002, -3e-4] }),
    ("fov", Lens::Fov { omega: 0.95 }),
];

fn camera(lens: Lens) -> Camera {
    Camera { lens, ..Camera::pinhole(64, 64, 60.0, 60.0, 32.0, 32.0, Pose::IDENTITY) }
}

fn rays(c: &mut Criterion) {
    let mut group = c.benchmark_group("render-core/ray/4096");
    group.throughput(Throughput::Elements(64 * 64));
    for (name, lens) in LENSES {
        let camera = camera(lens).prepare();
        let run = || {
            let mut sum = DVec3::ZERO;
            for j in 0..64 {
                for i in 0..64 {
                    let pixel = DVec2::new(f64::from(i) + 0.5, f64::from(j) + 0.5);
                    sum += black_box(&camera).ray(black_box(pixel)).map_or(DVec3::ZERO, |ray| ray.d);
                }
            }
            sum
        };
        group.bench_function(name, |b| b.iter(run));
    }
    let table = RayTable::new(&camera(LENSES[1].1));
    group.bench_function("table", |b| {
        b.iter(|| {
            let mut sum = DVec3::ZERO;
            for j in 0..64 {
                for i in 0..64 {
                    sum += black_box(&table).ray(&Pose::IDENTITY, i, j).map_or(DVec3::ZERO, |ray| ray.d);
                }
            }
            sum
        });
    });
    group.finish();
}

fn project(c: &mut Criterion) {
    let mut group = c.benchmark_group("render-core/project/4096");
    group.throughput(Throughput::Elements(4096));
    let points: Vec<DVec3> =
        (0..4096).map(|i| DVec3::new(f64::from(i % 64) / 64.0 - 0.5, f64::from(i / 64) / 64.0 - 0.5, 1.0)).collect();
    for (name, lens) in LENSES {
        let camera = camera(lens).prepare();
        group.bench_function(name, |b| {
            b.iter(|| black_box(&points).iter().filter_map(|&x| black_box(&camera).project(x)).sum::<DVec2>());
        });
    }
    group.finish();
}

fn prepare(c: &mut Criterion) {
    let mut group = c.benchmark_group("render-core/prepare/1");
    for (name, lens) in LENSES {
        let camera = camera(lens);
        group.bench_function(name, |b| b.iter(|| black_box(&camera).prepare()));
    }
    group.finish();
}

fn contraction(c: &mut Criterion) {
    for n in [64, 65_536] {
        let mut group = c.benchmark_group(format!("render-core/contract/{n}"));
        group.throughput(Throughput::Elements(n as u64));
        let x: Vec<f32> = (0..3 * n).map(|i| ((i * 7919) % 1000) as f32 / 100.0 - 5.0).collect();
        let (mut y, mut x_bar) = (vec![0.0; 3 * n], vec![0.0; 3 * n]);
        for norm in [Norm::L2, Norm::Max] {
            for simd in [Simd::SCALAR, Simd::best()] {
                let id = |what: &str| BenchmarkId::new(format!("{norm:?} {what}"), format!("{:?}", simd.level()));
                group.bench_function(id("forward"), |b| {
                    b.iter(|| contract_batch(simd, norm, black_box(&x), black_box(&mut y)));
                });
                group.bench_function(id("backward"), |b| {
                    b.iter(|| contract_batch_backward(simd, norm, black_box(&x), black_box(&x), black_box(&mut x_bar)));
                });
            }
        }
        group.finish();
    }
}

criterion_group!(benches, rays, project, prepare, contraction);
criterion_main!(benches);
