//! How cost grows: slopes of the logarithms, and what more threads give.

use super::kernels::{CompositeBatch, GridBatch, Job, NetworkBatch, shape};
use super::scene::{Trained, embedded, train_seconds};
use crate::bench::{Bench, Extent};
use crate::error::BenchError;
use crate::goals::Goal;
use crate::measure::{Case, interleaved, log_slope, median};
use crate::page::{Item, Section};
use crate::plot::{Axis, Plot, Scale, Series};
use crate::table::{Cell, Table};
use engine::render::{plain_query, render};
use engine::system::System;
use field_core::encoding::hash_grid::HashGridConfig;
use std::time::Instant;

/// Something that grows, and the cost of one unit of work at each size: size, seconds.
struct Curve {
    what: &'static str,
    size: &'static str,
    cost: &'static str,
    points: Vec<(f64, f64)>,
}

pub(crate) fn run(bench: &Bench) -> Result<Section, BenchError> {
    let subject = embedded();
    let trained = train_seconds(bench, &subject, bench.pick(3.0, 20.0), &[])?;
    let curves = [samples(bench)?, pixels(bench, &trained), table_size(bench)?, width(bench)?];
    let mut table = Table::new(
        "slopes",
        "Time grows as the size to the power of the slope (least squares on the logarithms): 1 is proportional, 0 is free.",
        &["what", "size", "cost", "from", "to", "cost at from, us", "cost at to, us", "slope"],
    );
    let mut rows = Table::new("points", "Every point of the curves.", &["what", "size", "microseconds"]);
    for curve in &curves {
        let (Some(&(from, first)), Some(&(to, last))) = (curve.points.first(), curve.points.last()) else { continue };
        table.row([
            curve.what.into(),
            curve.size.into(),
            curve.cost.into(),
            from.into(),
            to.into(),
            (first * 1e6).into(),
            (last * 1e6).into(),
            log_slope(&curve.points).into(),
        ])?;
        for &(size, seconds) in &curve.points {
            rows.row([curve.what.into(), size.into(), (seconds * 1e6).into()])?;
        }
    }
    // Each curve over its smallest size and cost: slopes are seen side by side.
    let relative = |curve: &Curve| {
        let (x0, y0) = curve.points.first().copied().unwrap_or((1.0, 1.0));
        let points = curve.points.iter().map(|&(x, y)| (x / x0, y / y0)).collect();
        Series::line(format!("{} against {}", curve.what, curve.size), points)
    };
    let plot = Plot {
        name: "slopes",
        title: "Growth of cost with size, both over their smallest".into(),
        x: Axis { label: "size / smallest size", scale: Scale::Log },
        y: Axis { label: "cost / cost at the smallest size", scale: Scale::Log },
        series: curves.iter().map(relative).collect(),
    };
    let (threads, goals) = threads(bench, trained)?;
    Ok(Section {
        title: "Growth",
        intro: "Cost of one unit of work against one size at a time, everything else fixed. Values do not depend on the sizes \
                or threads chosen here; errors of the same kernels stand in the section on kernels.",
        items: vec![Item::Table(table), Item::Plot(plot), Item::Table(threads), Item::Table(rows)],
        goals,
    })
}

/// Compositing of 64 rays, forward and backward, against samples a ray.
fn samples(bench: &Bench) -> Result<Curve, BenchError> {
    let simd = bench.simd;
    let sizes: Vec<usize> = (4..=bench.pick(11, 13)).map(|k| 1 << k).collect();
    let mut batches: Vec<CompositeBatch> = sizes.iter().map(|&n| CompositeBatch::new(64, n)).collect();
    let mut cases: Vec<Case<'_>> = batches
        .iter_mut()
        .map(|b| {
            Case::new(|| {
                b.forward(simd);
                b.backward(simd);
            })
        })
        .collect();
    let seconds = interleaved(bench.effort, &mut cases);
    let points = sizes.iter().zip(seconds).map(|(&n, s)| (n as f64, s / 64.0)).collect();
    Ok(Curve { what: "compositing forward+backward", size: "samples a ray", cost: "a ray", points })
}

/// Rendering of one view of the embedded scene against its pixels.
fn pixels(bench: &Bench, trained: &Trained<'_>) -> Curve {
    let system: &dyn System = trained.run.system.as_ref();
    let query = plain_query(trained.run.query().background, 1.0 / 2048.0);
    let cameras: Vec<_> = trained
        .run
        .held_out
        .views()
        .iter()
        .take(1)
        .flat_map(|view| {
            let sides = bench.pick(vec![16, 32, 64, 128], vec![16, 32, 64, 128, 256, 512]);
            sides.into_iter().map(|side| view.camera.resized(side, side)).collect::<Vec<_>>()
        })
        .collect();
    let mut cases: Vec<Case<'_>> = cameras
        .iter()
        .map(|camera| {
            Case::new(|| {
                std::hint::black_box(render(system, camera, &query));
            })
        })
        .collect();
    let seconds = interleaved(bench.effort, &mut cases);
    let points = cameras.iter().zip(seconds).map(|(c, s)| (f64::from(c.width * c.height), s)).collect();
    Curve { what: "rendering a view (ngp)", size: "pixels", cost: "a view", points }
}

