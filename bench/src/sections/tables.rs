//! Layouts of hash grids: what a fit of the same steps reaches, and what a sample costs.

use super::kernels::{GridBatch, shape};
use crate::bench::Bench;
use crate::error::BenchError;
use crate::measure::{Case, interleaved};
use crate::page::{Item, Section};
use crate::plot::{Axis, Plot, Scale, Series};
use crate::table::Table;
use field_core::encoding::hash_grid::{HashGrid, HashGridConfig, Touched};
use field_core::mlp::Precision;
use field_core::rng::Rng;
use optim::{Adam, AdamConfig};
use std::f64::consts::TAU;

/// Samples of a step of the fit, whole tiles of the network.
const BATCH: usize = 6144;
/// Samples the fit is measured on.
const HELD_OUT: usize = 1 << 13;

pub(crate) fn run(bench: &Bench) -> Result<Section, BenchError> {
    let layouts: [(usize, usize); 4] = [(16, 2), (8, 4), (4, 8), (16, 1)];
    let layouts = &layouts[..bench.pick(2, 4)];
    let sizes: Vec<u32> = bench.pick(vec![12, 14, 16, 18], (11..=20).collect());
    let steps = bench.pick(100, 1200);
    let mut table = Table::new(
        "tables",
        "Time: forward and backward of the grid for samples along rays, all threads. Error: root mean square of a fit of an \
         analytic field after the same number of steps, on points the fit has not seen. Levels from 16 to 512 cells.",
        &["layout", "entries a level", "MB", "ns a sample", "RMS error of the fit", "pareto"],
    );
    let samples = bench.pick(1 << 13, 1 << 15);
    let (mut configs, mut batches) = (Vec::new(), Vec::new());
    for &(levels, features) in layouts {
        for &log2_table in &sizes {
            let config = config(levels, features, log2_table);
            configs.push(config);
            batches.push(GridBatch::new(config, samples)?);
        }
    }
    let (pools, simd) = (&bench.pools, bench.simd);
    let mut cases: Vec<Case<'_>> = batches
        .iter_mut()
        .map(|b| {
            Case::pooled(pools, pools.most(), || {
                b.forward(simd);
                b.backward(simd);
            })
        })
        .collect();
    let seconds = interleaved(bench.effort, &mut cases);
    drop(cases);
    drop(batches);
    let mut found = Vec::new();
    for (config, seconds) in configs.into_iter().zip(seconds) {
        found.push((config, seconds / samples as f64 * 1e9, fit(bench, config, Precision::F32, steps)?));
    }
    let mut series: Vec<Series> =
        layouts.iter().map(|(l, f)| Series::line(format!("{l} levels x {f} features"), Vec::new())).collect();
    for (config, time, error) in &found {
        let grid = HashGrid::new(*config).map_err(BenchError::part)?;
        // Nothing else is at once as fast and as good.
        let best = found.iter().all(|(_, t, e)| t >= time || e >= error);
        let layout = format!("{}x{}", config.levels, config.features);
        table.row([
            layout.into(),
            format!("2^{}", config.log2_table).into(),
            (grid.params_len() as f64 * 4e-6).into(),
            (*time).into(),
            (*error).into(),
            if best { "best at its time" } else { "" }.into(),
        ])?;
        if let Some(k) = layouts.iter().position(|&(l, f)| (l, f) == (config.levels, config.features)) {
            series[k].points.push((*time, *error));
        }
    }
    let plot = Plot {
        name: "time",
        title: "Hash grids, small tables to large: time against error".into(),
        x: Axis { label: "nanoseconds a sample, forward and backward", scale: Scale::Log },
        y: Axis { label: "RMS error of the fit", scale: Scale::Log },
        series,
    };
    Ok(Section {
        title: "Table sizes",
        intro: "A shell with a fine pattern (detail from 1 to 40 periods, on a surface as a radiance field's) is fitted with a \
                hash grid and a network 64 wide, same steps and samples for every layout.",
        items: vec![Item::Plot(plot), Item::Table(table)],
        goals: Vec::new(),
    })
}

pub(super) fn config(levels: usize, features: usize, log2_table: u32) -> HashGridConfig {
    let growth = field_core::encoding::hash_grid::Growth::UpTo(512);
    HashGridConfig::default()
        .with_levels(levels)
        .with_features(features)
        .with_log2_table(log2_table)
        .with_growth(growth)
}

