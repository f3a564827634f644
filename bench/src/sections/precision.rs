//! f32 against bf16 in the products of networks: time, error, and what a fit comes to.

use super::kernels::{Job, NetworkBatch, Shape, shape};
use super::tables;
use crate::bench::Bench;
use crate::error::BenchError;
use crate::goals::Goal;
use crate::measure::{Case, interleaved};
use crate::page::{Item, Section};
use crate::table::{Cell, Table};
use field_core::mlp::Precision;

/// A network, and the tile it runs on.
struct Network {
    name: &'static str,
    widths: Vec<usize>,
    skips: &'static [usize],
    tile: usize,
}

pub(crate) fn run(bench: &Bench) -> Result<Section, BenchError> {
    let mut table = Table::new(
        "precision",
        "Errors against the f64 twin with unrounded weights, as a share of the largest value; gradients of weights and inputs.",
        &["network", "job", "threads", "precision", "M samples/s", "times f32", "error forward", "error gradient"],
    );
    let mut goals = Vec::new();
    let deep = [vec![63], vec![256; 8], vec![4]].concat();
    for network in [
        Network { name: "32-64-64-16", widths: vec![32, 64, 64, 16], skips: &[], tile: 768 },
        Network { name: "32-64-16", widths: vec![32, 64, 16], skips: &[], tile: 768 },
        Network { name: "63-8x256-4", widths: deep, skips: &[5], tile: 96 },
    ] {
        one(bench, &network, &mut table, &mut goals)?;
    }
    let mut fits = Table::new(
        "fits",
        "The fit of the section on table sizes (16x2, T = 2^16) with the same steps and seeds.",
        &["precision", "steps", "RMS error"],
    );
    let steps = bench.pick(100, 1200);
    for precision in [Precision::F32, Precision::Bf16] {
        let error = tables::fit(bench, tables::config(16, 2, 16), precision, steps)?;
        fits.row([word(precision).into(), (steps as usize).into(), error.into()])?;
    }
    Ok(Section {
        title: "Precision",
        intro: "bf16 keeps 8 bits of weights, layer inputs and gradients; sums stay f32. Where the CPU multiplies pairs of bf16 \
                at full rate it has twice the peak; elsewhere it gains nothing.",
        items: vec![Item::Table(table), Item::Table(fits)],
        goals,
    })
}

fn one(bench: &Bench, network: &Network, table: &mut Table, goals: &mut Vec<Goal>) -> Result<(), BenchError> {
    let base = shape(&network.widths, network.skips)?;
    let both = [Precision::F32, Precision::Bf16].map(|p| (p, base.with_precision(p)));
    let tiles = if network.tile > 100 { 16 } else { 2 };
    for threads in bench.pools.one_and_most() {
        for job in [Job::Forward, Job::Both] {
            let case = |shape: &'_ Shape| -> NetworkBatch { NetworkBatch::new(shape, network.tile) };
            let mut cases: Vec<Case<'_>> = both
                .iter()
                .map(|(_, shape)| {
                    let simd = bench.simd;
                    Case::parallel(
                        &bench.pools,
                        threads,
                        move || case(shape),
                        move |b: &mut NetworkBatch| {
                            b.run(shape, simd, job, tiles);
                        },
                    )
                })
                .collect();
            let seconds = interleaved(bench.effort, &mut cases);
            let samples = (network.tile * tiles * threads) as f64;
            for ((precision, shape), time) in both.iter().zip(&seconds) {
                let (values, gradients) = shape.errors(bench.simd, 96);
                let words = if job == Job::Forward { "forward" } else { "forward+backward" };
                table.row([
                    network.name.into(),
                    words.into(),
                    threads.into(),
                    word(*precision).into(),
                    (samples / time * 1e-6).into(),
                    (seconds[0] / time).into(),
                    values.into(),
                    if job == Job::Both { Cell::from(gradients) } else { Cell::Missing },
                ])?;
                let wanted = network.name == "32-64-64-16" && job == Job::Both && threads == bench.pools.most();
                if wanted && *precision == Precision::Bf16 {
                    goals.push(Goal {
                        work: format!("network 32-64-64-16 forward+backward, bf16, {threads} threads"),
                        unit: "M/s",
                        figure: samples / time * 1e-6,
                        target: 6.2,
                        ceiling: None,
                        peer: Some(2.3),
                        error: format!("values {values:.1e}, gradients {gradients:.1e}"),
                    });
                }
            }
        }
    }
    Ok(())
}

fn word(precision: Precision) -> &'static str {
    match precision {
        Precision::F32 => "f32",
        Precision::Bf16 => "bf16",
    }
}
