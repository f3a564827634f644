//! Compositing, marching and sampling.

use core::ops::ControlFlow;
use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use float_core::Simd;
use render_core::importance::Sampler;
use render_core::occupancy::{GridSettings, OccupancyGrid, RaySpan, StepRule};
use render_core::quadrature::{
    Composite, CompositeBar, CompositeGrads, LastInterval, Samples, Values, Weights, composite, composite_backward,
};
use render_core::sample::{DepthCue, Spacing, depth_cued, invert_cdf, stratified_bins};
use std::hint::black_box;

/// Everything that one batch needs, forward and backward.
struct Batch {
    offsets: Vec<u32>,
    tau: Vec<f32>,
    rgb: Vec<f32>,
    background: Vec<f32>,
    colour: Vec<f32>,
    opacity: Vec<f32>,
    w: Vec<f32>,
    trans_end: Vec<f32>,
    tau_bar: Vec<f32>,
    rgb_bar: Vec<f32>,
}

impl Batch {
    fn new(lengths: &[u32]) -> Self {
        let rays = lengths.len();
        let mut offsets = vec![0_u32];
        for (r, length) in lengths.iter().enumerate() {
            offsets.push(offsets[r] + length);
        }
        let n = offsets[rays] as usize;
        Self {
            offsets,
            tau: (0..n).map(|i| (i * 7919 % 101) as f32 * 4e-4).collect(),
            rgb: (0..3 * n).map(|i| (i * 31 % 97) as f32 / 97.0).collect(),
            background: vec![1.0; 3 * rays],
            colour: vec![0.0; 3 * rays],
            opacity: vec![0.0; rays],
            w: vec![0.0; n],
            trans_end: vec![0.0; rays],
            tau_bar: vec![0.0; n],
            rgb_bar: vec![0.0; 3 * n],
        }
    }

    fn forward(&mut self, simd: Simd) {
        let samples = Samples { offsets: &self.offsets, tau: &self.tau, last: LastInterval::Finite };
        let values = Values { data: &self.rgb, stride: self.tau.len(), channels: 3 };
        let out = Composite {
            colour: &mut self.colour,
            opacity: &mut self.opacity,
            w: &mut self.w,
            trans_end: &mut self.trans_end,
        };
        composite(simd, samples, values, &self.background, out);
    }

    fn backward(&mut self, simd: Simd) {
        let samples = Samples { offsets: &self.offsets, tau: &self.tau, last: LastInterval::Finite };
        let values = Values { data: &self.rgb, stride: self.tau.len(), channels: 3 };
        // The colour itself stands in for its gradient.
        let bar = CompositeBar { colour: &self.colour, w: None, trans_end: None };
        let grads = CompositeGrads { tau: &mut self.tau_bar, values: &mut self.rgb_bar, background: None };
        let forward = Weights { w: &self.w, trans_end: &self.trans_end };
        composite_backward(simd, samples, values, &self.background, forward, bar, grads);
    }
}

fn compositing(c: &mut Criterion) {
    let cases = [
        ("4096x128", vec![128; 4096]),
        ("8192x1-47", (0..8192).map(|r| 1 + r * 29 % 47).collect()),
        ("64x1024", vec![1024; 64]),
        ("4096x0", vec![0; 4096]),
    ];
    for simd in Simd::available() {
        let mut group = c.benchmark_group(format!("render-core/composite/{:?}", simd.level()));
        for (name, lengths) in &cases {
            let mut batch = Batch::new(lengths);
            group.throughput(Throughput::Elements(batch.tau.len().max(1) as u64));
            group.bench_function(format!("forward/{name}"), |b| b.iter(|| black_box(&mut batch).forward(simd)));
            group.bench_function(format!("backward/{name}"), |b| b.iter(|| black_box(&mut batch).backward(simd)));
        }
        group.finish();
    }
}

