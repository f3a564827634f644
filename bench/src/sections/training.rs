//! PSNR of held-out views over training time.

use super::scene::{Subject, dataset, embedded, names_file, train_seconds};
use crate::bench::{Bench, Extent, Keep};
use crate::error::BenchError;
use crate::goals::Goal;
use crate::page::{Item, Section};
use crate::plot::{Axis, Plot, Scale, Series, Style};
use crate::table::Table;
use engine::options::DataOptions;
use std::path::Path;

/// A scene, its settings, and what others and the plan expect of it.
pub(super) struct Protocol {
    pub(super) name: &'static str,
    /// In the folder of datasets.
    path: &'static str,
    longest_side: Option<u32>,
    holdout: Held,
    /// Seconds and dB.
    pub(super) targets: &'static [(f64, f64)],
    /// Other programs, seconds and dB, measured before on a machine of the class.
    pub(super) peers: &'static [(&'static str, &'static [(f64, f64)])],
    /// Name of its plot.
    plot: &'static str,
}

/// Which views are held out.
#[derive(Clone, Copy)]
pub(super) enum Held {
    /// The dataset's own.
    Own,
    /// Every so many of all, by name.
    Every(u32),
    /// The same, from a later one on, counted from 0.
    EveryFrom(u32, u32),
    /// Every 24th of the dataset's test views, eight in all.
    EightOfTest,
}

impl Held {
    /// The word on the command line, if one is needed; names go to a file in `folder`.
    pub(super) fn word(self, folder: &Path) -> Result<Option<String>, BenchError> {
        Ok(match self {
            Self::Own => None,
            Self::Every(n) => Some(format!("every:{n}")),
            Self::EveryFrom(n, first) => Some(format!("every:{n}+{first}")),
            Self::EightOfTest => {
                let names: Vec<String> = (0..8).map(|i| format!("test/r_{}", 24 * i)).collect();
                Some(names_file(folder, &names)?)
            }
        })
    }
}

const PROTOCOLS: [Protocol; 5] = [
    Protocol {
        name: "lego100",
        path: "nerf_synthetic/lego",
        longest_side: Some(100),
        holdout: Held::EightOfTest,
        targets: &[(60.0, 31.0), (300.0, 34.0)],
        peers: &[
            ("TensoRF VM (torch)", &[(60.0, 24.5), (300.0, 30.1)]),
            ("nerf-pytorch, light", &[(60.0, 19.5), (300.0, 22.0)]),
            ("HashNeRF-pytorch, light", &[(60.0, 18.4), (300.0, 22.5)]),
        ],
        plot: "lego100",
    },
    Protocol {
        name: "lego400",
        path: "nerf_synthetic/lego",
        longest_side: None,
        holdout: Held::Own,
        targets: &[(60.0, 28.5), (300.0, 32.0)],
        peers: &[],
        plot: "lego400",
    },
    Protocol {
        name: "fox135",
        path: "benchmarks/fox135",
        longest_side: None,
        holdout: Held::Every(8),
        targets: &[(60.0, 25.5), (300.0, 27.0)],
        peers: &[
            ("OpenSplat 1.1.5 (CPU)", &[(60.0, 23.2), (300.0, 25.2)]),
            ("HashNeRF-pytorch, light", &[(300.0, 21.6)]),
            ("nerf-pytorch, light", &[(300.0, 21.4)]),
        ],
        plot: "fox135",
    },
    Protocol {
        name: "fox480",
        path: "instant_ngp/fox",
        longest_side: Some(480),
        holdout: Held::Every(8),
        targets: &[],
        peers: &[],
        plot: "fox480",
    },
    Protocol {
        name: "fern",
        path: "nerf_llff_data/fern",
        longest_side: None,
        holdout: Held::Own,
        targets: &[],
        peers: &[],
        plot: "fern",
    },
];

/// Training seconds of a protocol where nothing is said.
pub(super) const SECONDS: f64 = 300.0;
/// Where curves of the protocols are measured, seconds.
pub(super) const EVAL_AT: [f64; 5] = [10.0, 30.0, 60.0, 120.0, 300.0];

impl Protocol {
    /// The one of this name.
    pub(super) fn named(name: &str) -> Option<&'static Self> {
        PROTOCOLS.iter().find(|p| p.name == name)
    }

    /// What is trained, `None` where the dataset is not there; names of held-out views go to `folder`.
    pub(super) fn subject(&self, bench: &Bench, folder: &Path) -> Result<Option<Subject>, BenchError> {
        let holdout = self.holdout.word(folder)?;
        let data = DataOptions { longest_side: self.longest_side, holdout, ..DataOptions::default() };
        Ok(dataset(bench, self.name, self.path, data))
    }

    /// What was measured before and what is aimed at, for a plot.
    fn known(&self) -> Vec<Series> {
        let peer = |(name, points): &(&str, &[(f64, f64)])| Series {
            name: format!("{name} (measured before, machine of the class)"),
            style: Style::Cross,
            points: points.to_vec(),
        };
        self.peers.iter().map(peer).chain(target(self.targets)).collect()
    }
}

/// Targets for a plot, where there are any.
pub(super) fn target(targets: &[(f64, f64)]) -> Option<Series> {
    let points = targets.to_vec();
    (!points.is_empty()).then(|| Series { name: "target".into(), style: Style::Dashed, points })
}

/// What `--protocol` may name.
pub(super) fn names() -> impl Iterator<Item = &'static str> {
    PROTOCOLS.iter().map(|p| p.name)
}

