//! Trainings in a folder of their own that goes away with them.

use crate::bench::{Bench, Extent, say};
use crate::error::BenchError;
use crate::measure::median;
use engine::eval::Evaluation;
use engine::options::{DataOptions, Request};
use engine::progress::{Event, Observer};
use engine::run::{Build, DefaultSystem, Load, Run, disk_parts};
use engine::train::{Ended, Schedule, Stop};
use losses::metrics::Lpips;
use scene_io::Scene;
use scene_io::synthetic::{TabletopOptions, tabletop};
use std::path::Path;
use std::sync::atomic::AtomicBool;
use tempfile::TempDir;

/// What is trained.
#[derive(Clone, Debug)]
pub(crate) struct Subject {
    pub(crate) name: String,
    pub(crate) request: Request,
}

impl Subject {
    /// The same with another system, under a name of its own; settings as `key = value` lines.
    pub(crate) fn with_system(self, name: String, system: &str, settings: &str) -> Result<Self, BenchError> {
        let set = settings.parse().map_err(BenchError::part)?;
        Ok(Self { name, request: Request { system: Some(system.into()), set, ..self.request } })
    }
}

/// The embedded scene.
pub(crate) fn embedded() -> Subject {
    let scene = format!("{}tabletop", engine::source::SYNTHETIC);
    Subject { name: "tabletop".into(), request: Request { scene: Some(scene), ..Request::default() } }
}

/// How a subject is trained.
#[derive(Clone)]
pub(crate) struct Job<'a> {
    /// In lines of progress.
    pub(crate) name: &'a str,
    pub(crate) request: &'a Request,
    pub(crate) load: &'a Load<'a>,
    pub(crate) build: &'a Build<'a>,
    pub(crate) schedule: Schedule,
    pub(crate) lpips: Option<&'a Lpips>,
}

/// A finished run and the folder it lives in.
pub(crate) struct Trained<'a> {
    pub(crate) run: Run<'a>,
    pub(crate) ended: Ended,
    /// Held-out views at the end, where there are any.
    pub(crate) evaluation: Option<Evaluation>,
    pub(crate) watch: Watch<'a>,
    pub(crate) folder: TempDir,
}

impl Trained<'_> {
    /// Training and held-out views.
    pub(crate) fn views(&self) -> String {
        format!("{} / {}", self.run.train.len(), self.run.held_out.len())
    }

    /// Milliseconds a step.
    pub(crate) fn ms_per_step(&self) -> f64 {
        1e3 * self.ended.seconds / self.ended.step.max(1) as f64
    }
}

/// Train; `prepare` sees the run before its first step. Schedules end where the training does, for how fast this machine is, as `train`
/// of the apps plans them.
pub(crate) fn train<'a>(job: Job<'a>, prepare: impl FnOnce(&mut Run<'a>)) -> Result<Trained<'a>, BenchError> {
    let (schedule, lpips) = (job.schedule.clone(), job.lpips);
    let speed = matches!(schedule.stop, Stop::Seconds(_)).then(systems::plan::machine_speed);
    let request = Request { stop: Some(schedule.stop), speed, ..job.request.clone() };
    let (mut run, mut watch, folder) = begin_as(&job, &request)?;
    prepare(&mut run);
    let (ended, evaluation) = run.train(&schedule, lpips, &mut watch, &AtomicBool::new(false))?;
    Ok(Trained { run, ended, evaluation, watch, folder })
}

/// A run before its first step, which nothing is planned to end.
pub(crate) fn begin<'a>(job: Job<'a>) -> Result<(Run<'a>, Watch<'a>, TempDir), BenchError> {
    begin_as(&job, job.request)
}

/// A job by a request that differs from its own in what is known of its end.
fn begin_as<'a>(job: &Job<'a>, request: &Request) -> Result<(Run<'a>, Watch<'a>, TempDir), BenchError> {
    let folder = tempfile::tempdir().map_err(BenchError::file(&std::env::temp_dir()))?;
    let mut watch = Watch::new(job.name);
    let parts = disk_parts(job.load, job.build, DefaultSystem::Named("ngp"));
    let run = Run::create(&folder.path().join("run"), request, parts, &mut watch)?;
    Ok((run, watch, folder))
}

/// Train a subject of the static systems for so many seconds, the held-out views measured at `eval_at` and at the end.
pub(crate) fn train_seconds<'a>(
    bench: &Bench,
    subject: &'a Subject,
    seconds: f64,
    eval_at: &[f64],
) -> Result<Trained<'a>, BenchError> {
    let schedule = Schedule { eval_at: eval_at.to_vec(), ..Schedule::new(Stop::Seconds(seconds)) };
    train(job(bench, subject, schedule), |_| {})
}

