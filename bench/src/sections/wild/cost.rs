//! What a step of each system costs, and that a part which the plan left out costs nothing.

use super::protocols::{COSTS, Entry};
use crate::error::BenchError;
use crate::measure::median;
use crate::page::{Item, Section};
use crate::sections::scene::{Watch, small_tabletop};
use crate::sections::{Bench, say};
use crate::table::Table;
use scene_io::{Disturbance, Scene, perturb};
use std::sync::atomic::AtomicBool;
use systems::options::{DataOptions, Request};
use systems::run::{Build, Run, disk_parts};
use systems::train::{Schedule, Stop};

/// One kind of training.
struct Case<'a> {
    name: String,
    system: &'a str,
    set: &'a str,
    build: &'a Build<'a>,
    seconds: Vec<f64>,
    psnr: Option<f64>,
}

/// Milliseconds a step, rounds of all systems in turns.
pub(in crate::sections) fn run(bench: &Bench) -> Result<Section, BenchError> {
    let (rounds, steps) = bench.pick((1, 50), (3, 500));
    let mut cases = vec![Case {
        name: "ngp of nerf-static".into(),
        system: "ngp",
        set: "",
        build: &systems::plan::build,
        seconds: Vec::new(),
        psnr: None,
    }];
    cases.extend(COSTS.iter().map(|&Entry { name, system, set, .. }| Case {
        name: name.into(),
        system,
        set,
        build: &systems::wild::build,
        seconds: Vec::new(),
        psnr: None,
    }));
    let scene = perturb(small_tabletop(), Disturbance::Both, 0);
    for round in 0..rounds {
        for case in &mut cases {
            let (seconds, psnr) = train(case, &scene, steps)?;
            case.seconds.push(seconds);
            case.psnr = psnr;
        }
        say(&format!("        round {} of {rounds}", round + 1));
    }
    let mut table = Table::new(
        "cost",
        "Median over rounds in which the systems took turns; the first steps' surveys, warm-ups and encoders included. Held-out \
         PSNR in dB, in the mean light, after so few steps: it says that the work was done, and that `plain` is `ngp`, to the \
         last digit.",
        &["system", "steps", "ms a step", "times ngp", "PSNR"],
    );
    let mut each = Vec::with_capacity(cases.len());
    for case in &mut cases {
        each.push(1e3 * median(&mut case.seconds) / steps as f64);
    }
    for (case, ms) in cases.iter().zip(&each) {
        table.row([
            case.name.as_str().into(),
            (steps as usize).into(),
            (*ms).into(),
            (ms / each[0]).into(),
            case.psnr.into(),
        ])?;
    }
    Ok(Section {
        title: "In the wild: cost of a step",
        intro: "The embedded tabletop, its training photos covered with squares and with colours of their own: every part of \
                every system has something to do.",
        items: vec![Item::Table(table)],
        goals: Vec::new(),
    })
}

/// Training seconds and held-out PSNR.
fn train(case: &Case<'_>, scene: &Scene, steps: u64) -> Result<(f64, Option<f64>), BenchError> {
    let folder = tempfile::tempdir().map_err(BenchError::file(&std::env::temp_dir()))?;
    let request = Request {
        scene: Some("perturbed:co:synthetic:tabletop".into()),
        system: Some(case.system.into()),
        set: case.set.parse().map_err(BenchError::part)?,
        eval_appearance: Some("mean".parse().map_err(BenchError::Part)?),
        ..Request::default()
    };
    let mut watch = Watch::new(&case.name);
    let load = |_: &str, _: &DataOptions| Ok(scene.clone());
    let parts = disk_parts(&load, case.build, case.system);
    let mut run = Run::create(&folder.path().join("run"), &request, parts, &mut watch)?;
    let (ended, evaluation) =
        run.train(&Schedule::new(Stop::Steps(steps)), None, &mut watch, &AtomicBool::new(false))?;
    Ok((ended.seconds, evaluation.and_then(|e| e.psnr)))
}
