//! A training of `splat` that is interrupted stops where its pictures have settled.

use engine::error::RunError;
use engine::log::MetricsLog;
use engine::options::{Schedule, Stop};
use engine::progress::{Progress, Reached};
use engine::system::System;
use engine::train::{Host, Occasion, Reason, Saved, train};
use std::sync::atomic::{AtomicBool, Ordering};
use tests::{system, table_data};

/// Gaussians come after steps 20, 40 and 60, and photos are shown at full size from step 30 on.
const SET: [&str; 8] = [
    "start_count=300",
    "max_splats=4000",
    "densify_from=15",
    "densify_every=20",
    "densify_until=65",
    "densify_gradient=2e-5",
    "coarse=1",
    "coarse_steps=30",
];

#[test]
fn pictures_are_unsettled_after_a_change_and_settle() {
    let (scene, train, _) = table_data(20);
    let mut system = system("splat", &scene, &train, &SET).0;
    let unsettled: Vec<u64> = (0..100)
        .map(|step| {
            system.step(&train, step).expect("a step");
            system.unsettled()
        })
        .collect();
    // Three quarters of the steps between two changes; 75 steps after photos became larger.
    assert_eq!(unsettled[..19], [0; 19]);
    assert_eq!(unsettled[19..30], [15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5]);
    assert_eq!(unsettled[30..50], std::array::from_fn::<u64, 20, _>(|k| 75 - k as u64));
}

/// Raises the flag after a step.
struct Interrupter<'f> {
    at: u64,
    flag: &'f AtomicBool,
    said: Vec<String>,
}

impl Host for Interrupter<'_> {
    fn evaluate(&mut self, _: &dyn System, _: Reached, _: Occasion) -> Result<Option<f64>, RunError> {
        Ok(None)
    }

    fn save(&mut self, _: &dyn System, _: Reached, _: Occasion) -> Result<Saved, RunError> {
        Ok(Saved::Written)
    }

    fn warn(&mut self, line: &str) {
        self.said.push(line.into());
    }

    fn tell(&mut self, line: &str) {
        panic!("{line}");
    }

    fn progress(&mut self, progress: &Progress) {
        self.flag.fetch_or(progress.step == self.at, Ordering::Relaxed);
    }
}

#[test]
fn an_interrupted_training_goes_on_until_they_have_settled() {
    let (scene, data, _) = table_data(20);
    for (at, until, lines) in [(10, 10, 0), (20, 35, 1), (25, 35, 1)] {
        // At one size: the change of step 20 alone.
        let set = [&SET[..6], &["coarse=0"]].concat();
        let mut system = system("splat", &scene, &data, &set).0;
        let folder = tempfile::tempdir().expect("a folder");
        let mut log = MetricsLog::create(&folder.path().join("metrics.csv")).expect("a log");
        let flag = AtomicBool::new(false);
        let mut host = Interrupter { at, flag: &flag, said: Vec::new() };
        let (schedule, from) = (Schedule::new(Stop::Steps(100)), Reached::default());
        let ended = train(&mut *system, &data, &schedule, from, &mut log, &mut host, &flag).expect("a training");
        assert_eq!((ended.step, ended.reason, host.said.len()), (until, Reason::Interrupted, lines), "{:?}", host.said);
    }
}
