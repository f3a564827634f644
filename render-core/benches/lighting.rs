//! Irradiance and shading a surface, forward and with the way back; environment maps; rotation; fitting.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use render_core::lighting::{Kind, Lighting, Tone, fit_irradiance, project_equirect, shade, shade_backward};
use std::hint::black_box;

fn normals(n: usize) -> Vec<[f64; 3]> {
    let normal = |i: usize| {
        let z = 1.0 - (2 * i + 1) as f64 / n as f64;
        let (s, c) = (2.4 * i as f64).sin_cos();
        let r = (1.0 - z * z).sqrt();
        [r * c, r * s, z]
    };
    (0..n).map(normal).collect()
}

fn lighting(c: &mut Criterion) {
    const N: usize = 4096;
    let sky = Lighting::<f32>::mild_sky();
    let n: Vec<[f32; 3]> = normals(N).iter().map(|n| n.map(|x| x as f32)).collect();
    let mut group = c.benchmark_group("render-core/lighting");
    group.throughput(Throughput::Elements(N as u64));
    let mut colours = vec![[0.0; 3]; N];
    group.bench_function("shade/4096", |b| {
        b.iter(|| {
            for (out, &n) in colours.iter_mut().zip(black_box(&n)) {
                *out = shade(Tone::Gamma, [0.5; 3], 1.0, sky.irradiance(n));
            }
        });
    });
    let mut n_bars = vec![[0.0; 3]; N];
    group.bench_function("shade+backward/4096", |b| {
        b.iter(|| {
            let mut l_bar = [[0.0; 3]; 9];
            for (n_bar, &n) in n_bars.iter_mut().zip(black_box(&n)) {
                let e = sky.irradiance(n);
                let colour = shade(Tone::Gamma, [0.5; 3], 1.0, e);
                let (mut a_bar, mut s_bar, mut e_bar) = ([0.0; 3], 0.0, [0.0; 3]);
                shade_backward(Tone::Gamma, [0.5; 3], 1.0, e, colour, &mut a_bar, &mut s_bar, &mut e_bar);
                sky.irradiance_backward(n, e_bar, &mut l_bar, n_bar);
            }
            l_bar
        });
    });
    let wide = normals(N);
    let truth = Lighting::<f64>::mild_sky();
    let samples: Vec<[f64; 3]> = wide.iter().map(|&n| truth.irradiance(n)).collect();
    group.bench_function("fit/4096", |b| b.iter(|| fit_irradiance(black_box(&wide), &samples, 0.0)));
    let (width, height) = (512, 256);
    let map: Vec<f32> = (0..3 * width * height).map(|i| (i * 31 % 97) as f32 / 97.0).collect();
    group.throughput(Throughput::Elements((width * height) as u64));
    group.bench_function("project/512x256", |b| b.iter(|| project_equirect(black_box(&map), width, height)));
    group.throughput(Throughput::Elements(1));
    let r = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
    group.bench_function("rotate", |b| b.iter(|| black_box(&sky).to_kind(Kind::Irradiance).rotated(black_box(&r))));
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10).warm_up_time(std::time::Duration::from_millis(100))
        .measurement_time(std::time::Duration::from_millis(300));
    targets = lighting
}
criterion_main!(benches);
