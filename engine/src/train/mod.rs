//! The training loop, once for all systems: steps, evaluation, checkpoints, progress.
//!
//! The clock counts the time inside [`System::step`] alone; evaluation, checkpoints and logging stand outside it. What a
//! step computes never depends on the clock, so a run is the same bits wherever it is stopped and resumed.

mod watch;

use crate::data::Dataset;
use crate::error::RunError;
use crate::log::{MetricsLog, Row};
use crate::memory::resident_bytes;
pub use crate::options::{Schedule, Stop};
use crate::progress::{Progress, Reached};
use crate::system::{StepStats, System};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use watch::TransientWatch;

/// Wall time between two tries to write a checkpoint midway.
const RETRY: Duration = Duration::from_secs(5);

/// How long a training that is interrupted goes on at most until its pictures have settled.
const SETTLING: Duration = Duration::from_secs(5);

/// What became of a checkpoint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Saved {
    /// It is on the disk.
    Written,
    /// It is in memory only: to be tried again soon.
    Later,
}

/// When the held-out views are measured, or a checkpoint is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Occasion {
    /// For the curve; in case the process ends.
    Midway,
    /// The result.
    End,
}

/// What the loop asks of the run around it.
pub trait Host {
    /// Measure the held-out views as the system is `at` this step: mean PSNR in dB, or `None` where there are none.
    ///
    /// # Errors
    /// Stops the run.
    fn evaluate(&mut self, system: &dyn System, at: Reached, occasion: Occasion) -> Result<Option<f64>, RunError>;

    /// Write a checkpoint of the system as it is `at` this step. Midway it may come later, at the end it must be written.
    ///
    /// # Errors
    /// Stops the run.
    fn save(&mut self, system: &dyn System, at: Reached, occasion: Occasion) -> Result<Saved, RunError>;

    /// Tell people what they should act on.
    fn warn(&mut self, line: &str);

    /// Tell people what they want to know.
    fn tell(&mut self, line: &str);

    /// Take note of where the run stands; called after every step.
    fn progress(&mut self, progress: &Progress);
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ended {
    /// Steps done.
    pub step: u64,
    /// Training seconds.
    pub seconds: f64,
    /// Held-out PSNR at the end, dB.
    pub psnr_test: Option<f64>,
    /// Why.
    pub reason: Reason,
}

/// Why a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reason {
    /// It is finished.
    Finished,
    /// It was asked to stop; the checkpoint is written.
    Interrupted,
}

/// Sums since the last row.
#[derive(Clone, Copy, Debug, Default)]
struct Window {
    steps: u64,
    seconds: f64,
    loss: f64,
    mse: f64,
    rays: u64,
    samples: u64,
}

impl Window {
    fn add(&mut self, stats: &StepStats, seconds: f64) {
        self.steps += 1;
        self.seconds += seconds;
        self.loss += stats.loss;
        self.mse += stats.mse;
        self.rays += stats.rays;
        self.samples += stats.samples;
    }

    fn row(&self, step: u64, seconds: f64) -> Row {
        let mean = |sum: f64| (self.steps > 0).then(|| sum / self.steps as f64);
        let rate = |count: u64| (self.seconds > 0.0).then(|| count as f64 / self.seconds);
        Row {
            step,
            seconds,
            loss: mean(self.loss),
            psnr_train: mean(self.mse).map(psnr_of_mse),
            psnr_test: None,
            rays_per_s: rate(self.rays),
            samples_per_s: rate(self.samples),
            memory_mb: resident_bytes().map(|m| m.now as f64 / 1e6),
        }
    }
}

/// `-10 log10(mse)`, dB; at most 120 so that a perfect batch stays a number.
fn psnr_of_mse(mse: f64) -> f64 {
    (-10.0 * mse.log10()).min(120.0)
}

/// Speed of recent steps: a mean that forgets with the time constant [`Pace::MEMORY`].
#[derive(Clone, Copy, Debug, Default)]
struct Pace {
    steps: f64,
    seconds: f64,
}

impl Pace {
    /// Training seconds.
    const MEMORY: f64 = 10.0;

    fn add(&mut self, seconds: f64) {
        let keep = (-seconds / Self::MEMORY).exp();
        self.steps = self.steps * keep + 1.0;
        self.seconds = self.seconds * keep + seconds;
    }

    fn seconds_per_step(&self) -> Option<f64> {
        (self.steps > 0.0).then(|| self.seconds / self.steps)
    }
}

/// The last steps of a training that was interrupted.
#[derive(Clone, Copy, Debug, Default)]
struct Settling {
    /// The step at which it is over, and when it began.
    until: Option<(u64, Instant)>,
}

impl Settling {
    /// Whether nothing is left to be done before the stop. What is left is said once.
    fn is_over(&mut self, step: u64, system: &dyn System, host: &mut dyn Host) -> bool {
        let (until, begun) = *self.until.get_or_insert_with(|| {
            let left = system.unsettled();
            if left > 0 {
                host.warn(&format!(
                    "interrupted: {left} more steps, {} s at most, until pictures have settled",
                    SETTLING.as_secs()
                ));
            }
            (step + left, Instant::now())
        });
        step >= until || begun.elapsed() >= SETTLING
    }
}

