//! Times of the kernels, with their errors.

use super::errors::{Backwards, Errors, compare};
use super::ground::{Ground, Shot};
use super::stage::{PARTS, Stage};
use super::targets::{GAUSSIANS, SECOND_CORE, TARGETS, Target, Work};
use crate::bench::{Bench, Extent};
use crate::error::BenchError;
use crate::goals::Goal;
use crate::measure::median;
use crate::page::Item;
use crate::sections::scene::Subject;
use crate::table::{Cell, Table};
use splat_core::{DrawStats, Gaussians, RasterSettings};
use std::time::Instant;

/// Pixels of the scene's photos along each axis.
const SCALES: [u32; 2] = [1, 4];

/// Tables of this part.
pub(super) struct Kernels {
    times: Table,
    work: Table,
}

impl Kernels {
    pub(super) fn new() -> Self {
        let times = Table::new(
            "kernels",
            "Mean over the cameras, median over the repetitions, milliseconds. Errors of pictures are the largest difference of a \
             colour (projection: also of a centre, pixels); of gradients, the largest distance as a share of the largest of the \
             same parameter, Gaussians with a black colour left out. Parts: from the same input as the part; wholes: from the \
             same Gaussians. The optimiser's error stands in the section on kernels.",
            &[
                "picture",
                "Gaussians",
                "kernel",
                "ms, 1 thread",
                "ms, all threads",
                "speed-up",
                "error",
                "OpenSplat, ms (measured before)",
            ],
        );
        let work = Table::new(
            "work",
            "Work of a picture, mean over the cameras. Pairs: of a Gaussian and a tile of 16x16 it lies over; hidden: behind a \
             finished tile. Pixel-steps: Gaussians composited into pixels, counted by the twin on the pixels compared. Left out of \
             the comparison: pixels where rounding may decide otherwise.",
            &[
                "picture",
                "Gaussians",
                "seen",
                "pairs",
                "hidden pairs",
                "empty tiles",
                "tiles",
                "M pixel-steps",
                "pixels compared",
                "left out, %",
            ],
        );
        Self { times, work }
    }

    pub(super) fn items(&self) -> Vec<Item> {
        [&self.times, &self.work].into_iter().filter(|t| !t.is_empty()).map(|t| Item::Table(t.clone())).collect()
    }
}

/// Something that is timed.
struct Case<'a> {
    work: Work,
    scale: u32,
    larger: bool,
    threads: usize,
    shots: &'a [Shot],
    cloud: Gaussians,
    stage: Stage,
    /// Of each repetition, a picture: parts, and the whole.
    seconds: [Vec<f64>; PARTS.len()],
    whole: Vec<f64>,
    /// Of one pass over the cameras.
    drawn: DrawStats,
    seen: usize,
}

impl Case<'_> {
    fn run(&mut self, bench: &Bench, rules: &RasterSettings) -> Result<(), BenchError> {
        let Self { work, threads, shots, cloud, stage, drawn, seen, .. } = self;
        let mut parts = [0.0; PARTS.len()];
        (*drawn, *seen) = (DrawStats::default(), 0);
        let whole = bench.pools.run(*threads, || -> Result<f64, BenchError> {
            let clock = Instant::now();
            for shot in *shots {
                let more = match work {
                    Work::Render => stage.render(cloud, shot, rules)?,
                    Work::Step => stage.step(cloud, shot, rules, &mut parts)?,
                };
                drawn.pairs += more.pairs;
                drawn.hidden += more.hidden;
                drawn.empty_tiles += more.empty_tiles;
                drawn.tiles += more.tiles;
                *seen += stage.projection.gaussians.len();
            }
            Ok(clock.elapsed().as_secs_f64())
        })?;
        let each = 1.0 / shots.len().max(1) as f64;
        self.seconds.iter_mut().zip(parts).for_each(|(all, s)| all.push(s * each));
        self.whole.push(whole * each);
        Ok(())
    }

    fn forget(&mut self) {
        self.seconds.iter_mut().for_each(Vec::clear);
        self.whole.clear();
    }

    /// Medians in milliseconds: parts, and the whole.
    fn ms(&self) -> ([f64; PARTS.len()], f64) {
        let ms = |seconds: &Vec<f64>| 1e3 * median(&mut seconds.clone());
        ([0, 1, 2, 3, 4, 5].map(|k| ms(&self.seconds[k])), ms(&self.whole))
    }
}

