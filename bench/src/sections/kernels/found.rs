//! What the parts of the section add to: rows and targets.

use crate::error::BenchError;
use crate::goals::Goal;
use crate::measure::{Case, Pools};
use crate::table::{Cell, Table};
use float_core::Simd;

/// A kernel on inputs of its own.
pub(super) trait Kernel: Send {
    fn forward(&mut self, simd: Simd);

    /// Adds to its gradients.
    fn backward(&mut self, simd: Simd);
}

/// The forward pass alone and both passes, on a kernel of its own for each thread. A kernel that could not be made does nothing.
pub(super) fn passes<'a, K: Kernel + 'a>(
    pools: &'a Pools,
    simd: Simd,
    threads: usize,
    kernel: impl Fn() -> Option<K> + Copy,
) -> [Case<'a>; 2] {
    [false, true].map(|both| {
        Case::parallel(pools, threads, kernel, move |kernel: &mut Option<K>| {
            let Some(kernel) = kernel else { return };
            kernel.forward(simd);
            if both {
                kernel.backward(simd);
            }
        })
    })
}

/// What the parts of the section add to.
pub(super) struct Found {
    pub(super) table: Table,
    pub(super) goals: Vec<Goal>,
}

/// One line of the table.
pub(super) struct Row<'a> {
    pub(super) kernel: &'a str,
    pub(super) level: &'a str,
    pub(super) threads: usize,
    /// Units a second.
    pub(super) rate: f64,
    pub(super) unit: &'static str,
    /// Units a second at most, and by which ceiling.
    pub(super) ceiling: Option<(f64, &'static str)>,
    pub(super) error: (Option<f64>, Option<f64>),
}

impl Found {
    pub(super) fn row(&mut self, row: &Row<'_>) -> Result<(), BenchError> {
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
    pub(super) fn goal(&mut self, row: &Row<'_>, target: f64, peer: f64) {
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