pub(crate) fn run(bench: &Bench, keep: &Keep<'_>) -> Result<Section, BenchError> {
    let mut table = Table::new(
        "curves",
        "Seconds are training seconds: from decoded images to the last step, evaluation not counted.",
        &["protocol", "train / test views", "seconds", "steps", "PSNR, dB", "M samples/s (median)"],
    );
    let (mut plots, mut goals, mut missing) = (Vec::new(), Vec::new(), Vec::new());
    if bench.extent == Extent::Quick {
        let (seconds, eval_at) = (6.0, [1.0, 2.0, 4.0]);
        let curve = one(bench, &embedded(), seconds, &eval_at, &mut table)?;
        plots.push(plot("embedded", "Embedded scene, 64x64", vec![Series::line("ngp, this run", curve)]));
        return Ok(section(&table, &plots, goals, &missing));
    }
    let folder = tempfile::tempdir().map_err(BenchError::file(&std::env::temp_dir()))?;
    for protocol in PROTOCOLS.iter().filter(|p| bench.wants(p.name)) {
        let Some(subject) = protocol.subject(bench, folder.path())? else {
            missing.push(protocol.name);
            continue;
        };
        let curve = one(bench, &subject, bench.seconds.unwrap_or(SECONDS), &EVAL_AT, &mut table)?;
        goals.extend(protocol_goals(protocol.name, protocol.targets, protocol.peers, &curve));
        let mut series = vec![Series::line("ngp, this run", curve)];
        series.extend(protocol.known());
        plots.push(plot(protocol.plot, protocol.name, series));
        keep(&section(&table, &plots, goals.clone(), &missing))?;
    }
    Ok(section(&table, &plots, goals, &missing))
}

fn section(table: &Table, plots: &[Plot], goals: Vec<Goal>, missing: &[&str]) -> Section {
    let mut items = vec![Item::Table(table.clone())];
    items.extend(not_run(missing));
    items.extend(plots.iter().cloned().map(Item::Plot));
    Section {
        title: "Training",
        intro: "Held-out PSNR over training time, settings as planned from the scene, nothing set by hand. The time is the \
                wall time of one run, so the figures wander with the machine; the error is the PSNR itself.",
        items,
        goals,
    }
}

/// Which datasets were looked for in vain.
pub(super) fn not_run(missing: &[&str]) -> Option<Item> {
    let mut missing = missing.to_vec();
    missing.dedup();
    (!missing.is_empty())
        .then(|| Item::Text(format!("**Not run**, their datasets are not there: {}.", missing.join(", "))))
}

/// Train, and put the curve into the table.
fn one(
    bench: &Bench,
    subject: &Subject,
    seconds: f64,
    eval_at: &[f64],
    table: &mut Table,
) -> Result<Vec<(f64, f64)>, BenchError> {
    let trained = train_seconds(bench, subject, seconds, eval_at)?;
    let (views, rate) = (trained.views(), trained.watch.samples_per_s().map(|s| s * 1e-6));
    let curve = &trained.watch.curve;
    for p in curve {
        let (name, steps) = (subject.name.as_str(), p.step as usize);
        table.row([name.into(), views.as_str().into(), p.seconds.into(), steps.into(), p.psnr.into(), rate.into()])?;
    }
    Ok(curve.iter().map(|p| (p.seconds, p.psnr)).collect())
}

/// Each target that the run came to, with the first measurement from its time on.
pub(super) fn protocol_goals(
    name: &str,
    targets: &[(f64, f64)],
    peers: &[(&str, &[(f64, f64)])],
    curve: &[(f64, f64)],
) -> Vec<Goal> {
    let best_peer = |at: f64| {
        let of_all = peers.iter().flat_map(|(_, points)| points.iter());
        of_all.filter(|p| p.0 == at).map(|p| p.1).reduce(f64::max)
    };
    let goal = |&(at, target): &(f64, f64)| {
        Some(Goal {
            work: format!("{name} after {at} s"),
            unit: "dB",
            figure: reached(curve, at)?,
            target,
            ceiling: None,
            peer: best_peer(at),
            error: "the figure is one".into(),
        })
    };
    targets.iter().filter_map(goal).collect()
}

/// The first measurement from a time on.
pub(super) fn reached(curve: &[(f64, f64)], at: f64) -> Option<f64> {
    curve.iter().find(|(s, _)| *s >= at).map(|p| p.1)
}

pub(super) fn plot(name: &'static str, title: &str, series: Vec<Series>) -> Plot {
    Plot {
        name,
        title: format!("{title}: held-out PSNR over training time"),
        x: Axis { label: "training seconds", scale: Scale::Log },
        y: Axis { label: "PSNR, dB", scale: Scale::Linear },
        series,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_take_the_first_measurement_from_their_time_on() {
        let lego = |curve: &[(f64, f64)]| {
            let protocol = Protocol::named("lego100").unwrap();
            protocol_goals(protocol.name, protocol.targets, protocol.peers, curve)
        };
        let goals = lego(&[(30.0, 29.0), (60.01, 31.5), (300.2, 33.0)]);
        assert_eq!(goals.iter().map(|g| (g.figure, g.target)).collect::<Vec<_>>(), [(31.5, 31.0), (33.0, 34.0)]);
        assert_eq!(goals[0].peer, Some(24.5));
        assert_eq!(lego(&[(30.0, 29.0)]).len(), 0, "no measurement, no claim");
    }
}