pub(super) fn run(
    bench: &Bench,
    subject: &Subject,
    kernels: &mut Kernels,
    goals: &mut Vec<Goal>,
) -> Result<(), BenchError> {
    let ground = Ground::new(bench, subject)?;
    let shots = SCALES.map(|scale| ground.shots(scale));
    let larger_cloud = ground.larger_cloud()?;
    let mut cases = Vec::new();
    for (&scale, shots) in SCALES.iter().zip(&shots) {
        for (work, larger) in [(Work::Step, false), (Work::Step, true), (Work::Render, false), (Work::Render, true)] {
            let cloud = if larger { &larger_cloud } else { &ground.cloud };
            for threads in bench.pools.one_and_most() {
                cases.push(Case {
                    work,
                    scale,
                    larger,
                    threads,
                    shots,
                    cloud: cloud.clone(),
                    stage: Stage::new(bench.simd, cloud),
                    seconds: Default::default(),
                    whole: Vec::new(),
                    drawn: DrawStats::default(),
                    seen: 0,
                });
            }
        }
    }
    for repetition in 0..=bench.pick(2, bench.effort.repetitions) {
        for case in &mut cases {
            case.run(bench, &ground.rules)?;
            if repetition == 0 {
                // Warm: pages, caches, threads.
                case.forget();
            }
        }
    }
    // One thread and all of them, or one alone: the last of a group has the most.
    for group in cases.chunk_by_mut(|a, b| (a.work, a.scale, a.larger) == (b.work, b.scale, b.larger)) {
        let last = group.len() - 1;
        let errors = {
            let Case { stage, cloud, shots, larger, .. } = &mut group[last];
            let Some(shot) = shots.first() else { continue };
            let backwards = if *larger { Backwards::Leave } else { Backwards::Compare };
            compare(stage, cloud, shot, &ground.rules, backwards)?
        };
        rows(bench, group, &errors, kernels, goals)?;
    }
    Ok(())
}

/// What was measured of the same work, with one thread first.
fn rows(
    bench: &Bench,
    group: &[Case<'_>],
    errors: &Errors,
    kernels: &mut Kernels,
    goals: &mut Vec<Goal>,
) -> Result<(), BenchError> {
    let (Some(one), Some(most)) = (group.first(), group.last()) else { return Ok(()) };
    let Some([w, h]) = one.shots.first().map(|s| s.view.size) else { return Ok(()) };
    let (picture, n, several) = (format!("{w}x{h}"), one.cloud.len(), group.len() > 1);
    let ((parts_one, one_ms), (parts_most, most_ms)) = (one.ms(), most.ms());
    let gradients = errors.gradients;
    let known = known(bench, most);
    let mut row = |kernel: &str, one: f64, most: f64, error: Option<f64>, peer: Option<f64>| {
        let (most, speed_up) = if several { (Some(most), Some(one / most)) } else { (None, None) };
        let (picture, error) = (picture.as_str().into(), error.into());
        kernels.times.row([
            picture,
            n.into(),
            kernel.into(),
            one.into(),
            most.into(),
            speed_up.into(),
            error,
            peer.into(),
        ])
    };
    let (error, what) = match (one.work, gradients) {
        (Work::Step, Some(g)) => {
            let of_parts =
                [Some(errors.projection), Some(errors.drawing), g.loss, Some(g.drawing), Some(g.projection), None];
            for (k, part) in PARTS.into_iter().enumerate() {
                row(part, parts_one[k], parts_most[k], of_parts[k], None)?;
            }
            (g.step, "gradients of all parameters")
        }
        _ => (errors.picture, "picture"),
    };
    row(one.work.name(), one_ms, most_ms, Some(error), known.and_then(|t| t.peer))?;
    if one.work == Work::Render {
        let each = |sum: u64| Cell::from(sum as f64 / one.shots.len() as f64);
        kernels.work.row([
            picture.as_str().into(),
            n.into(),
            each(one.seen as u64),
            each(one.drawn.pairs),
            each(one.drawn.hidden),
            each(one.drawn.empty_tiles),
            each(one.drawn.tiles),
            (errors.contributions * (w * h) as f64 * 1e-6).into(),
            errors.pixels.into(),
            (100.0 * errors.unclear).into(),
        ])?;
    }
    let work = format!("{}, {picture}, {n} Gaussians", one.work.name());
    let error = format!("{what} {error:.1e}");
    if let Some(Target { target: Some(target), peer, .. }) = known {
        goals.push(Goal {
            work: format!("{work}, {} threads", most.threads),
            unit: "a second",
            figure: 1e3 / most_ms,
            target: 1e3 / target,
            ceiling: None,
            peer: peer.map(|ms| 1e3 / ms),
            error,
        });
    }
    if several && one.work == Work::Step && most.threads == 2 {
        goals.push(Goal {
            work: format!("second core, {work}"),
            unit: "x",
            figure: one_ms / most_ms,
            target: SECOND_CORE.0,
            ceiling: Some(2.0),
            peer: Some(SECOND_CORE.1),
            error: "0: the same bits".into(),
        });
    }
    Ok(())
}

/// What is known of this work of the scene that targets are about.
fn known(bench: &Bench, case: &Case<'_>) -> Option<&'static Target> {
    let theirs = bench.extent == Extent::Full && case.cloud.len() >= GAUSSIANS;
    TARGETS.iter().find(|t| theirs && (t.work, t.scale, t.larger) == (case.work, case.scale, case.larger))
}