/// A shell of occupied cells, as a trained object leaves them.
fn shell(cascades: u32) -> OccupancyGrid {
    let mut grid = OccupancyGrid::new(GridSettings::default().with_cascades(cascades)).expect("settings");
    let cells: Vec<u32> = (0..grid.cells() as u32).collect();
    let thickness: Vec<f32> = cells
        .iter()
        .map(|&c| {
            let p = grid.cell_point(c, [0.5; 3]);
            let r = (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt();
            if (0.55..0.6).contains(&r) { 1.0 } else { 0.0 }
        })
        .collect();
    grid.update(&cells, &thickness);
    grid
}

fn rays(n: usize) -> Vec<RaySpan> {
    (0..n)
        .map(|i| {
            let (x, y) = ((i * 37 % 101) as f32 / 101.0 - 0.5, (i * 53 % 97) as f32 / 97.0 - 0.5);
            let d = [x * 0.7, y * 0.7, 1.0];
            let length = (d[0] * d[0] + d[1] * d[1] + 1.0).sqrt();
            RaySpan { o: [0.2, -0.1, -2.5], d: d.map(|x| x / length), t_min: 0.0, t_max: 10.0 }
        })
        .collect()
}

fn marching(c: &mut Criterion) {
    let mut group = c.benchmark_group("render-core/march");
    let rays = rays(1000);
    let dt = 2.0 * 3.0_f32.sqrt() / 1024.0;
    let cases = [
        ("shell", shell(1), StepRule::uniform(dt)),
        ("full", OccupancyGrid::new(GridSettings::default()).expect("settings"), StepRule::uniform(dt)),
        ("shell-cone", shell(4), StepRule { dt_min: dt, cone: 1.0 / 256.0, dt_max: 64.0 * dt }),
    ];
    for (name, grid, rule) in &cases {
        let march = || {
            let (mut sum, mut tests) = (0.0, 0);
            for ray in &rays {
                let visit = |t: f32, dt: f32| {
                    sum += t * dt;
                    ControlFlow::Continue(())
                };
                tests += grid.march(ray, rule, 0.5, 1024, visit).lookups;
            }
            (sum, tests)
        };
        group.throughput(Throughput::Elements(u64::from(march().1)));
        group.bench_function(format!("{name}/1000 rays, per test"), |b| b.iter(march));
    }
    group.finish();
}

fn occupancy(c: &mut Criterion) {
    let mut group = c.benchmark_group("render-core/occupancy");
    group.sample_size(20);
    let grid = shell(1);
    let mut cells = vec![];
    group.bench_function("pick/128^3", |b| b.iter(|| grid.pick(|i| (i % 1009) as f32 / 1009.0, &mut cells)));
    let thickness = vec![0.02; cells.len()];
    group.bench_function("update/half of 128^3", |b| {
        b.iter_batched_ref(|| grid.clone(), |grid| grid.update(&cells, &thickness), BatchSize::LargeInput)
    });
    group.finish();
}

fn sampling(c: &mut Criterion) {
    let mut group = c.benchmark_group("render-core/sample");
    let u: Vec<f32> = (0..128).map(|i| (i * 61 % 128) as f32 / 128.0).collect();
    let (mut t, mut cdf) = (vec![0.0; 128], vec![0.0; 64]);
    group.throughput(Throughput::Elements(128));
    group.bench_function("stratified_bins/128", |b| b.iter(|| stratified_bins(2.0, 6.0, Spacing::Linear, &u, &mut t)));
    let edges: Vec<f32> = (0..64).map(|i| 2.0 + i as f32 / 16.0).collect();
    let weights: Vec<f32> = (0..63).map(|i| (i * 17 % 29) as f32 / 29.0).collect();
    group.bench_function("invert_cdf/63 bins, 128", |b| {
        b.iter(|| invert_cdf(&edges, &weights, 1e-5, &u, &mut cdf, &mut t))
    });
    let cue = DepthCue::for_range(2.0, 6.0);
    group.bench_function("depth_cued/128", |b| b.iter(|| depth_cued(2.0, 6.0, 3.7, cue, black_box(&u), &mut t)));
    // Pixels of a surgical video's frame with a tool over a corner.
    let n = 640 * 512;
    let boost = vec![1.01; n];
    let mask: Vec<u8> = (0..n).map(|i| u8::from(i % 640 > 200 || i / 640 > 300)).collect();
    if let Ok(sampler) = Sampler::of_frame(&boost, &mask) {
        group.bench_function("pixels/640x512, 128", |b| {
            b.iter(|| u.iter().filter_map(|&u| sampler.draw_pixel(u.into(), &boost, &mask)).sum::<usize>());
        });
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(20).warm_up_time(std::time::Duration::from_millis(100))
        .measurement_time(std::time::Duration::from_millis(400));
    targets = compositing, marching, occupancy, sampling
}
criterion_main!(benches);