/// Hash grid 16x2, forward and backward, against entries of a level.
fn table_size(bench: &Bench) -> Result<Curve, BenchError> {
    let simd = bench.simd;
    let sizes: Vec<u32> = bench.pick(vec![12, 14, 16, 18, 19], (11..=21).collect());
    let samples = bench.pick(1 << 13, 1 << 15);
    let mut batches = Vec::new();
    for &log2_table in &sizes {
        batches.push(GridBatch::new(HashGridConfig::default().with_log2_table(log2_table), samples)?);
    }
    let pools = &bench.pools;
    let mut cases: Vec<Case<'_>> = batches
        .iter_mut()
        .map(|b| {
            Case::pooled(pools, 1, || {
                b.forward(simd);
                b.backward(simd);
            })
        })
        .collect();
    let seconds = interleaved(bench.effort, &mut cases);
    let points = sizes.iter().zip(seconds).map(|(&t, s)| (2_f64.powi(t as i32), s / samples as f64)).collect();
    Ok(Curve {
        what: "hash grid 16x2 forward+backward, 1 thread",
        size: "entries of a level",
        cost: "a sample",
        points,
    })
}

/// A network with two hidden layers, forward and backward, against their width.
fn width(bench: &Bench) -> Result<Curve, BenchError> {
    const TILE: usize = 192;
    let simd = bench.simd;
    let sizes = bench.pick(vec![16, 32, 64, 128, 256], vec![16, 32, 48, 64, 96, 128, 192, 256, 384, 512]);
    let mut shapes = Vec::new();
    for &width in &sizes {
        shapes.push(shape(&[32, width, width, 16], &[])?);
    }
    let mut cases: Vec<Case<'_>> = shapes
        .iter()
        .map(|shape| {
            let mut batch = NetworkBatch::new(shape, TILE);
            Case::new(move || batch.run(shape, simd, Job::Both, 1))
        })
        .collect();
    let seconds = interleaved(bench.effort, &mut cases);
    let points = sizes.iter().zip(seconds).map(|(&w, s)| (w as f64, s / TILE as f64)).collect();
    Ok(Curve { what: "network 32-W-W-16 forward+backward, 1 thread", size: "width W", cost: "a sample", points })
}

/// Training steps of `ngp` and tiles of a network on 1 to all threads.
fn threads(bench: &Bench, mut trained: Trained<'_>) -> Result<(Table, Vec<Goal>), BenchError> {
    let mut table = Table::new(
        "threads",
        "What more threads give. Results have the same bits for any number of them, so there is no error to state.",
        &["work", "threads", "a second", "unit", "speed-up"],
    );
    let most = bench.pools.most();
    let counts: Vec<usize> = (1..=most).filter(|t| t.is_power_of_two() || *t == most).collect();

    let network = shape(&[32, 64, 64, 16], &[])?;
    let mut cases: Vec<Case<'_>> = counts
        .iter()
        .map(|&threads| {
            let (shape, simd) = (&network, bench.simd);
            let state = move || NetworkBatch::new(shape, 768);
            Case::parallel(&bench.pools, threads, state, move |b: &mut NetworkBatch| b.run(shape, simd, Job::Both, 16))
        })
        .collect();
    let seconds = interleaved(bench.effort, &mut cases);
    drop(cases);
    let rates: Vec<f64> = counts.iter().zip(&seconds).map(|(&t, s)| (16 * 768 * t) as f64 / s).collect();
    let mut goals = Vec::new();
    add(&mut table, "network 32-64-64-16 forward+backward", "samples", &counts, &rates)?;

    // Steps differ from one to the next: runs of them on each number of threads in turn.
    let (rounds, steps) = bench.pick((6, 4), (12, 12));
    let mut per_count = vec![Vec::new(); counts.len()];
    let run = &mut trained.run;
    for _ in 0..rounds {
        for (k, &threads) in counts.iter().enumerate() {
            let (system, data, first) = (run.system.as_mut(), &run.train, run.step);
            let (seconds, samples) = bench.pools.run(threads, || -> Result<(f64, u64), BenchError> {
                let (clock, mut samples) = (Instant::now(), 0);
                for step in first..first + steps {
                    samples += system.step(data, step).map_err(BenchError::part)?.samples;
                }
                Ok((clock.elapsed().as_secs_f64(), samples))
            })?;
            run.step += steps;
            per_count[k].push(samples as f64 / seconds);
        }
    }
    let rates: Vec<f64> = per_count.iter_mut().map(|r| median(r)).collect();
    add(&mut table, "training step (ngp, embedded scene)", "samples", &counts, &rates)?;
    if let Some(two) = counts.iter().position(|&t| t == 2) {
        goals.push(Goal {
            work: format!(
                "second core, training step{}",
                if bench.extent == Extent::Quick { " (small scene)" } else { "" }
            ),
            unit: "x",
            figure: rates[two] / rates[0],
            target: 1.9,
            ceiling: Some(2.0),
            peer: Some(1.12),
            error: "0: the same bits".into(),
        });
    }
    Ok((table, goals))
}

fn add(table: &mut Table, work: &str, unit: &str, counts: &[usize], rates: &[f64]) -> Result<(), BenchError> {
    for (&threads, &rate) in counts.iter().zip(rates) {
        table.row([work.into(), threads.into(), rate.into(), unit.into(), Cell::from(rate / rates[0])])?;
    }
    Ok(())
}