/// How a subject of the static systems is trained.
pub(crate) fn job<'a>(bench: &Bench, subject: &'a Subject, schedule: Schedule) -> Job<'a> {
    // In quick runs the embedded scene is small.
    let small = subject.request.scene.as_deref().is_some_and(|s| s.starts_with(engine::source::SYNTHETIC))
        && bench.extent == Extent::Quick;
    let load: &Load<'static> = if small { &|_, _| Ok(small_tabletop()) } else { &engine::source::load };
    let Subject { name, request } = subject;
    Job { name, request, load, build: &systems::registry::build, schedule, lpips: None }
}

/// Let the peak of the process's memory begin anew; whether the system does that (Linux).
pub(crate) fn forget_peak() -> bool {
    std::fs::write("/proc/self/clear_refs", "5").is_ok()
}

/// The embedded scene, small.
pub(super) fn small_tabletop() -> Scene {
    tabletop(&TabletopOptions { width: 64, height: 64, train: 24, test: 4, rays: 2, ..TabletopOptions::default() })
}

/// A dataset's request, `None` where its folder is not there: said loudly.
pub(crate) fn dataset(bench: &Bench, name: &str, path: &str, data: DataOptions) -> Option<Subject> {
    let data = DataOptions { validation: bench.validation.clone(), ..data };
    let Some(folder) = &bench.data else {
        say(&format!("SKIPPED: {name}: no folder of datasets: give `--data DIR` or WILDFIELD_DATA"));
        return None;
    };
    let scene = folder.join(path);
    if !scene.exists() {
        say(&format!("SKIPPED: {name}: no `{}`", scene.display()));
        return None;
    }
    let scene = std::path::absolute(&scene).unwrap_or(scene);
    let request = Request { scene: Some(scene.display().to_string()), data, ..Request::default() };
    Some(Subject { name: name.into(), request })
}

/// Held-out views of a protocol as the file that `names:` wants.
pub(crate) fn names_file(folder: &Path, names: &[String]) -> Result<String, BenchError> {
    let file = folder.join("held_out.txt");
    std::fs::write(&file, names.join("\n") + "\n").map_err(BenchError::file(&file))?;
    Ok(format!("names:{}", file.display()))
}

/// A measurement of the held-out views during training.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Point {
    pub(crate) step: u64,
    /// Of training.
    pub(crate) seconds: f64,
    /// dB.
    pub(crate) psnr: f64,
}

/// Keeps the curve, says now and then where things stand.
pub(crate) struct Watch<'a> {
    name: &'a str,
    pub(crate) curve: Vec<Point>,
    /// Samples a second, each that was seen.
    rates: Vec<f64>,
    rays: Rays,
    said: f64,
}

/// Rays so far: the loop tells a rate now and then, that of the time since it told one before.
#[derive(Clone, Copy, Debug, Default)]
struct Rays {
    rate: Option<f64>,
    sum: f64,
    until: f64,
}

impl Rays {
    fn see(&mut self, rate: Option<f64>, seconds: f64) {
        if let Some(now) = rate.filter(|_| rate != self.rate) {
            self.sum += now * (seconds - self.until);
            (self.rate, self.until) = (rate, seconds);
        }
    }

    fn per_second(&self) -> Option<f64> {
        (self.until > 0.0).then(|| self.sum / self.until)
    }
}

impl<'a> Watch<'a> {
    fn new(name: &'a str) -> Self {
        Self { name, curve: Vec::new(), rates: Vec::new(), rays: Rays::default(), said: 0.0 }
    }

    /// Median samples a second, where a rate was told.
    pub(crate) fn samples_per_s(&self) -> Option<f64> {
        (!self.rates.is_empty()).then(|| median(&mut self.rates.clone()))
    }

    /// Mean rays a second of the training, where a rate was told.
    pub(crate) fn rays_per_s(&self) -> Option<f64> {
        self.rays.per_second()
    }
}

/// Training seconds between two lines.
const LINE_EVERY: f64 = 30.0;

impl Observer for Watch<'_> {
    fn event(&mut self, event: Event<'_>) {
        match event {
            Event::Warning(text) => say(&format!("warning: {}: {text}", self.name)),
            Event::Step(p) => {
                if let Some(rate) = p.samples_per_s
                    && self.rates.last() != Some(&rate)
                {
                    self.rates.push(rate);
                }
                self.rays.see(p.rays_per_s, p.seconds);
                if p.seconds >= self.said + LINE_EVERY {
                    self.said = p.seconds;
                    say(&format!("        {}: {:.0} s, step {}", self.name, p.seconds, p.step));
                }
            }
            Event::Evaluated { step, seconds, psnr: Some(psnr) } => {
                say(&format!("        {}: {seconds:.1} s, step {step}, held-out PSNR {psnr:.2} dB", self.name));
                self.curve.push(Point { step, seconds, psnr });
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_are_counted_from_the_rates_that_are_told() {
        let mut rays = Rays::default();
        assert_eq!(rays.per_second(), None);
        for (rate, seconds) in [(None, 0.5), (Some(100.0), 1.0), (Some(100.0), 2.5), (Some(400.0), 4.0)] {
            rays.see(rate, seconds);
        }
        assert_eq!(rays.per_second(), Some((100.0 + 400.0 * 3.0) / 4.0));
    }
}
