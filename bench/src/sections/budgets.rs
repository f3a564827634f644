//! Error budgets of a trained scene: time, bound, true error.

use super::scene::{Subject, Trained, dataset, embedded, train_seconds};
use crate::bench::{Bench, Extent};
use crate::error::BenchError;
use crate::measure::{Case, interleaved};
use crate::page::{Item, Section};
use crate::plot::{Axis, Plot, Scale, Series};
use crate::table::{Cell, Table};
use engine::options::DataOptions;
use engine::render::{plain_query, render};
use engine::system::System;
use render_core::camera::Camera;

/// Colour units; the first is the full sum.
const BUDGETS: [(f32, &str); 7] = [
    (0.0, "0"),
    (1.0 / 16384.0, "1/16384"),
    (1.0 / 2048.0, "1/2048"),
    (1.0 / 512.0, "1/512"),
    (1.0 / 255.0, "1/255"),
    (1.0 / 64.0, "1/64"),
    (1.0 / 16.0, "1/16"),
];

/// What [`one`] adds to.
pub(super) fn table() -> Table {
    Table::new(
        "budgets",
        "Held-out views of a trained scene at each budget against the same views at budget 0: largest and mean distance of a \
         colour channel. The budget is the bound.",
        &[
            "scene",
            "budget",
            "ms a view",
            "time / budget 0",
            "largest error",
            "mean error",
            "share of the budget",
            "inside",
        ],
    )
}

pub(crate) fn run(bench: &Bench) -> Result<Section, BenchError> {
    let mut table = table();
    let mut series = Vec::new();
    let data = |longest_side, holdout: Option<&str>| DataOptions {
        longest_side,
        holdout: holdout.map(str::to_string),
        ..DataOptions::default()
    };
    let mut subjects: Vec<(Subject, f64)> = vec![(embedded(), bench.pick(5.0, 30.0))];
    if bench.extent == Extent::Full {
        let scenes = [
            dataset(bench, "lego", "nerf_synthetic/lego", data(Some(200), None)),
            dataset(bench, "fox", "benchmarks/fox135", data(None, Some("every:8"))),
        ];
        subjects.extend(scenes.into_iter().flatten().map(|s| (s, 60.0)));
    }
    for (subject, seconds) in &subjects {
        let trained = train_seconds(bench, subject, *seconds, &[])?;
        series.push(Series::line(subject.name.as_str(), one(bench, &trained, &subject.name, &BUDGETS, &mut table)?));
    }
    let plot = Plot {
        name: "time",
        title: "What a budget buys: time of a view against its largest error".into(),
        x: Axis { label: "time of a view, share of that at budget 0", scale: Scale::Linear },
        y: Axis { label: "largest error, colour units", scale: Scale::Log },
        series,
    };
    Ok(Section {
        title: "Error budgets",
        intro: "A budget is the largest error that skipped work may cause in a colour channel of a pixel. Budget 0 skips \
                nothing but space that the system holds to be empty, which the field itself takes for part of the scene.",
        items: vec![Item::Table(table), Item::Plot(plot)],
        goals: Vec::new(),
    })
}

/// One scene's rows, the first of `budgets` 0; gives time as a share and largest error of each budget above 0.
pub(super) fn one(
    bench: &Bench,
    trained: &Trained<'_>,
    name: &str,
    budgets: &[(f32, &str)],
    table: &mut Table,
) -> Result<Vec<(f64, f64)>, BenchError> {
    let views = trained.run.held_out.views();
    let cameras: Vec<&Camera> = views.iter().take(bench.pick(2, 4)).map(|v| &v.camera).collect();
    let background = trained.run.query().background;
    let system: &dyn System = trained.run.system.as_ref();
    let pictures = |budget: f32| {
        let query = plain_query(background, budget);
        cameras.iter().flat_map(|camera| render(system, camera, &query).layers.rgb).collect::<Vec<[f32; 3]>>()
    };
    let mut cases: Vec<Case<'_>> = budgets
        .iter()
        .map(|&(budget, _)| {
            Case::new(move || {
                std::hint::black_box(pictures(budget));
            })
        })
        .collect();
    let seconds = interleaved(bench.effort, &mut cases);
    drop(cases);
    let full = pictures(0.0);
    let mut points = Vec::new();
    for (&(budget, words), &time) in budgets.iter().zip(&seconds) {
        let errors: Vec<f64> = pictures(budget)
            .iter()
            .zip(&full)
            .flat_map(|(a, b)| [0, 1, 2].map(|c| (f64::from(a[c]) - f64::from(b[c])).abs()))
            .collect();
        let largest = errors.iter().copied().fold(0.0, f64::max);
        let mean = errors.iter().sum::<f64>() / errors.len().max(1) as f64;
        let share = time / seconds[0];
        let inside = if largest <= f64::from(budget) { "yes" } else { "**no**" };
        let of_budget = if budget > 0.0 { Cell::from(largest / f64::from(budget)) } else { Cell::Missing };
        table.row([
            name.into(),
            words.into(),
            (1e3 * time / cameras.len().max(1) as f64).into(),
            share.into(),
            largest.into(),
            mean.into(),
            of_budget,
            inside.into(),
        ])?;
        if budget > 0.0 {
            points.push((share, largest));
        }
    }
    Ok(points)
}