/// How many times a training that stops after seconds tells its system how much of the time has passed.
const MARKS: f64 = 32.0;

/// Train `system` on `data` from where it is until the schedule stops it or `interrupt` is raised.
///
/// At the end a checkpoint is written and, unless interrupted, the held-out views are measured. A run that starts where
/// it should stop does no step.
///
/// # Errors
/// Whatever a step, an evaluation or the last checkpoint fails with; earlier checkpoints stay. A row that cannot be written is one
/// warning, and stays in `log`.
pub fn train(
    system: &mut dyn System,
    data: &Dataset,
    schedule: &Schedule,
    from: Reached,
    log: &mut MetricsLog,
    host: &mut dyn Host,
    interrupt: &AtomicBool,
) -> Result<Ended, RunError> {
    let Reached { mut step, mut seconds } = from;
    let start = step;
    let mut eval_at: Vec<f64> = schedule.eval_at.iter().copied().filter(|&at| at > seconds).collect();
    eval_at.sort_by(|a, b| b.total_cmp(a));
    let (mut window, mut pace, mut watch) = (Window::default(), Pace::default(), TransientWatch::default());
    let (mut saved_at, mut save_after) = (Instant::now(), schedule.checkpoint_every);
    let mut logged = true;
    let mut latest = Progress { step, seconds, ..Progress::default() };
    let mut settling = Settling::default();
    let reason = loop {
        if schedule.stop.reached(step, seconds) {
            break Reason::Finished;
        }
        if interrupt.load(Ordering::Relaxed) && settling.is_over(step, system, host) {
            break Reason::Interrupted;
        }
        let clock = Instant::now();
        let stats = system.step(data, step)?;
        let took = clock.elapsed().as_secs_f64();
        step += 1;
        if let Stop::Seconds(s) = schedule.stop {
            let mark = |seconds: f64| (MARKS * seconds / s) as u64;
            if mark(seconds + took) > mark(seconds) {
                system.keep_up(step, (seconds + took) / s);
            }
        }
        seconds += took;
        window.add(&stats, took);
        pace.add(took);

        latest.step = step;
        latest.seconds = seconds;
        latest.done = match schedule.stop {
            Stop::Steps(n) => step as f64 / n.max(1) as f64,
            Stop::Seconds(s) => (seconds / s).min(1.0),
        };
        latest.eta_seconds = match schedule.stop {
            Stop::Steps(n) => pace.seconds_per_step().map(|pace| pace * n.saturating_sub(step) as f64),
            Stop::Seconds(s) => Some((s - seconds).max(0.0)),
        };

        system.news().iter().for_each(|line| host.tell(line));
        watch.see(stats.transient, step, latest.done).iter().for_each(|line| host.warn(line));
        let mut evaluate = schedule.eval_every.is_some_and(|every| every > 0 && step.is_multiple_of(every));
        while eval_at.last().is_some_and(|&at| seconds >= at) {
            eval_at.pop();
            evaluate = true;
        }
        // The end is measured below, once.
        evaluate &= !schedule.stop.reached(step, seconds);
        if evaluate || window.seconds >= schedule.row_every {
            let mut row = window.row(step, seconds);
            if evaluate {
                row.psnr_test = host.evaluate(system, Reached { step, seconds }, Occasion::Midway)?;
                latest.psnr_test = row.psnr_test;
            }
            note(log.write(&row), &mut logged, host);
            latest.loss = row.loss;
            latest.psnr_train = row.psnr_train;
            latest.rays_per_s = row.rays_per_s;
            latest.samples_per_s = row.samples_per_s;
            latest.memory_mb = row.memory_mb;
            window = Window::default();
        }
        host.progress(&latest);
        if saved_at.elapsed() >= save_after {
            save_after = match host.save(system, Reached { step, seconds }, Occasion::Midway)? {
                Saved::Written => schedule.checkpoint_every,
                Saved::Later => RETRY,
            };
            saved_at = Instant::now();
        }
    };
    // A run that was interrupted before its first step can be resumed, too.
    if step > start || (step == 0 && reason == Reason::Interrupted) {
        let _ = host.save(system, Reached { step, seconds }, Occasion::End)?;
    }
    let mut psnr_test = None;
    if reason == Reason::Finished {
        psnr_test = host.evaluate(system, Reached { step, seconds }, Occasion::End)?;
    }
    if step > start {
        note(log.write(&Row { psnr_test, ..window.row(step, seconds) }), &mut logged, host);
    } else if let Some(psnr) = psnr_test {
        note(log.measured(Reached { step, seconds }, psnr), &mut logged, host);
    }
    latest.psnr_test = psnr_test.or(latest.psnr_test);
    host.progress(&latest);
    Ok(Ended { step, seconds, psnr_test, reason })
}

/// Say once that rows cannot be written. No training ends over its curve.
fn note(written: Result<(), RunError>, was_well: &mut bool, host: &mut dyn Host) {
    match written {
        Err(error) if *was_well => {
            host.warn(&format!("{}: rows are kept in memory until they can be written", error.with_reason()));
            *was_well = false;
        }
        Err(_) => {}
        Ok(()) => *was_well = true,
    }
}
