//! MLP kernels in both precisions: forward, and forward with backward, in samples a second, on one thread and on two. Before
//! each network its errors against f64 are printed: a speed without its error is not a figure.
#[path = "../tests/all/mlp_twin.rs"]
mod mlp_twin;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use field_core::mlp::{Mlp, MlpConfig, Packed, Precision};
use float_core::Simd;
use std::hint::black_box;
use std::time::{Duration, Instant};

/// A network with the buffers of one thread.
struct Bench {
    mlp: Mlp,
    packed: Packed,
    n: usize,
    x: Vec<f32>,
    y: Vec<f32>,
    acts: Vec<f32>,
    x_bar: Vec<f32>,
    grad: Vec<f32>,
    scratch: Vec<f32>,
}

impl Bench {
    fn new(mlp: &Mlp, n: usize) -> Self {
        let mut packed = Packed::default();
        mlp.pack(&mlp_twin::weights(mlp, 1), &mut packed);
        Self {
            packed,
            n,
            x: mlp_twin::noise(2, mlp.inputs() * n, 1.0),
            y: vec![0.0; mlp.outputs() * n],
            acts: vec![0.0; mlp.activations_len(n).max(mlp.infer_scratch_len())],
            x_bar: vec![0.0; mlp.inputs() * n],
            grad: vec![0.0; mlp.packed_grad_len()],
            scratch: vec![0.0; mlp.backward_scratch_len()],
            mlp: mlp.clone(),
        }
    }

    fn infer(&mut self, simd: Simd) {
        let n = self.n;
        self.mlp.infer(simd, &self.packed, black_box(&self.x), n, n, &mut self.y, n, &mut self.acts);
    }

    fn train(&mut self, simd: Simd) {
        let n = self.n;
        self.mlp.forward(simd, &self.packed, black_box(&self.x), n, n, &mut self.y, n, &mut self.acts);
        let x_bar = Some((&mut self.x_bar[..], n));
        self.mlp.backward(simd, &self.packed, &self.acts, &self.y, n, n, x_bar, &mut self.grad, &mut self.scratch);
    }
}

/// Wall time of `count` calls on each of two threads at once.
fn on_two_threads(mlp: &Mlp, n: usize, count: u64, work: impl Fn(&mut Bench) + Sync) -> Duration {
    let barrier = std::sync::Barrier::new(2);
    let each = || {
        let mut bench = Bench::new(mlp, n);
        work(&mut bench);
        barrier.wait();
        let start = Instant::now();
        (0..count).for_each(|_| work(&mut bench));
        start.elapsed()
    };
    std::thread::scope(|s| {
        let other = s.spawn(each);
        let mine = each();
        mine.max(other.join().expect("the other thread of the benchmark"))
    })
}

/// Relative Euclidean errors of outputs, input gradients and parameter gradients.
fn print_errors(name: &str, base: &Mlp) {
    let n = if base.macs() > 100_000 { 48 } else { 480 };
    let (params, x) = (mlp_twin::weights(base, 1), mlp_twin::noise(2, base.inputs() * n, 1.0));
    let y_bar = mlp_twin::noise(3, base.outputs() * n, 1.0);
    let wide = mlp_twin::wide;
    let want = mlp_twin::twin(base, &wide(&params), &wide(&x), &wide(&y_bar), n);
    for simd in Simd::available() {
        for precision in [Precision::F32, Precision::Bf16] {
            let mlp = base.clone().with_precision(precision);
            let got = mlp_twin::run(&mlp, simd, &params, &x, &y_bar, n, &[0]);
            let [y, x_bar, params_bar] = mlp_twin::distances(&got, &want);
            let level = simd.level();
            println!("{name} {level:?} {precision:?} error: y {y:.1e}, x_bar {x_bar:.1e}, params_bar {params_bar:.1e}");
        }
    }
}

fn bench(c: &mut Criterion) {
    let shapes = [
        ("32-64-64-16", 32, vec![64, 64], 16, vec![]),
        ("32-64-16", 32, vec![64], 16, vec![]),
        ("32-64-64-3", 32, vec![64, 64], 3, vec![]),
        ("63-8x256-4", 63, vec![256; 8], 4, vec![5]),
    ];
    for (name, inputs, hidden, outputs, skips) in shapes {
        let base = Mlp::new(&MlpConfig::new(inputs, hidden, outputs).with_skips(skips)).expect("a valid shape");
        print_errors(name, &base);
        // One batch's activations stay in the L2 cache.
        let n = if base.macs() > 100_000 { 96 } else { 480 };
        let mut group = c.benchmark_group(format!("field-core/mlp/{name}"));
        group.sample_size(20).measurement_time(Duration::from_secs(1)).warm_up_time(Duration::from_millis(300));
        for simd in Simd::available() {
            for precision in [Precision::F32, Precision::Bf16] {
                let mlp = base.clone().with_precision(precision);
                let mut bench = Bench::new(&mlp, n);
                let id = format!("{:?}/{precision:?}", simd.level());
                group.throughput(Throughput::Elements(n as u64));
                group.bench_function(format!("forward/{id}"), |b| b.iter(|| bench.infer(simd)));
                group.bench_function(format!("forward+backward/{id}"), |b| b.iter(|| bench.train(simd)));
                if simd == Simd::best() {
                    group.throughput(Throughput::Elements(2 * n as u64));
                    group.bench_function(format!("forward/{id}/2 threads"), |b| {
                        b.iter_custom(|count| on_two_threads(&mlp, n, count, |bench| bench.infer(simd)));
                    });
                    group.bench_function(format!("forward+backward/{id}/2 threads"), |b| {
                        b.iter_custom(|count| on_two_threads(&mlp, n, count, |bench| bench.train(simd)));
                    });
                }
            }
        }
        group.finish();
    }
}

criterion_group!(benches, bench);
criterion_main!(benches);
