//! The tape against the sums of its parts: time of a whole step for a small network, and of single operations.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use field_core::mlp::{Mlp, MlpConfig, Packed};
use field_core::rng::Rng;
use field_core::tape::{Arena, MlpOp, Tape, TapeError, layers};
use float_core::Simd;
use std::hint::black_box;

fn numbers(len: usize, stream: u64) -> Vec<f32> {
    let mut x = vec![0.0; len];
    Rng::new(1, stream).fill_normal(0, &mut x);
    x.iter_mut().for_each(|x| *x *= 0.2);
    x
}

fn network(inputs: usize, hidden: &[usize], outputs: usize) -> Mlp {
    let config = MlpConfig::new(inputs, hidden.to_vec(), outputs);
    Mlp::new(&config).unwrap_or_else(|e| panic!("{e}"))
}

/// Forward and backward of a network, fused and layer by layer.
fn step(c: &mut Criterion) {
    let mut group = c.benchmark_group("field-core/tape-step");
    for (name, mlp) in [("32-64-64-16", network(32, &[64, 64], 16)), ("63-256-256-4", network(63, &[256, 256], 4))] {
        let params = numbers(mlp.param_count(), 0);
        let mut packed = Packed::default();
        mlp.pack(&params, &mut packed);
        for n in [16, 128, 1024] {
            let x = numbers(mlp.inputs() * n, 1);
            let seed = numbers(mlp.outputs() * n, 2);
            let mut grad = vec![0.0; params.len()];
            let mut arena = Arena::new();
            group.throughput(Throughput::Elements(n as u64));
            let op = MlpOp { mlp: &mlp, packed: &packed, simd: Simd::best() };
            let mut run = |fused: bool| -> Result<(), TapeError> {
                let mut tape = Tape::new(&mut arena, &params);
                let input = tape.input(mlp.inputs(), n, black_box(&x))?;
                let weights = tape.param(0, params.len(), 1)?;
                let y =
                    if fused { tape.custom(&op, &[input, weights])? } else { layers(&mut tape, &mlp, input, weights)? };
                tape.backward(&[(y, &seed)], &mut grad)
            };
            for (kind, fused) in [("fused", true), ("layers", false)] {
                group.bench_function(BenchmarkId::new(format!("{name}/{kind}"), n), |b| b.iter(|| run(fused)));
            }
        }
    }
    group.finish();
}

/// Gradient of a loss on the density's gradient in space.
fn second_order(c: &mut Criterion) {
    let mut group = c.benchmark_group("field-core/tape-second-order");
    let mlp = network(3, &[64, 64], 1);
    let params = numbers(mlp.param_count(), 0);
    for n in [16, 128, 1024] {
        let x = numbers(3 * n, 1);
        let mut grad = vec![0.0; params.len()];
        let mut arena = Arena::new();
        group.throughput(Throughput::Elements(n as u64));
        group.bench_function(BenchmarkId::new("3-64-64-1", n), |b| {
            b.iter(|| -> Result<(), TapeError> {
                let mut tape = Tape::new(&mut arena, &params);
                let input = tape.input(3, n, black_box(&x))?;
                let weights = tape.param(0, params.len(), 1)?;
                let sigma = layers(&mut tape, &mlp, input, weights)?;
                let slope = tape.jacobian(sigma, input)?;
                let loss = tape.dot(slope, slope)?;
                let loss = tape.mean_samples(loss)?;
                tape.backward_from(loss, &mut grad)
            });
        });
    }
    group.finish();
}

/// One node, forward and backward, down to the empty tile: what recording costs.
fn single(c: &mut Criterion) {
    let mut group = c.benchmark_group("field-core/tape-softplus");
    for n in [0, 16, 1024, 65536] {
        let (x, seed) = (numbers(n, 1), vec![1.0; n]);
        let mut arena = Arena::new();
        group.throughput(Throughput::Elements(n as u64));
        group.bench_function(BenchmarkId::from_parameter(n), |b| {
            b.iter(|| -> Result<(), TapeError> {
                let mut tape = Tape::new(&mut arena, &[]);
                let input = tape.input(1, n, black_box(&x))?;
                let y = tape.softplus(input, 0.0)?;
                tape.backward(&[(y, &seed)], &mut [])
            });
        });
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10).warm_up_time(std::time::Duration::from_millis(200))
        .measurement_time(std::time::Duration::from_millis(500));
    targets = step, second_order, single
}
criterion_main!(benches);