/// Points near a sphere, and the pattern there.
fn draw(rng: Rng, n: usize) -> (Vec<f32>, Vec<f32>) {
    let (mut x, mut y) = (vec![0.0; 3 * n], vec![0.0; n]);
    for i in 0..n {
        let u = rng.uniform4_at(i as u64).map(f64::from);
        let (z, turn) = (2.0 * u[0] - 1.0, TAU * u[1]);
        let r = 0.35 + 0.02 * u[2];
        let flat = (1.0 - z * z).max(0.0).sqrt();
        let p = [r * flat * turn.cos(), r * flat * turn.sin(), r * z].map(|c| c + 0.5);
        let wave = |f: f64, a: usize, b: usize| (TAU * f * (p[a] + 0.37 * p[b])).sin() / f.sqrt();
        for a in 0..3 {
            x[a * n + i] = p[a] as f32;
        }
        y[i] =
            (0.5 * (wave(1.0, 0, 1) + wave(3.0, 1, 2) + wave(9.0, 2, 0) + wave(20.0, 0, 2) + wave(40.0, 1, 0))) as f32;
    }
    (x, y)
}

/// Root mean square error on unseen points after so many steps of Adam.
pub(super) fn fit(bench: &Bench, config: HashGridConfig, precision: Precision, steps: u64) -> Result<f64, BenchError> {
    const TILE: usize = 768;
    let grid = HashGrid::new(config).map_err(BenchError::part)?;
    let mut net = shape(&[grid.out_rows(), 64, 1], &[])?.with_precision(precision);
    let (simd, rng) = (bench.simd, Rng::new(7, 0));
    let mut table = vec![0.0; grid.params_len()];
    Rng::new(8, 0).fill_uniform(0, &mut table);
    table.iter_mut().for_each(|p| *p = (2.0 * *p - 1.0) * 1e-4);
    // An optimiser a level: each has its own words of what was touched.
    let mut grid_adam: Vec<Adam> =
        (0..config.levels).map(|l| Adam::new(grid.level_range(l).len(), AdamConfig::NGP)).collect();
    let mut net_adam = Adam::new(net.mlp.param_count(), AdamConfig::DEFAULT);
    let (mut grad, mut touched) = (vec![0.0; table.len()], Touched::new(&grid));
    let rows = grid.out_rows();
    let (mut features, mut features_bar) = (vec![0.0; rows * BATCH], vec![0.0; rows * BATCH]);
    let (mut y, mut y_bar) = (vec![0.0; BATCH], vec![0.0; BATCH]);
    let mut acts = vec![0.0; net.mlp.activations_len(TILE)];
    let mut scratch = vec![0.0; net.mlp.backward_scratch_len().max(net.mlp.infer_scratch_len())];
    let (mut packed_grad, mut net_grad) = (vec![0.0; net.mlp.packed_grad_len()], vec![0.0; net.mlp.param_count()]);
    for step in 0..steps {
        let (x, want) = draw(rng.substream(step), BATCH);
        bench
            .pools
            .run(bench.pools.most(), || grid.encode(simd, &table, &x, &mut features))
            .map_err(BenchError::part)?;
        features_bar.fill(0.0);
        packed_grad.fill(0.0);
        for at in (0..BATCH).step_by(TILE) {
            let (y, y_bar) = (&mut y[at..][..TILE], &mut y_bar[at..][..TILE]);
            net.mlp.forward(simd, &net.packed, &features[at..], BATCH, TILE, y, TILE, &mut acts);
            for ((bar, y), want) in y_bar.iter_mut().zip(y.iter()).zip(&want[at..]) {
                *bar = 2.0 * (y - want) / BATCH as f32;
            }
            let x_bar = Some((&mut features_bar[at..], BATCH));
            net.mlp.backward(simd, &net.packed, &acts, y_bar, TILE, TILE, x_bar, &mut packed_grad, &mut scratch);
        }
        net_grad.fill(0.0);
        net.mlp.unpack_grad(&packed_grad, &mut net_grad);
        let rate = 1e-2 * 0.1_f64.powf(step as f64 / steps as f64);
        let mut bad = net_adam.step(simd, rate, &mut net.params, &net_grad);
        net.mlp.pack(&net.params, &mut net.packed);
        bench
            .pools
            .run(bench.pools.most(), || grid.encode_backward(simd, &x, &features_bar, &mut grad, Some(&mut touched)))
            .map_err(BenchError::part)?;
        for ((level, adam), words) in grid_adam.iter_mut().enumerate().zip(touched.levels_mut()) {
            let range = grid.level_range(level);
            bad += adam.step_touched(simd, rate, &mut table[range.clone()], &mut grad[range], words);
        }
        if bad > 0 {
            return Err(BenchError::Part(format!("fit of {config:?}: {bad} gradients of step {step} are not finite")));
        }
    }
    let (x, want) = draw(Rng::new(9, 1), HELD_OUT);
    let (mut features, mut y) = (vec![0.0; rows * HELD_OUT], vec![0.0; HELD_OUT]);
    grid.encode(simd, &table, &x, &mut features).map_err(BenchError::part)?;
    net.mlp.infer(simd, &net.packed, &features, HELD_OUT, HELD_OUT, &mut y, HELD_OUT, &mut scratch);
    let squares: f64 = y.iter().zip(&want).map(|(y, w)| f64::from(y - w).powi(2)).sum();
    Ok((squares / HELD_OUT as f64).sqrt())
}
