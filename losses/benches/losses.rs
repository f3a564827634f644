//! Losses and metrics. Sizes: a training batch, and held-out views of the usual test scenes.

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use losses::{
    kernel::Kernel,
    metrics::{
        Image, Lpips, MaskedSsim, SsimVariant,
        lpips::{LpipsError, LpipsTensor},
        masked_ssim, ms_ssim, psnr, ssim,
    },
    photometric,
};
use std::{borrow::Cow, hint::black_box, time::Duration};

fn colours(n: usize, salt: usize) -> Vec<[f32; 3]> {
    (0..n).map(|i| [0, 1, 2].map(|c| ((i * 3 + c + salt) * 7919 % 1021) as f32 / 1020.0)).collect()
}

fn picture(side: usize, salt: usize) -> Vec<u8> {
    (0..side * side * 3).map(|i| ((i + salt) * 7919 % 251) as u8).collect()
}

fn bench_photometric(c: &mut Criterion) {
    let mut group = c.benchmark_group("losses/photometric");
    for n in [0, 256, 4096] {
        let (prediction, target) = (colours(n, 0), colours(n, 5));
        for (name, kernel) in [
            ("squared", Kernel::Squared),
            ("huber_ngp", Kernel::HuberNgp),
            ("charbonnier", Kernel::CHARBONNIER_360),
            ("log_squared", Kernel::LogSquared { eps: 1e-3 }),
        ] {
            group.bench_function(BenchmarkId::new(format!("{name}/mean"), n), |b| {
                b.iter(|| photometric::mean(kernel, black_box(&prediction), black_box(&target), None));
            });
            let mut bar = vec![[0.0; 3]; n];
            group.bench_function(BenchmarkId::new(format!("{name}/mean_backward"), n), |b| {
                b.iter(|| {
                    photometric::mean_backward(kernel, black_box(&prediction), &target, None, 1.0, black_box(&mut bar))
                });
            });
        }
    }
    group.finish();
}

fn bench_metrics(c: &mut Criterion) {
    let mut group = c.benchmark_group("losses/metrics");
    for side in [32, 400] {
        let (a, b) = (picture(side, 0), picture(side, 9));
        let [a, b] = [&a, &b].map(|x| Image::from_u8(side, side, 3, x).expect("a square image"));
        let mask: Vec<f32> = (0..side * side).map(|i| (i % 7 > 1) as u8 as f32).collect();
        group.bench_function(BenchmarkId::new("psnr", side), |bench| bench.iter(|| psnr(black_box(&a), black_box(&b))));
        group.bench_function(BenchmarkId::new("ssim", side), |bench| {
            bench.iter(|| ssim(black_box(&a), black_box(&b), SsimVariant::REFERENCE));
        });
        group.bench_function(BenchmarkId::new("masked_ssim", side), |bench| {
            bench.iter(|| masked_ssim(black_box(&a), black_box(&b), &mask, MaskedSsim::DyCheck));
        });
        if side > 160 {
            group.bench_function(BenchmarkId::new("ms_ssim", side), |bench| {
                bench.iter(|| ms_ssim(black_box(&a), black_box(&b)));
            });
        }
    }
    group.finish();
}

/// SqueezeNet's shapes with made-up values: time does not depend on them.
fn network() -> Result<Lpips, LpipsError> {
    Lpips::new(|name| {
        let (squeeze, expand, inputs) = match name.split('.').nth(1).and_then(|n| n.parse().ok()) {
            Some(3) => (16, 64, 64),
            Some(4) => (16, 64, 128),
            Some(6) => (32, 128, 128),
            Some(7) => (32, 128, 256),
            Some(9) => (48, 192, 256),
            Some(10) => (48, 192, 384),
            Some(11) => (64, 256, 384),
            Some(12) => (64, 256, 512),
            _ => (0, 0, 0),
        };
        let shape = match name {
            "scaling.shift" | "scaling.scale" => vec![3],
            "features.0.weight" => vec![64, 3, 3, 3],
            "features.0.bias" | "lin0.weight" => vec![64],
            "lin1.weight" => vec![128],
            "lin2.weight" => vec![256],
            "lin3.weight" | "lin4.weight" => vec![384],
            "lin5.weight" | "lin6.weight" => vec![512],
            _ if name.ends_with("squeeze.weight") => vec![squeeze, inputs, 1, 1],
            _ if name.ends_with("squeeze.bias") => vec![squeeze],
            _ if name.ends_with("expand1x1.weight") => vec![expand, squeeze, 1, 1],
            _ if name.ends_with("expand3x3.weight") => vec![expand, squeeze, 3, 3],
            _ => vec![expand],
        };
        let gain = 2.0 / (shape.iter().skip(1).product::<usize>() as f32).sqrt();
        let value =
            |i: usize| if name == "scaling.scale" { 0.5 } else { gain * ((i * 7919 % 251) as f32 / 125.0 - 1.0) };
        let data = (0..shape.iter().product()).map(value).collect();
        Some(LpipsTensor { shape, data: Cow::Owned(data) })
    })
}

fn bench_lpips(c: &mut Criterion) {
    let net = network().expect("the shapes fit");
    let mut group = c.benchmark_group("losses/lpips");
    group.sample_size(10).measurement_time(Duration::from_secs(3));
    for side in [32, 400] {
        let (a, b) = (picture(side, 0), picture(side, 9));
        let [a, b] = [&a, &b].map(|x| Image::from_u8(side, side, 3, x).expect("a square image"));
        for simd in float_core::Simd::available() {
            let net = net.clone().with_simd(simd);
            group.bench_function(BenchmarkId::new(format!("{:?}", simd.level()).to_lowercase(), side), |bench| {
                bench.iter(|| net.distance(black_box(&a), black_box(&b)));
            });
        }
    }
    group.finish();
}

fn quick() -> Criterion {
    Criterion::default().warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(1))
}

criterion_group! {
    name = benches;
    config = quick();
    targets = bench_photometric, bench_metrics, bench_lpips
}
criterion_main!(benches);
