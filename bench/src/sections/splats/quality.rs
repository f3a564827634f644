//! PSNR over training time, and what comes out: size, files, frames a second, memory.

use super::budget;
use super::{Found, SMALL};
use crate::bench::{Bench, say};
use crate::claims;
use crate::error::BenchError;
use crate::measure::median;
use crate::page::Item;
use crate::plot::{Plot, Series};
use crate::sections::scene::{Subject, Trained, embedded, forget_peak, train_seconds};
use crate::sections::training::{EVAL_AT, Protocol, SECONDS, plot, protocol_goals, reached, target};
use crate::table::Table;
use engine::memory::resident_bytes;
use engine::render::{plain_query, render};
use engine::system::{Splats, System};
use scene_io::{SplatOptions, encode_splats};
use std::path::Path;
use std::time::Instant;

/// Scenes with what is trained on them, side by side.
struct Entry {
    /// On the command line and of the plot.
    name: &'static str,
    /// Of the page on training.
    protocol: &'static str,
    systems: &'static [(&'static str, &'static str)],
    /// Of the first system: seconds and dB.
    targets: &'static [(f64, f64)],
}

const ENTRIES: [Entry; 4] = [
    Entry {
        name: "fox135",
        protocol: "fox135",
        systems: &[("splat", "start = \"points\"")],
        targets: &[(60.0, 25.5), (300.0, 27.0)],
    },
    Entry { name: "fox135-random", protocol: "fox135", systems: &[("splat", "start = \"random\"")], targets: &[] },
    Entry {
        name: "lego400",
        protocol: "lego400",
        systems: &[("splat", ""), ("ngp", "")],
        targets: &[(60.0, 30.0), (300.0, 33.0)],
    },
    Entry { name: "fox480", protocol: "fox480", systems: &[("splat", ""), ("ngp", "")], targets: &[] },
];

/// Error that previews may have.
const PREVIEW: f32 = 1.0 / 255.0;

pub(super) fn names() -> impl Iterator<Item = &'static str> {
    ENTRIES.iter().map(|e| e.name)
}

/// Tables and plots of this part.
pub(super) struct Quality {
    systems: Table,
    curves: Table,
    plots: Vec<Plot>,
}

impl Quality {
    pub(super) fn new() -> Self {
        let systems = Table::new(
            "systems",
            "Held-out PSNR in dB after so many training seconds, and what came out. Model: parameters, 4 bytes each; PLY and SPZ: \
             the files written of it. Frames: held-out cameras at the protocol's size, error budget 1/255. Memory: most that the \
             process held from the row's start to its last frame, images and evaluation included.",
            &[
                "protocol",
                "system",
                claims::COLUMN,
                "train / test views",
                "10 s",
                "30 s",
                "60 s",
                "120 s",
                "300 s",
                "end",
                "steps",
                "Gaussians",
                "model, MB",
                "PLY, MB",
                "SPZ, MB",
                "frames/s",
                "memory, MB",
            ],
        );
        let curves = Table::new(
            "curves",
            "Every measurement. Seconds are training seconds: from decoded images to the last step, evaluation not counted.",
            &["protocol", "system", "seconds", "steps", "PSNR, dB"],
        );
        Self { systems, curves, plots: Vec::new() }
    }

    pub(super) fn items(&self) -> Vec<Item> {
        let tables = [self.systems.clone().without_empty_columns(), self.curves.clone()];
        let tables = tables.into_iter().filter(|t| !t.is_empty()).map(Item::Table);
        let note = if self.systems.is_empty() { None } else { claims::note(["splat", "ngp"]) };
        tables.chain(self.plots.iter().cloned().map(Item::Plot)).chain(note).collect()
    }
}

/// What the kernels are measured on.
pub(super) fn fox(bench: &Bench, folder: &Path) -> Result<Option<Subject>, BenchError> {
    ENTRIES[0]
        .subject(bench, folder)?
        .map(|s| s.with_system("fox135".into(), "splat", ENTRIES[0].systems[0].1))
        .transpose()
}

impl Entry {
    fn subject(&self, bench: &Bench, folder: &Path) -> Result<Option<Subject>, BenchError> {
        match Protocol::named(self.protocol) {
            Some(protocol) => protocol.subject(bench, folder),
            None => Err(BenchError::Part(format!("no protocol is called `{}`", self.protocol))),
        }
    }
}

/// The embedded scene, a few seconds.
pub(super) fn quick(bench: &Bench, found: &mut Found) -> Result<(), BenchError> {
    let mut series = Vec::new();
    for (system, settings) in [("splat", SMALL), ("ngp", "")] {
        let subject = embedded().with_system("tabletop".into(), system, settings)?;
        let trained = train(
            bench,
            &subject,
            &Row { protocol: "tabletop", system, seconds: 2.0, eval_at: &[0.5, 1.0] },
            found,
            &mut series,
        )?;
        if system == "splat" {
            budget::run(bench, &trained, "tabletop", &mut found.budgets)?;
        }
    }
    found.quality.plots.push(plot("embedded", "Embedded scene, 64x64", series));
    Ok(())
}

