//! Rigid motions of points: the plain pair, and the tape with its Jacobian.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use field_core::deform::{RigidBars, rigid, rigid_points, rigid_points_backward};
use field_core::rng::Rng;
use field_core::tape::{Arena, Tape, TapeError};
use float_core::Simd;
use std::hint::black_box;

fn numbers(len: usize, stream: u64, scale: f32) -> Vec<f32> {
    let mut x = vec![0.0; len];
    Rng::new(1, stream).fill_normal(0, &mut x);
    x.iter_mut().for_each(|x| *x *= scale);
    x
}

fn motions(c: &mut Criterion) {
    let mut group = c.benchmark_group("field-core/rigid");
    let n = 1024;
    let (x, v, out_bar) = (numbers(3 * n, 1, 1.0), numbers(3 * n, 2, 0.1), numbers(3 * n, 3, 1.0));
    // Angles in the reach of the series, and past it.
    for (name, angle) in [("small", 0.1), ("many turns", 10.0)] {
        let omega = numbers(3 * n, 4, angle);
        let simd = Simd::best();
        let mut out = vec![0.0; 3 * n];
        group.throughput(Throughput::Elements(n as u64));
        group.bench_function(BenchmarkId::new("points", name), |b| {
            b.iter(|| rigid_points(simd, black_box(&x), &omega, &v, &mut out));
        });
        let mut bars = [vec![0.0; 3 * n], vec![0.0; 3 * n], vec![0.0; 3 * n]];
        group.bench_function(BenchmarkId::new("points backward", name), |b| {
            let [x_bar, w_bar, v_bar] = &mut bars;
            b.iter(|| {
                let bars = RigidBars { x: x_bar, omega: w_bar, v: v_bar };
                rigid_points_backward(simd, black_box(&x), &omega, &v, &out_bar, bars)
            });
        });
        let mut arena = Arena::new();
        group.bench_function(BenchmarkId::new("tape and Jacobian, backward", name), |b| {
            b.iter(|| -> Result<(), TapeError> {
                let mut tape = Tape::new(&mut arena, &[]);
                let [x, omega, v] = [tape.input(3, n, &x)?, tape.input(3, n, &omega)?, tape.input(3, n, &v)?];
                let out = rigid(&mut tape, x, omega, v)?;
                let j = tape.jacobian(out, x)?;
                let length = tape.dot(j, j)?;
                let loss = tape.mean_samples(length)?;
                tape.backward_from(loss, &mut [])
            });
        });
    }
    group.finish();
}

criterion_group!(benches, motions);
criterion_main!(benches);
