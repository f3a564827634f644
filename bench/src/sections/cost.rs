//! What a step of each system costs beside the plainest one on the same photos, in rounds in which the systems take turns.

use super::scene::{Job, Trained, forget_peak, train};
use crate::bench::{Bench, Keep, say};
use crate::claims;
use crate::error::BenchError;
use crate::measure::median;
use crate::page::{Item, Section};
use crate::table::Table;
use engine::memory::resident_bytes;
use engine::options::{DataOptions, Request};
use engine::train::{Schedule, Stop};
use scene_io::Scene;

/// A system with its settings.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    pub(super) name: &'static str,
    pub(super) system: &'static str,
    /// TOML.
    pub(super) set: &'static str,
}

/// Photos, and the systems that are trained on them: the first is what the others are compared with.
pub(super) struct Photos {
    pub(super) name: &'static str,
    /// As a user would write the scene.
    pub(super) word: &'static str,
    pub(super) scene: Scene,
    /// The appearance that held-out views are measured in, where photos differ in theirs.
    pub(super) appearance: Option<&'static str>,
    pub(super) rows: Vec<Row>,
}

/// What the page says above its table.
#[derive(Clone, Copy)]
pub(super) struct Head {
    pub(super) title: &'static str,
    pub(super) intro: &'static str,
    /// Of the column of PSNR.
    pub(super) about: &'static str,
}

/// A row, and what was measured of it.
struct Case<'a> {
    photos: &'a Photos,
    row: Row,
    seconds: Vec<f64>,
    psnr: Option<f64>,
    /// Most that the process held, MB.
    memory: Option<f64>,
}

/// Milliseconds a step of all rows.
pub(super) fn run(bench: &Bench, keep: &Keep<'_>, head: Head, photos: &[Photos]) -> Result<Section, BenchError> {
    let (rounds, steps) = bench.pick((1, 50), (3, 500));
    let steps = bench.steps.unwrap_or(steps);
    let case = |photos, row| Case { photos, row, seconds: Vec::new(), psnr: None, memory: None };
    let mut cases: Vec<Case<'_>> =
        photos.iter().flat_map(|photos| photos.rows.iter().map(move |&row| case(photos, row))).collect();
    for round in 1..=rounds {
        for case in &mut cases {
            case.measure(steps)?;
        }
        say(&format!("        round {round} of {rounds}"));
        if round < rounds {
            keep(&section(head, &cases, steps)?)?;
        }
    }
    section(head, &cases, steps)
}

impl Case<'_> {
    fn measure(&mut self, steps: u64) -> Result<(), BenchError> {
        let Row { name, system, set } = self.row;
        let appearance = self.photos.appearance.map(str::parse).transpose().map_err(BenchError::Part)?;
        let request = Request {
            scene: Some(self.photos.word.into()),
            system: Some(system.into()),
            set: set.parse().map_err(BenchError::part)?,
            eval_appearance: appearance,
            ..Request::default()
        };
        let load = |_: &str, _: &DataOptions| Ok(self.photos.scene.clone());
        let schedule = Schedule::new(Stop::Steps(steps));
        let build = &systems::registry::build;
        let has_peak = forget_peak();
        let Trained { ended, evaluation, .. } =
            train(Job { name, request: &request, load: &load, build, schedule, lpips: None }, |_| {})?;
        self.memory = resident_bytes().filter(|_| has_peak).map(|memory| memory.peak as f64 * 1e-6);
        self.seconds.push(ended.seconds);
        self.psnr = evaluation.and_then(|e| e.psnr);
        Ok(())
    }

    /// Milliseconds a step, the median of the rounds so far.
    fn ms(&self, steps: u64) -> f64 {
        1e3 * median(&mut self.seconds.clone()) / steps as f64
    }
}

fn section(head: Head, cases: &[Case<'_>], steps: u64) -> Result<Section, BenchError> {
    let mut table = Table::new(
        "cost",
        head.about,
        &["photos", "system", claims::COLUMN, "steps", "ms a step", "times the first", "memory, MB", "PSNR"],
    );
    let measured = || cases.iter().filter(|case| !case.seconds.is_empty());
    for case in measured() {
        let (photos, ms) = (case.photos.name, case.ms(steps));
        let first = measured().find(|first| first.photos.name == photos).map_or(ms, |first| first.ms(steps));
        table.row([
            photos.into(),
            case.row.name.into(),
            claims::mark(case.row.system, case.row.set),
            (steps as usize).into(),
            ms.into(),
            (ms / first).into(),
            case.memory.into(),
            Table::decibels(case.psnr),
        ])?;
    }
    let Head { title, intro, .. } = head;
    let items = [Item::Table(table)].into_iter().chain(claims::note(measured().map(|case| case.row.system)));
    Ok(Section { title, intro, items: items.collect(), goals: Vec::new() })
}
