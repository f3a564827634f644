//! Values a second of every function of `vecmath`, level by level, beside the door's exact version. Each level's name carries
//! its largest error in units in the last place: `cargo run --release -p wildfield-float-core --example vecmath_table` measures both.
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use float_core::Simd;
use float_core::vecmath::Function;
use std::hint::black_box;
use std::time::Duration;

fn bench(c: &mut Criterion) {
    // Both slices stay in the L1 cache.
    let n = 2048;
    let x: Vec<f32> = (0..n).map(|i| 16.0 * (i * 769 % n) as f32 / n as f32 - 8.0).collect();
    let mut y = vec![0.0; n];
    for function in Function::ALL {
        let mut group = c.benchmark_group(format!("float-core/vecmath/{}", function.name()));
        group.throughput(Throughput::Elements(n as u64)).sample_size(20);
        group.measurement_time(Duration::from_millis(500)).warm_up_time(Duration::from_millis(200));
        group.bench_function(BenchmarkId::new("door", n), |b| {
            b.iter(|| black_box(&x).iter().zip(y.iter_mut()).for_each(|(x, y)| *y = function.plain(*x)));
        });
        for simd in Simd::available() {
            let name = format!("{:?} (error at most {} ulp)", simd.level(), function.bound(simd.level()));
            group.bench_function(BenchmarkId::new(name, n), |b| {
                b.iter(|| function.map(simd, black_box(&x), black_box(&mut y)));
            });
        }
        group.finish();
    }
}

criterion_group!(benches, bench);
criterion_main!(benches);
