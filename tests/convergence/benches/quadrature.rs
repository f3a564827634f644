//! The rules between samples with compositing, forward and backward, 4096 rays of 128 samples; the error of each beside it.
//! The joint compositing of two parts at the same size.

use convergence::{Method, Sampler, Study};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use float_core::Simd;
use render_core::quadrature::two::{
    CompositeTwo, CompositeTwoBar, CompositeTwoGrads, Mixture, TwoSamples, TwoValues, WeightsTwo, composite_two,
    composite_two_backward,
};
use render_core::quadrature::{
    Composite, CompositeBar, CompositeGrads, IntervalsBar, LastInterval, Points, PointsBar, Rule, Samples, Values,
    Weights, composite, composite_backward, intervals, intervals_backward,
};
use render_core::sample::{invert_cdf, invert_linear};
use std::hint::black_box;
use testkit::analytic::Field;

const RAYS: usize = 4096;
const SAMPLES: usize = 128;

/// Everything that one batch needs.
struct Batch {
    offsets: Vec<u32>,
    dt: Vec<f32>,
    sigma: Vec<f32>,
    rgb: Vec<f32>,
    tau: Vec<f32>,
    values: Vec<f32>,
    colour: Vec<f32>,
    opacity: Vec<f32>,
    w: Vec<f32>,
    trans_end: Vec<f32>,
    tau_bar: Vec<f32>,
    values_bar: Vec<f32>,
    sigma_bar: Vec<f32>,
    rgb_bar: Vec<f32>,
    background: Vec<f32>,
}

impl Batch {
    fn new() -> Self {
        let n = RAYS * SAMPLES;
        Self {
            offsets: (0..=RAYS).map(|r| (r * SAMPLES) as u32).collect(),
            dt: vec![4.0 / SAMPLES as f32; n],
            sigma: (0..n).map(|i| (i * 7919 % 101) as f32 * 0.02).collect(),
            rgb: (0..3 * n).map(|i| (i * 31 % 97) as f32 / 97.0).collect(),
            tau: vec![0.0; n],
            values: vec![0.0; 3 * n],
            colour: vec![0.0; 3 * RAYS],
            opacity: vec![0.0; RAYS],
            w: vec![0.0; n],
            trans_end: vec![0.0; RAYS],
            tau_bar: vec![0.0; n],
            values_bar: vec![0.0; 3 * n],
            sigma_bar: vec![0.0; n],
            rgb_bar: vec![0.0; 3 * n],
            background: vec![1.0; 3 * RAYS],
        }
    }

    fn forward(&mut self, simd: Simd, rule: Rule) {
        let n = self.sigma.len();
        let values = Values { data: &self.rgb, stride: n, channels: 3 };
        let points = Points { offsets: &self.offsets, dt: &self.dt, sigma: &self.sigma, values };
        intervals(simd, rule, points, &mut self.tau, &mut self.values);
        let samples = Samples { offsets: &self.offsets, tau: &self.tau, last: LastInterval::Finite };
        let values = Values { data: &self.values, stride: n, channels: 3 };
        let out = Composite {
            colour: &mut self.colour,
            opacity: &mut self.opacity,
            w: &mut self.w,
            trans_end: &mut self.trans_end,
        };
        composite(simd, samples, values, &self.background, out);
    }

    fn backward(&mut self, simd: Simd, rule: Rule) {
        let n = self.sigma.len();
        let samples = Samples { offsets: &self.offsets, tau: &self.tau, last: LastInterval::Finite };
        let values = Values { data: &self.values, stride: n, channels: 3 };
        let forward = Weights { w: &self.w, trans_end: &self.trans_end };
        let bar = CompositeBar { colour: &self.colour, w: None, trans_end: None };
        let grads = CompositeGrads { tau: &mut self.tau_bar, values: &mut self.values_bar, background: None };
        composite_backward(simd, samples, values, &self.background, forward, bar, grads);
        let values = Values { data: &self.rgb, stride: n, channels: 3 };
        let points = Points { offsets: &self.offsets, dt: &self.dt, sigma: &self.sigma, values };
        let bar = IntervalsBar { tau: &self.tau_bar, values: &self.values_bar };
        let grads = PointsBar { sigma: &mut self.sigma_bar, values: &mut self.rgb_bar, dt: None };
        intervals_backward(simd, rule, points, bar, grads);
    }
}

fn rules(c: &mut Criterion) {
    let field = &Field::all()[4];
    let mut batch = Batch::new();
    for (rule, method) in Rule::ALL.into_iter().zip([Method::LeftPoint, Method::Trapezoid, Method::PiecewiseLinear]) {
        let error = Study::default().measure(field, method, Sampler::Uniform, SAMPLES).error;
        println!("{rule:?}: error {error:.1e} on `{}` with {SAMPLES} samples", field.name);
        for simd in Simd::available() {
            let mut group = c.benchmark_group(format!("render-core/{rule:?}/{:?}", simd.level()));
            group.throughput(Throughput::Elements((RAYS * SAMPLES) as u64));
            group.bench_function("forward/4096x128", |b| b.iter(|| black_box(&mut batch).forward(simd, rule)));
            group.bench_function("forward+backward/4096x128", |b| {
                b.iter(|| {
                    black_box(&mut batch).forward(simd, rule);
                    batch.backward(simd, rule);
                })
            });
            group.finish();
        }
    }
}

