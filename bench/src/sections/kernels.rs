//! The hot kernels: samples a second, share of the ceiling, error against the `f64` twin.

mod composite;
mod grid;
mod network;
mod stream;

use super::Bench;
use crate::error::BenchError;
use crate::goals::Goal;
use crate::page::{Item, Section};
use crate::table::{Cell, Table};

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
    composite::run(bench, &mut found)?;
    stream::run(bench, &mut found)?;
    Ok(Section {
        title: "Kernels",
        intro: "Each kernel on inputs like those of training, with the ceiling it is bound by measured in turns with it. \
                Networks run on tiles of 768 samples that stay in the second-level cache, a tile a thread.",
        items: vec![Item::Table(found.table)],
        goals: found.goals,
    })
}

/// What the parts of the section add to.
struct Found {
    table: Table,
    goals: Vec<Goal>,
}

/// One line of the table.
struct Row<'a> {
    kernel: &'a str,
    level: &'a str,
    threads: usize,
    /// Units a second.
    rate: f64,
    unit: &'static str,
    /// Units a second at most, and by which ceiling.
    ceiling: Option<(f64, &'static str)>,
    error: (Option<f64>, Option<f64>),
}

impl Found {
    fn row(&mut self, row: &Row<'_>) -> Result<(), BenchError> {
        self.table.row([
            row.kernel.into(),
            row.level.into(),
            row.threads.into(),
            (row.rate * 1e-6).into(),
            row.unit.into(),
            row.ceiling.map(|c| c.0 * 1e-6).into(),
            row.ceiling.map_or(Cell::Missing, |c| c.1.into()),
            row.ceiling.map(|c| 100.0 * row.rate / c.0).into(),
            row.error.0.into(),
            row.error.1.into(),
        ])
    }

    /// A target for the row, in millions of units a second.
    fn goal(&mut self, row: &Row<'_>, target: f64, peer: f64) {
        let share = |x: Option<f64>| x.map_or_else(|| "-".into(), |x| format!("{x:.1e}"));
        self.goals.push(Goal {
            work: format!("{}, {} threads", row.kernel, row.threads),
            unit: "M/s",
            figure: row.rate * 1e-6,
            target,
            ceiling: row.ceiling.map(|c| c.0 * 1e-6),
            peer: Some(peer),
            error: format!("values {}, gradients {}", share(row.error.0), share(row.error.1)),
        });
    }
}
