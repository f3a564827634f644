//! When a training stops and what it does on the way: `schedule.json`. No part of what determines the result, but what
//! `--resume` goes on with, and what those who watch from outside read.

use crate::folder::SCHEDULE;
use crate::options::{Schedule, Stop};
use crate::output::{Storage, write_file};
use crate::progress::{Event, Observer};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::time::Duration;

/// What the file says; what is absent was not asked for.
#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(default)]
struct Said {
    #[serde(skip_serializing_if = "Option::is_none")]
    steps: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    seconds: Option<f64>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    eval_at: Vec<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    eval_every: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    checkpoint_seconds: Option<f64>,
}

/// Write down the schedule of the training that starts now. No training fails over it, but a later `--resume` would not know
/// it, so that is said.
pub(super) fn write(storage: &dyn Storage, folder: &Path, schedule: &Schedule, observer: &mut dyn Observer) {
    let (steps, seconds) = match schedule.stop {
        Stop::Steps(n) => (Some(n), None),
        Stop::Seconds(s) => (None, Some(s)),
    };
    let said = Said {
        steps,
        seconds,
        eval_at: schedule.eval_at.clone(),
        eval_every: schedule.eval_every,
        checkpoint_seconds: Some(schedule.checkpoint_every.as_secs_f64()),
    };
    let path = folder.join(SCHEDULE);
    let text = serde_json::to_vec(&said).unwrap_or_default();
    if let Err(e) = write_file(storage, &path, &text) {
        let line = format!("{e}: if this run is interrupted, give `--resume` its `--steps` or `--seconds` again");
        observer.event(Event::Warning(&line));
    }
}

/// The schedule of the last training in a run folder; `None` where nothing says when it was to stop.
#[must_use]
pub fn planned_schedule(folder: &Path) -> Option<Schedule> {
    let said: Said = serde_json::from_slice(&std::fs::read(folder.join(SCHEDULE)).ok()?).ok()?;
    let positive = |x: &f64| x.is_finite() && *x > 0.0;
    let stop = said.steps.map(Stop::Steps).or(said.seconds.filter(positive).map(Stop::Seconds))?;
    let plain = Schedule::new(stop);
    // A time too long for a clock never comes.
    let every =
        said.checkpoint_seconds.filter(positive).map(|s| Duration::try_from_secs_f64(s).unwrap_or(Duration::MAX));
    Some(Schedule {
        eval_at: said.eval_at.into_iter().filter(positive).collect(),
        eval_every: said.eval_every.filter(|n| *n > 0),
        checkpoint_every: every.unwrap_or(plain.checkpoint_every),
        ..plain
    })
}

/// When the last training in a run folder was to stop; `None` where nothing says so.
#[must_use]
pub fn planned_stop(folder: &Path) -> Option<Stop> {
    planned_schedule(folder).map(|schedule| schedule.stop)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::Disk;
    use crate::progress::Silent;

    #[test]
    fn a_schedule_is_read_as_it_was_written_and_nonsense_is_none() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(planned_stop(folder.path()), None);
        for stop in [Stop::Steps(2000), Stop::Seconds(90.5)] {
            let schedule = Schedule {
                eval_at: vec![10.0, 30.25],
                eval_every: Some(100),
                checkpoint_every: Duration::from_secs_f64(33.3),
                ..Schedule::new(stop)
            };
            write(&Disk, folder.path(), &schedule, &mut Silent);
            assert_eq!(planned_schedule(folder.path()), Some(schedule));
            write(&Disk, folder.path(), &Schedule::new(stop), &mut Silent);
            assert_eq!(planned_schedule(folder.path()), Some(Schedule::new(stop)));
            assert_eq!(planned_stop(folder.path()), Some(stop));
        }
        for nonsense in ["", "[]", "{}", r#"{"steps": "many"}"#, r#"{"seconds": -1}"#] {
            std::fs::write(folder.path().join(SCHEDULE), nonsense).unwrap();
            assert_eq!(planned_stop(folder.path()), None, "{nonsense}");
        }
    }

    #[test]
    fn a_file_that_says_the_stop_alone_is_read() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(SCHEDULE), r#"{"seconds":300.0}"#).unwrap();
        assert_eq!(planned_schedule(folder.path()), Some(Schedule::new(Stop::Seconds(300.0))));
    }

    #[test]
    fn a_checkpoint_that_never_comes_is_remembered_as_one() {
        let folder = tempfile::tempdir().unwrap();
        let never = Schedule { checkpoint_every: Duration::MAX, ..Schedule::new(Stop::Steps(3)) };
        write(&Disk, folder.path(), &never, &mut Silent);
        assert_eq!(planned_schedule(folder.path()), Some(never));
    }

    #[test]
    fn what_cannot_be_written_is_said() {
        struct Heard(Vec<String>);
        impl Observer for Heard {
            fn event(&mut self, event: Event<'_>) {
                if let Event::Warning(line) = event {
                    self.0.push(line.into());
                }
            }
        }
        let mut heard = Heard(Vec::new());
        write(&Disk, Path::new("/nowhere/at/all"), &Schedule::new(Stop::Steps(1)), &mut heard);
        assert!(heard.0.len() == 1 && heard.0[0].contains("schedule.json"), "{:?}", heard.0);
    }
}
