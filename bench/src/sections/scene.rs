//! Trainings in a folder of their own that goes away with them.

use super::{Bench, Extent, say};
use crate::error::BenchError;
use scene_io::Scene;
use scene_io::synthetic::{TabletopOptions, tabletop};
use std::path::Path;
use std::sync::atomic::AtomicBool;
use systems::options::{DataOptions, Request};
use systems::progress::{Event, Observer};
use systems::run::{Parts, Run, disk_parts};
use systems::train::{Schedule, Stop};
use tempfile::TempDir;

/// What is trained.
#[derive(Clone, Debug)]
pub(crate) struct Subject {
    pub(crate) name: String,
    pub(crate) request: Request,
}

/// The embedded scene.
pub(crate) fn embedded() -> Subject {
    let scene = format!("{}tabletop", systems::source::SYNTHETIC);
    Subject { name: "tabletop".into(), request: Request { scene: Some(scene), ..Request::default() } }
}

/// A run and the folder it lives in.
pub(crate) struct Trained {
    pub(crate) run: Run<'static>,
    /// The curve: steps, training seconds, held-out PSNR.
    pub(crate) curve: Vec<(u64, f64, f64)>,
    /// Median samples a second, where steps were seen.
    pub(crate) samples_per_s: Option<f64>,
    _folder: TempDir,
}

/// Train for so many seconds, the held-out views measured at `eval_at` and at the end.
pub(crate) fn train(bench: &Bench, subject: &Subject, seconds: f64, eval_at: &[f64]) -> Result<Trained, BenchError> {
    let folder = tempfile::tempdir().map_err(BenchError::file(&std::env::temp_dir()))?;
    let mut watch = Watch::new(&subject.name);
    let run_folder = folder.path().join("run");
    let mut run = Run::create(&run_folder, &subject.request, parts(bench, subject), &mut watch)?;
    let schedule = Schedule { eval_at: eval_at.to_vec(), ..Schedule::new(Stop::Seconds(seconds)) };
    run.train(&schedule, None, &mut watch, &AtomicBool::new(false))?;
    let Watch { curve, mut rates, .. } = watch;
    let samples_per_s = (!rates.is_empty()).then(|| crate::measure::median(&mut rates));
    Ok(Trained { run, curve, samples_per_s, _folder: folder })
}

/// Files and embedded scenes as everywhere; in quick runs the embedded scene is small.
fn parts(bench: &Bench, subject: &Subject) -> Parts<'static> {
    let small = subject.request.scene.as_deref().is_some_and(|s| s.starts_with(systems::source::SYNTHETIC))
        && bench.extent == Extent::Quick;
    disk_parts(if small { &|_, _| Ok(small_tabletop()) } else { &systems::source::load }, &systems::plan::build, "ngp")
}

/// The embedded scene, small.
pub(super) fn small_tabletop() -> Scene {
    tabletop(&TabletopOptions { width: 64, height: 64, train: 24, test: 4, rays: 2, ..TabletopOptions::default() })
}

/// A dataset's request, `None` where its folder is not there: said loudly.
pub(crate) fn dataset(bench: &Bench, name: &str, path: &str, data: DataOptions) -> Option<Subject> {
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

/// Keeps the curve, says now and then where things stand.
pub(super) struct Watch<'a> {
    name: &'a str,
    curve: Vec<(u64, f64, f64)>,
    rates: Vec<f64>,
    said: f64,
}

impl<'a> Watch<'a> {
    pub(super) fn new(name: &'a str) -> Self {
        Self { name, curve: Vec::new(), rates: Vec::new(), said: 0.0 }
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
                if p.seconds >= self.said + LINE_EVERY {
                    self.said = p.seconds;
                    say(&format!("        {}: {:.0} s, step {}", self.name, p.seconds, p.step));
                }
            }
            Event::Evaluated { step, seconds, psnr: Some(psnr) } => {
                say(&format!("        {}: {seconds:.1} s, step {step}, held-out PSNR {psnr:.2} dB", self.name));
                self.curve.push((step, seconds, psnr));
            }
            _ => {}
        }
    }
}
