//! The hot kernels: samples a second, share of the ceiling, error against the `f64` twin.

mod composite;
mod convolution;
mod found;
mod grid;
mod joint;
mod network;
mod planes;
mod rigid;
mod stream;

use crate::bench::Bench;
use crate::error::BenchError;
use crate::page::{Item, Section};
use crate::table::Table;
use found::Found;

pub(crate) use composite::Batch as CompositeBatch;
pub(crate) use grid::GridBatch;
pub(crate) use network::{Job, NetworkBatch, Shape, shape};

pub(crate) fn run(bench: &Bench) -> Result<Section, BenchError> {
    let mut found = Found {
        table: Table::new(
            "kernels",
            "Ceiling: the arithmetic or the reads of one unit of work over what the machine was seen to do in the same \
             repetitions. Errors are the largest distance from the `f64` twin as a share of the largest value; gradients \
             include that of the forward pass before them.",
            &[
                "kernel",
                "level",
                "threads",
                "M/s",
                "unit",
                "ceiling M/s",
                "ceiling is",
                "% of ceiling",
                "error forward",
                "error gradient",
            ],
        ),
        goals: Vec::new(),
    };
    network::run(bench, &mut found)?;
    grid::run(bench, &mut found)?;
    planes::run(bench, &mut found)?;
    composite::run(bench, &mut found)?;
    joint::run(bench, &mut found)?;
    rigid::run(bench, &mut found)?;
    convolution::run(bench, &mut found)?;
    stream::run(bench, &mut found)?;
    Ok(Section {
        title: "Kernels",
        intro: "Each kernel on inputs like those of training, with the ceiling it is bound by measured in turns with it. \
                Networks run on tiles of 768 samples that stay in the second-level cache, a tile a thread.",
        items: vec![Item::Table(found.table)],
        goals: found.goals,
    })
}
