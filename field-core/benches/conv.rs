//! Convolutions as matrix products against a plain loop, and the image encoder, forward and with its way back. Elements are
//! floating-point operations (two for each multiplication), so the rates are FLOP/s.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use field_core::conv::{Conv2d, Encoder, EncoderConfig, Padding, Size, Workspace};
use field_core::rng::Rng;
use float_core::Simd;
use std::hint::black_box;

fn noise(n: usize) -> Vec<f32> {
    let rng = Rng::new(5, 1);
    (0..n).map(|i| rng.uniform_at(i as u64) * 2.0 - 1.0).collect()
}

/// The same by a plain loop over an image with its border in place.
fn plain(conv: &Conv2d, kernel: usize, stride: usize, params: &[f32], x: &[f32], side: usize, y: &mut [f32]) {
    let to = (side - kernel) / stride + 1;
    let biases = &params[conv.macs()..];
    for (o, y) in y.chunks_exact_mut(to * to).enumerate() {
        y.fill(biases[o]);
        for c in 0..conv.inputs() {
            for u in 0..kernel {
                for v in 0..kernel {
                    let w = params[((o * conv.inputs() + c) * kernel + u) * kernel + v];
                    for i in 0..to {
                        let row = &x[(c * side + i * stride + u) * side + v..];
                        for (y, x) in y[i * to..][..to].iter_mut().zip(row.iter().step_by(stride)) {
                            *y += w * x;
                        }
                    }
                }
            }
        }
    }
}

fn layers(c: &mut Criterion) {
    // Layers of the small and of the published encoder for a photograph of 128 pixels.
    for (inputs, outputs, kernel, stride, side) in
        [(3, 16, 7, 1, 134), (16, 32, 4, 2, 130), (32, 32, 4, 2, 34), (3, 64, 7, 1, 134), (128, 256, 4, 2, 34)]
    {
        let conv = Conv2d::new(inputs, outputs, kernel, stride, Padding::Zero(0)).expect("a legal layer");
        let size = Size::one(side, side);
        let to = conv.output_size(size).expect("a legal size");
        let (params, x) = (noise(conv.param_count()), noise(size.len(inputs)));
        let mut y = vec![0.0; to.len(outputs)];
        let (mut params_bar, mut x_bar, mut work) = (params.clone(), x.clone(), Workspace::default());
        let name = format!("field-core/conv {inputs}x{outputs}, {kernel}x{kernel}/{stride}, side {side}");
        let mut group = c.benchmark_group(name);
        let operations = 2 * (conv.macs() * to.pixels()) as u64;
        group.throughput(Throughput::Elements(operations));
        group.bench_function("plain loop", |b| {
            b.iter(|| plain(&conv, kernel, stride, black_box(&params), &x, side, &mut y));
        });
        for simd in Simd::available() {
            group.throughput(Throughput::Elements(operations));
            group.bench_function(format!("{:?} forward", simd.level()), |b| {
                b.iter(|| conv.forward(simd, &params, black_box(&x), size, &mut y, &mut work).expect("shapes"));
            });
            group.throughput(Throughput::Elements(2 * operations));
            group.bench_function(format!("{:?} backward", simd.level()), |b| {
                b.iter(|| {
                    let x_bar = Some(&mut x_bar[..]);
                    conv.backward(simd, &params, black_box(&x), size, &y, &mut params_bar, x_bar, &mut work)
                        .expect("shapes");
                });
            });
        }
        group.finish();
    }
}

fn encoders(c: &mut Criterion) {
    let mut group = c.benchmark_group("field-core/encoder");
    for (name, config, size) in [
        ("small, 128x85", EncoderConfig::small(), Size::one(85, 128)),
        ("small, 32x32", EncoderConfig::small(), Size::one(32, 32)),
        ("published, 128x85", EncoderConfig::published(), Size::one(85, 128)),
    ] {
        let encoder = Encoder::new(config).expect("a legal encoder");
        let mut params = vec![0.0; encoder.param_count()];
        encoder.init(Rng::new(1, 1), &mut params);
        let images = noise(size.len(3));
        let mut acts = vec![0.0; encoder.activations_len(size).expect("a legal size")];
        let (mut codes, mut params_bar, mut work) = (vec![0.0; 48], params.clone(), Workspace::default());
        let simd = Simd::best();
        group.bench_function(format!("forward/{name}"), |b| {
            b.iter(|| {
                let images = black_box(&images);
                encoder.forward(simd, &params, images, size, &mut acts, &mut codes, &mut work).expect("shapes");
            });
        });
        group.bench_function(format!("forward+backward/{name}"), |b| {
            b.iter(|| {
                let images = black_box(&images);
                encoder.forward(simd, &params, images, size, &mut acts, &mut codes, &mut work).expect("shapes");
                encoder
                    .backward(simd, &params, images, size, &acts, &codes, &mut params_bar, None, &mut work)
                    .expect("shapes");
            });
        });
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10).warm_up_time(std::time::Duration::from_millis(100))
        .measurement_time(std::time::Duration::from_millis(300));
    targets = layers, encoders
}
criterion_main!(benches);
