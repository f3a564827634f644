//! L1 and D-SSIM of a picture, with and without the gradient: three channels against a truth of bytes, as splats train.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use float_core::Simd;
use losses::dssim::{Dssim, Pair, Target};
use std::{hint::black_box, time::Duration};

fn dssim(c: &mut Criterion) {
    let mut group = c.benchmark_group("losses/dssim");
    group.warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(2));
    for (height, width) in [(135, 240), (540, 960)] {
        let len = 3 * height * width;
        let y: Vec<u8> = (0..len).map(|i| (i * 7919 % 251) as u8).collect();
        let x: Vec<f32> = (0..len).map(|i| (i * 7919 % 1021) as f32 / 1020.0).collect();
        let pair = Pair { channels: 3, height, width, x: &x, target: Target::Bytes(&y), weights: None };
        let mut x_bar = vec![0.0; len];
        group.throughput(Throughput::Elements(len as u64));
        for simd in Simd::available() {
            let mut dssim = Dssim::new(simd);
            let id = |what: &str| {
                let level = format!("{:?}", simd.level()).to_lowercase();
                BenchmarkId::new(format!("{what}/{level}"), format!("{height}x{width}"))
            };
            group.bench_function(id("l1_dssim"), |b| b.iter(|| dssim.l1_dssim(black_box(&pair), 0.2)));
            group.bench_function(id("l1_dssim_backward"), |b| {
                b.iter(|| dssim.l1_dssim_backward(black_box(&pair), 0.2, 1.0, black_box(&mut x_bar)));
            });
        }
    }
    group.finish();
}

criterion_group!(benches, dssim);
criterion_main!(benches);