/// A static and a transient part.
struct Two {
    offsets: Vec<u32>,
    tau: [Vec<f32>; 2],
    rgb: [Vec<f32>; 2],
    beta: Vec<f32>,
    background: Vec<f32>,
    colour: Vec<f32>,
    rays: [Vec<f32>; 3],
    w: [Vec<f32>; 2],
    tau_bar: [Vec<f32>; 2],
    rgb_bar: [Vec<f32>; 2],
    beta_bar: Vec<f32>,
}

impl Two {
    fn new() -> Self {
        let n = RAYS * SAMPLES;
        let tau = |a: usize| (0..n).map(|i| (i * a % 101) as f32 * 0.0006).collect::<Vec<f32>>();
        let rgb = |a: usize| (0..3 * n).map(|i| (i * a % 97) as f32 / 97.0).collect::<Vec<f32>>();
        Self {
            offsets: (0..=RAYS).map(|r| (r * SAMPLES) as u32).collect(),
            tau: [tau(7919), tau(7907)],
            rgb: [rgb(31), rgb(37)],
            beta: vec![0.1; n],
            background: vec![1.0; 3 * RAYS],
            colour: vec![0.0; 3 * RAYS],
            rays: [(); 3].map(|()| vec![0.0; RAYS]),
            w: [(); 2].map(|()| vec![0.0; n]),
            tau_bar: [(); 2].map(|()| vec![0.0; n]),
            rgb_bar: [(); 2].map(|()| vec![0.0; 3 * n]),
            beta_bar: vec![0.0; n],
        }
    }

    fn run(&mut self, simd: Simd, mixture: Mixture, way_back: bool) {
        let part = |data| Values { data, stride: RAYS * SAMPLES, channels: 3 };
        let samples = TwoSamples { offsets: &self.offsets, tau_s: &self.tau[0], tau_t: &self.tau[1] };
        let values = TwoValues {
            values_s: part(&self.rgb[0]),
            values_t: part(&self.rgb[1]),
            beta: &self.beta,
            background: &self.background,
        };
        let ([beta, transient, trans_end], [w_s, w_t]) = (&mut self.rays, &mut self.w);
        let out = CompositeTwo { colour: &mut self.colour, beta, transient, trans_end, w_s, w_t };
        composite_two(simd, samples, mixture, values, out);
        if way_back {
            let bar = CompositeTwoBar {
                colour: &self.colour,
                beta: Some(&self.rays[0]),
                transient: None,
                trans_end: None,
                w_s: None,
                w_t: None,
            };
            let ([tau_s, tau_t], [values_s, values_t]) = (&mut self.tau_bar, &mut self.rgb_bar);
            let beta = &mut self.beta_bar;
            let grads = CompositeTwoGrads { tau_s, tau_t, values_s, values_t, beta, background: None };
            let forward = WeightsTwo { w_s: &self.w[0], w_t: &self.w[1], trans_end: &self.rays[2] };
            composite_two_backward(simd, samples, mixture, values, forward, bar, grads);
        }
    }
}

fn two(c: &mut Criterion) {
    let mut two = Two::new();
    for mixture in Mixture::ALL {
        for simd in Simd::available() {
            let mut group = c.benchmark_group(format!("render-core/two {mixture:?}/{:?}", simd.level()));
            group.throughput(Throughput::Elements((RAYS * SAMPLES) as u64));
            for (name, way_back) in [("forward", false), ("forward+backward", true)] {
                let name = format!("{name}/4096x128");
                group.bench_function(name, |b| b.iter(|| black_box(&mut two).run(simd, mixture, way_back)));
            }
            group.finish();
        }
    }
}

fn samplers(c: &mut Criterion) {
    let u: Vec<f32> = (0..128).map(|i| (i as f32 + 0.5) / 128.0).collect();
    let t: Vec<f32> = (0..65).map(|i| 2.0 + i as f32 / 16.0).collect();
    let sigma: Vec<f32> = (0..65).map(|i| (i * 17 % 29) as f32 / 29.0).collect();
    let (mut scratch, mut out) = (vec![0.0; 65], vec![0.0; 128]);
    let mut group = c.benchmark_group("render-core/sample");
    group.throughput(Throughput::Elements(128));
    group.bench_function("invert_linear/64 bins, 128", |b| {
        b.iter(|| invert_linear(black_box(&t), &sigma, &u, &mut scratch, &mut out))
    });
    group.bench_function("invert_cdf/64 bins, 128", |b| {
        b.iter(|| invert_cdf(black_box(&t), &sigma[..64], 0.0, &u, &mut scratch, &mut out))
    });
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10).warm_up_time(std::time::Duration::from_millis(100))
        .measurement_time(std::time::Duration::from_millis(300));
    targets = rules, two, samplers
}
criterion_main!(benches);
