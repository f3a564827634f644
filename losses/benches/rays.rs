//! Losses on the weights of rays: distortion and interlevel. Sizes are samples of a batch, 64 to a ray (of the proposal, for
//! interlevel; the final histogram has 32).

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use losses::interlevel::{Levels, Scratch, interlevel, interlevel_backward};
use losses::{Edges, RayIntervals, Reduction, distortion};
use std::{hint::black_box, time::Duration};

/// Histograms of rays with `per_ray` intervals each.
struct Rays {
    offsets: Vec<u32>,
    s: Vec<f32>,
    start: Vec<f32>,
    end: Vec<f32>,
    w: Vec<f32>,
}

fn rays(n: usize, per_ray: usize) -> Rays {
    let rays = n / per_ray;
    let mut out = Rays { offsets: vec![0], s: vec![], start: vec![], end: vec![], w: vec![] };
    for r in 0..rays {
        let posts: Vec<f32> = (0..=per_ray).map(|i| (i * 64 + r % 7) as f32 / (64 * per_ray + 7) as f32).collect();
        out.start.extend_from_slice(&posts[..per_ray]);
        out.end.extend_from_slice(&posts[1..]);
        out.s.extend_from_slice(&posts);
        out.w.extend((0..per_ray).map(|i| ((i + r) * 7919 % 251) as f32 / 251.0 / per_ray as f32));
        out.offsets.push(out.w.len() as u32);
    }
    out
}

fn bench_distortion(c: &mut Criterion) {
    let mut group = c.benchmark_group("losses/distortion");
    for n in [0, 64, 1 << 15, 1 << 20] {
        let h = rays(n, 64);
        group.throughput(Throughput::Elements(n as u64));
        for (name, edges) in [("joined", Edges::Joined(&h.s)), ("apart", Edges::Apart { start: &h.start, end: &h.end })]
        {
            let intervals = RayIntervals { offsets: &h.offsets, edges };
            group.bench_function(BenchmarkId::new(format!("{name}/forward"), n), |b| {
                b.iter(|| distortion::distortion(black_box(intervals), &h.w, Reduction::PerRay));
            });
            let mut bar = vec![0.0; h.w.len()];
            group.bench_function(BenchmarkId::new(format!("{name}/backward"), n), |b| {
                b.iter(|| {
                    let reduction = Reduction::PerRay;
                    distortion::distortion_backward(black_box(intervals), &h.w, reduction, 0.01, black_box(&mut bar))
                });
            });
        }
    }
    group.finish();
}

fn bench_interlevel(c: &mut Criterion) {
    let mut group = c.benchmark_group("losses/interlevel");
    for n in [0, 64, 1 << 15] {
        let (proposal, fine) = (rays(n, 64), rays(n / 2, 32));
        let levels = Levels {
            fine: RayIntervals { offsets: &fine.offsets, edges: Edges::Joined(&fine.s) },
            w: &fine.w,
            proposal: RayIntervals { offsets: &proposal.offsets, edges: Edges::Joined(&proposal.s) },
            w_proposal: &proposal.w,
        };
        let mut scratch = Scratch::default();
        group.throughput(Throughput::Elements(n as u64));
        group.bench_function(BenchmarkId::new("forward", n), |b| {
            b.iter(|| interlevel(black_box(levels), Reduction::PerInterval, &mut scratch));
        });
        let mut bar = vec![0.0; proposal.w.len()];
        group.bench_function(BenchmarkId::new("backward", n), |b| {
            b.iter(|| {
                let reduction = Reduction::PerInterval;
                interlevel_backward(black_box(levels), reduction, 1.0, black_box(&mut bar), &mut scratch)
            });
        });
    }
    group.finish();
}

fn quick() -> Criterion {
    Criterion::default().warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(1))
}

criterion_group! {
    name = benches;
    config = quick();
    targets = bench_distortion, bench_interlevel
}
criterion_main!(benches);
