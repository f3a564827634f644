//! What a step of each system costs, and that a part which the plan left out costs nothing.

use super::protocols::{COSTS, Entry, NGP};
use crate::bench::{Bench, Keep, say};
use crate::claims;
use crate::error::BenchError;
use crate::measure::median;
use crate::page::{Item, Section};
use crate::sections::scene::{Job, small_tabletop, train};
use crate::table::Table;
use engine::options::{DataOptions, Request};
use engine::run::Build;
use engine::train::{Schedule, Stop};
use scene_io::{PerturbationKind, Scene, perturb};

/// One kind of training.
struct Case<'a> {
    entry: Entry,
    build: &'a Build<'a>,
    seconds: Vec<f64>,
    psnr: Option<f64>,
}

impl<'a> Case<'a> {
    fn new(entry: Entry, build: &'a Build<'a>) -> Self {
        Self { entry, build, seconds: Vec::new(), psnr: None }
    }
}

/// Milliseconds a step, rounds of all systems in turns.
pub(in crate::sections) fn run(bench: &Bench, keep: &Keep<'_>) -> Result<Section, BenchError> {
    let (rounds, steps) = bench.pick((1, 50), (3, 500));
    let steps = bench.steps.unwrap_or(steps);
    let mut cases = vec![Case::new(NGP, &systems::registry::build)];
    cases.extend(COSTS.iter().map(|&entry| Case::new(entry, &systems::registry::build)));
    let scene = perturb(small_tabletop(), PerturbationKind::Both, 0);
    for round in 1..=rounds {
        for case in &mut cases {
            let (seconds, psnr) = train_case(case, &scene, steps)?;
            case.seconds.push(seconds);
            case.psnr = psnr;
        }
        say(&format!("        round {round} of {rounds}"));
        if round < rounds {
            keep(&section(&cases, steps)?)?;
        }
    }
    section(&cases, steps)
}

/// Medians over the rounds so far.
fn section(cases: &[Case<'_>], steps: u64) -> Result<Section, BenchError> {
    let mut table = Table::new(
        "cost",
        "Median over rounds in which the systems took turns; the first steps' surveys, warm-ups and encoders included. Held-out \
         PSNR in dB, in the mean appearance, after so few steps: it says that the work was done, and that `plain` is `ngp`, to the \
         last digit.",
        &["system", claims::COLUMN, "steps", "ms a step", "times ngp", "PSNR"],
    );
    let each: Vec<f64> = cases.iter().map(|c| 1e3 * median(&mut c.seconds.clone()) / steps as f64).collect();
    for (case, ms) in cases.iter().zip(&each) {
        table.row([
            case.entry.name.into(),
            claims::mark(case.entry.system, case.entry.set),
            (steps as usize).into(),
            (*ms).into(),
            (ms / each[0]).into(),
            Table::decibels(case.psnr),
        ])?;
    }
    Ok(Section {
        title: "In the wild: cost of a step",
        intro: "The embedded tabletop, its training photos covered with squares and with colours of their own: every part of \
                every system has something to do.",
        items: [Item::Table(table)].into_iter().chain(claims::note(cases.iter().map(|c| c.entry.system))).collect(),
        goals: Vec::new(),
    })
}

/// Training seconds and held-out PSNR.
fn train_case(case: &Case<'_>, scene: &Scene, steps: u64) -> Result<(f64, Option<f64>), BenchError> {
    let request = Request {
        scene: Some("perturbed:co:synthetic:tabletop".into()),
        system: Some(case.entry.system.into()),
        set: case.entry.set.parse().map_err(BenchError::part)?,
        eval_appearance: Some("mean".parse().map_err(BenchError::Part)?),
        ..Request::default()
    };
    let load = |_: &str, _: &DataOptions| Ok(scene.clone());
    let schedule = Schedule::new(Stop::Steps(steps));
    let Case { entry, build, .. } = case;
    let job = Job { name: entry.name, request: &request, load: &load, build: *build, schedule, lpips: None };
    let trained = train(job, |_| {})?;
    Ok((trained.ended.seconds, trained.evaluation.and_then(|e| e.psnr)))
}
