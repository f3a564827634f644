//! Projection and rasteriser, forwards and backwards, of clouds as trainings start with: as large as the way to the nearest
//! neighbours, a tenth opaque; and all levels of SIMD against each other.
//!
//! A few hundred Gaussians and a small picture under `--test`.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use float_core::Simd;
use float_core::rng::Rng;
use splat_core::{Gaussians, ProjectedGradient, Projection, Raster, RasterSettings, View};
use std::hint::black_box;

/// Degree of the spherical harmonics: all coefficients, as at the end of a training.
const DEGREE: usize = 3;

/// `n` at random in a box of 4 x 4 x 4 in front of the camera, as large as the way to the nearest three of so many is on average:
/// `0.7 n^(-1/3)` of the box's side.
fn cloud(n: usize) -> Gaussians {
    let mut g = Gaussians::new(n, DEGREE).expect("a degree");
    let (side, rng) = (4.0, Rng::new(1, 0));
    let spacing = 0.7 * side / (n as f32).cbrt();
    for k in 0..3 {
        for i in 0..n {
            let u = rng.uniform_at((3 * i + k) as u64);
            g.mean[k * n + i] = side * (u - 0.5) + if k == 2 { 4.5 } else { 0.0 };
            // Round at the start; a little training already makes a difference.
            g.log_scale[k * n + i] = spacing.ln() + 0.4 * rng.substream(1).normal_at((3 * i + k) as u64);
        }
    }
    rng.substream(2).fill_normal(0, &mut g.wxyz);
    rng.substream(3).fill_normal(0, &mut g.dc);
    rng.substream(4).fill_normal(0, &mut g.rest);
    g.rest.iter_mut().for_each(|x| *x *= 0.1);
    g.logit.fill(f32::ln(0.1 / 0.9));
    g
}

fn view(size: [usize; 2]) -> View {
    let r = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let f = size[1] as f32;
    View { r, t: [0.0; 3], f: [f; 2], c: size.map(|n| n as f32 / 2.0), size }
}

/// All that one step of a training goes through, but for the loss and the optimiser.
struct Step {
    cloud: Gaussians,
    view: View,
    projection: Projection,
    raster: Raster<3>,
    planes: Vec<f32>,
    bar: Vec<f32>,
    gradients: Vec<ProjectedGradient<3>>,
    grad: Gaussians,
}

const SETTINGS: RasterSettings = RasterSettings::DEFAULT;

impl Step {
    fn new(simd: Simd, n: usize, size: [usize; 2]) -> Self {
        let (cloud, pixels) = (cloud(n), size[0] * size[1]);
        let mut bar = vec![0.0; 4 * pixels];
        Rng::new(2, 0).fill_normal(0, &mut bar);
        let mut step = Self {
            grad: cloud.clone(),
            cloud,
            view: view(size),
            projection: Projection::default(),
            raster: Raster::default(),
            planes: vec![0.0; 4 * pixels],
            bar,
            gradients: Vec::new(),
        };
        step.project(simd);
        step.draw(simd);
        step.draw_backward(simd);
        step
    }

    fn project(&mut self, simd: Simd) {
        self.projection.project(simd, &self.cloud, &self.view, &SETTINGS, DEGREE).expect("a sound cloud");
    }

    fn draw(&mut self, simd: Simd) {
        let p = &self.projection;
        self.raster.draw(simd, &p.gaussians, &p.rgb, self.view.size, &SETTINGS).expect("a picture");
        self.raster.planes(&mut self.planes).expect("as large");
    }

    fn draw_backward(&mut self, simd: Simd) {
        let p = &self.projection;
        self.raster
            .backward(simd, &p.gaussians, &p.rgb, &SETTINGS, &self.bar, &mut self.gradients)
            .expect("the same picture");
    }

    fn project_backward(&mut self, simd: Simd) {
        let (view, gradients) = (&self.view, &self.gradients);
        self.projection
            .backward(simd, &self.cloud, view, &SETTINGS, DEGREE, gradients, None, &mut self.grad)
            .expect("the same cloud");
    }
}

/// Numbers of Gaussians and pictures.
fn sizes() -> Vec<(usize, [usize; 2])> {
    if std::env::args().any(|a| a == "--test") {
        return vec![(500, [61, 47])];
    }
    [11_000, 65_000].into_iter().flat_map(|n| [(n, [540, 960]), (n, [135, 240])]).collect()
}

fn steps(c: &mut Criterion) {
    let simd = Simd::best();
    for (n, size) in sizes() {
        let mut group = c.benchmark_group(format!("splat-core/{n}/{}x{}", size[0], size[1]));
        let mut step = Step::new(simd, n, size);
        group.throughput(Throughput::Elements(n as u64));
        group.bench_function("project", |b| b.iter(|| black_box(&mut step).project(simd)));
        group.bench_function("project_backward", |b| b.iter(|| black_box(&mut step).project_backward(simd)));
        group.throughput(Throughput::Elements((size[0] * size[1]) as u64));
        group.bench_function("draw", |b| b.iter(|| black_box(&mut step).draw(simd)));
        group.bench_function("backward", |b| b.iter(|| black_box(&mut step).draw_backward(simd)));
        group.finish();
    }
}

fn levels(c: &mut Criterion) {
    let (n, size) = sizes()[sizes().len() - 1];
    let mut group = c.benchmark_group(format!("splat-core/levels/{n}/{}x{}", size[0], size[1]));
    group.throughput(Throughput::Elements(n as u64));
    for simd in Simd::available() {
        let mut step = Step::new(simd, n, size);
        let level = format!("{:?}", simd.level());
        group.bench_function(BenchmarkId::new("project", &level), |b| b.iter(|| step.project(simd)));
        group.bench_function(BenchmarkId::new("project_backward", &level), |b| b.iter(|| step.project_backward(simd)));
        group.bench_function(BenchmarkId::new("draw", &level), |b| b.iter(|| step.draw(simd)));
        group.bench_function(BenchmarkId::new("backward", &level), |b| b.iter(|| step.draw_backward(simd)));
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10).warm_up_time(std::time::Duration::from_millis(100))
        .measurement_time(std::time::Duration::from_millis(500));
    targets = steps, levels
}
criterion_main!(benches);
