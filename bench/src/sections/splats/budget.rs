//! What an error budget buys of a trained cloud, and what is left out at each.

use crate::bench::Bench;
use crate::error::BenchError;
use crate::page::Item;
use crate::plot::{Axis, Plot, Scale, Series};
use crate::sections::budgets;
use crate::sections::scene::Trained;
use crate::table::{Cell, Table};
use engine::render::{plain_query, render};

/// Colour units; the first is what training draws with.
const BUDGETS: [(f32, &str); 4] = [(0.0, "0"), (1.0 / 2048.0, "1/2048"), (1.0 / 255.0, "1/255"), (1.0 / 64.0, "1/64")];

/// Tables and plots of this part.
pub(super) struct Budgets {
    times: Table,
    skips: Table,
    series: Vec<Series>,
}

impl Budgets {
    pub(super) fn new() -> Self {
        let skips = Table::new(
            "skips",
            "What the same pictures left out. Tiles are finished when each pixel's light is; the first and the last row cost \
             nothing at any budget.",
            &["scene", "budget", "left out", "count", "of", "unit", "%"],
        );
        Self { times: budgets::table(), skips, series: Vec::new() }
    }

    pub(super) fn items(&self) -> Vec<Item> {
        if self.times.is_empty() {
            return Vec::new();
        }
        let plot = Plot {
            name: "budgets",
            title: "What a budget buys: time of a view against its largest error".into(),
            x: Axis { label: "time of a view, share of that at budget 0", scale: Scale::Linear },
            y: Axis { label: "largest error, colour units", scale: Scale::Log },
            series: self.series.clone(),
        };
        let words = "**Error budgets.** Early stop: a pixel is finished after the Gaussian that leaves no more of its light than the \
                     budget over the brightest colour of the picture: what is behind is worth no more than the budget.";
        vec![
            Item::Text(words.into()),
            Item::Table(self.times.clone()),
            Item::Table(self.skips.clone()),
            Item::Plot(plot),
        ]
    }
}

pub(super) fn run(bench: &Bench, trained: &Trained<'_>, scene: &str, budgets: &mut Budgets) -> Result<(), BenchError> {
    let Budgets { times, skips, series } = budgets;
    series.push(Series::line(scene, budgets::one(bench, trained, scene, &BUDGETS, times)?));
    let system = trained.run.system.as_ref();
    let background = trained.run.query().background;
    for (budget, words) in BUDGETS {
        // Counts only ever grow: what the pictures added.
        let before = system.skips();
        for view in trained.run.held_out.views() {
            std::hint::black_box(render(system, &view.camera, &plain_query(background, budget)));
        }
        for (row, before) in system.skips().iter().zip(&before) {
            let (skipped, total) = ((row.skipped - before.skipped) as usize, (row.total - before.total) as usize);
            // What happens in training alone is not a row here.
            if total == 0 {
                continue;
            }
            let share = Cell::from(100.0 * skipped as f64 / total as f64);
            skips.row([
                scene.into(),
                words.into(),
                row.what.into(),
                skipped.into(),
                total.into(),
                row.unit.into(),
                share,
            ])?;
        }
    }
    Ok(())
}