pub(super) fn run(
    bench: &Bench,
    folder: &Path,
    found: &mut Found,
    keep: &dyn Fn(&Found) -> Result<(), BenchError>,
) -> Result<(), BenchError> {
    let seconds = bench.seconds.unwrap_or(SECONDS);
    for entry in ENTRIES.iter().filter(|e| bench.wants(e.name)) {
        let Some(scene) = entry.subject(bench, folder)? else {
            found.missing.push(entry.name);
            continue;
        };
        let mut series = Vec::new();
        for &(system, settings) in entry.systems {
            let subject = scene.clone().with_system(format!("{} {system}", entry.name), system, settings)?;
            let trained = train(
                bench,
                &subject,
                &Row { protocol: entry.name, system, seconds, eval_at: &EVAL_AT },
                found,
                &mut series,
            )?;
            if entry.name == "fox135" {
                budget::run(bench, &trained, entry.name, &mut found.budgets)?;
            }
            drop(trained);
            keep(found)?;
        }
        let peers = Protocol::named(entry.protocol).map_or(&[][..], |p| p.peers);
        // Those that splat, too.
        let peers: Vec<(&str, &[(f64, f64)])> = peers.iter().filter(|p| p.0.contains("Splat")).copied().collect();
        if let Some(curve) = series.first().map(|s| s.points.as_slice()) {
            found.goals.extend(protocol_goals(&format!("{}, splat,", entry.name), entry.targets, &peers, curve));
        }
        series.extend(peers.iter().map(|(name, points)| Series {
            name: format!("{name} (measured before, machine of the class)"),
            style: crate::plot::Style::Cross,
            points: points.to_vec(),
        }));
        series.extend(target(entry.targets));
        found.quality.plots.push(plot(entry.name, entry.name, series));
        keep(found)?;
    }
    Ok(())
}

/// What is trained, and when it is measured, seconds.
struct Row<'a> {
    protocol: &'a str,
    system: &'a str,
    seconds: f64,
    eval_at: &'a [f64],
}

/// Train and put down what came out.
fn train<'a>(
    bench: &Bench,
    subject: &'a Subject,
    row: &Row<'_>,
    found: &mut Found,
    series: &mut Vec<Series>,
) -> Result<Trained<'a>, BenchError> {
    let Row { protocol, system, seconds, eval_at } = *row;
    let measured = forget_peak();
    let trained = train_seconds(bench, subject, seconds, eval_at)?;
    for p in &trained.watch.curve {
        let cells = [protocol.into(), system.into(), p.seconds.into(), (p.step as usize).into(), p.psnr.into()];
        found.quality.curves.row(cells)?;
    }
    let curve: Vec<(f64, f64)> = trained.watch.curve.iter().map(|p| (p.seconds, p.psnr)).collect();
    let at = |seconds: f64| Table::decibels(reached(&curve, seconds));
    let frames = frames_per_second(bench, &trained);
    let memory = resident_bytes().filter(|_| measured).map(|r| r.peak as f64 * 1e-6);
    let made: &dyn System = trained.run.system.as_ref();
    let splats = made.splats(&trained.run.query());
    let files = splats.as_ref().map(files).transpose()?;
    found.quality.systems.row([
        protocol.into(),
        system.into(),
        claims::mark(system, ""),
        trained.views().into(),
        at(EVAL_AT[0]),
        at(EVAL_AT[1]),
        at(EVAL_AT[2]),
        at(EVAL_AT[3]),
        at(EVAL_AT[4]),
        Table::decibels(trained.evaluation.as_ref().and_then(|e| e.psnr)),
        (trained.ended.step as usize).into(),
        splats.map(|s| s.gaussians.len()).into(),
        (made.parameter_count() as f64 * 4e-6).into(),
        files.map(|f| f[0]).into(),
        files.map(|f| f[1]).into(),
        frames.into(),
        memory.into(),
    ])?;
    say(&format!("        {}: {:.1} frames/s", subject.name, frames.unwrap_or(0.0)));
    series.push(Series::line(format!("{system}, this run"), curve));
    Ok(trained)
}

/// Held-out cameras a second at the preview budget: median of three passes, after one to warm up.
fn frames_per_second(bench: &Bench, trained: &Trained<'_>) -> Option<f64> {
    let views = trained.run.held_out.views();
    let query = plain_query(trained.run.query().background, PREVIEW);
    let system: &dyn System = trained.run.system.as_ref();
    let pass = || {
        let clock = Instant::now();
        for view in views {
            std::hint::black_box(render(system, &view.camera, &query));
        }
        clock.elapsed().as_secs_f64()
    };
    bench.pools.run(bench.pools.most(), pass);
    let mut seconds = [(); 3].map(|()| bench.pools.run(bench.pools.most(), pass));
    (!views.is_empty()).then(|| views.len() as f64 / median(&mut seconds))
}

/// Sizes of the exported files, MB: PLY, SPZ.
fn files(splats: &Splats) -> Result<[f64; 2], BenchError> {
    let options = SplatOptions::default().with_widening(splats.rules.widening);
    let size = |name: &str| -> Result<f64, BenchError> {
        let (bytes, _) = encode_splats(Path::new(name), &splats.gaussians, &options).map_err(BenchError::part)?;
        Ok(bytes.len() as f64 * 1e-6)
    };
    Ok([size("cloud.ply")?, size("cloud.spz")?])
}
