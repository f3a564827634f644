//! MLP kernels: forward, and forward with backward, in samples a second.
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use field_core::mlp::{Activation, Bias, Mlp, MlpConfig, Packed};
use float_core::Simd;
use std::hint::black_box;

fn bench(c: &mut Criterion) {
    let shapes = [
        ("32-64-64-16", 32, vec![64, 64], 16, vec![]),
        ("32-64-16", 32, vec![64], 16, vec![]),
        ("63-8x256-4", 63, vec![256; 8], 4, vec![5]),
    ];
    for (name, inputs, hidden, outputs, skips) in shapes {
        let mlp = Mlp::new(&MlpConfig {
            inputs,
            hidden,
            outputs,
            bias: Bias::Zero,
            hidden_activation: Activation::Relu,
            output_activation: Activation::None,
            skips,
        })
        .expect("a valid shape");
        let mut packed = Packed::default();
        mlp.pack(&vec![0.01; mlp.param_count()], &mut packed);
        // One batch's activations stay in the L2 cache.
        let n = if mlp.macs() > 100_000 { 96 } else { 768 };
        let x = vec![0.5_f32; inputs * n];
        let (mut y, mut acts) = (vec![0.0; outputs * n], vec![0.0; mlp.activations_len(n)]);
        let (mut x_bar, mut grad) = (vec![0.0; inputs * n], vec![0.0; mlp.packed_grad_len()]);
        let mut scratch = vec![0.0; mlp.backward_scratch_len()];
        let mut group = c.benchmark_group(format!("field-core/mlp/{name}"));
        group.throughput(Throughput::Elements(n as u64)).sample_size(20);
        group.measurement_time(std::time::Duration::from_secs(1)).warm_up_time(std::time::Duration::from_millis(300));
        for simd in Simd::available() {
            group.bench_function(format!("forward/{:?}", simd.level()), |b| {
                b.iter(|| mlp.infer(simd, &packed, black_box(&x), n, n, &mut y, n, &mut acts));
            });
            group.bench_function(format!("forward+backward/{:?}", simd.level()), |b| {
                b.iter(|| {
                    mlp.forward(simd, &packed, black_box(&x), n, n, &mut y, n, &mut acts);
                    mlp.backward(simd, &packed, &acts, &y, n, n, Some((&mut x_bar, n)), &mut grad, &mut scratch);
                });
            });
        }
        group.finish();
    }
}

criterion_group!(benches, bench);
criterion_main!(benches);
