//! Scenes that move: what does each system see of things that move, of things that do not, and of what was hidden, and how
//! soon?

mod ablations;
mod aims;
mod empty;
mod entry;
mod film;
mod measured;
mod protocols;

use super::training::not_run;
use crate::bench::{Bench, Extent, Keep, QUICK};
use crate::claims;
use crate::error::BenchError;
use crate::goals::Goal;
use crate::page::{Item, Section};
use crate::plot::{Axis, Plot, Scale, Series};
use crate::table::{Cell, Table};
use aims::goal;
use engine::train::Stop;
use entry::Entry;
use measured::{EVAL_AT, Measured, measure, request, weights};
use protocols::{Group, MOUTH, NR, ORBIT, ORBIT_EXACT, ORBIT_MADE, TISSUE, WALK_EXACT, WALK_MADE, WORKBENCH};

pub(super) use film::small_orbit;
pub(super) use protocols::names;

/// Steps of everything in a quick run.
const QUICK_STEPS: u64 = 10;

const INTRO: &str = "Held-out views at held-out times. Moving: pixels that show things that move at some time; still: the others. \
                     Hidden: what something stood in front of when the photo was taken. Depth: mean absolute error \
                     of z depth, world units, where the truth is known; a ray that ends nowhere counts with the whole depth. Behind: \
                     PSNR of what is behind what moves, against the same stage without that, of systems that know it apart. \
                     Found again: points of things that move, brought to another held-out view by the canonical point nearest to \
                     theirs, that come within 5 % of its longer side of where they are; flow: how far off they are on average. \
                     Scene flow: points of things that move, where they truly are, brought to one training frame on (at the end of the \
                     sequence one back) by the canonical points of the system; how far from where they truly are then, world units \
                     and % of their true way, which is 100 % for who says that nothing moves; end point: the same in the picture of \
                     the view's camera; of still: both for things that never move; n/a: the system says nothing of where points go. Rows \
                     that take a part out of a system do as many steps as it did; of systems whose pictures take minutes few views are measured. The time is that of the training alone, with \
                     whatever else the machine does: compare it within a table.";

/// The path-traced scene.
pub(super) fn workbench(bench: &Bench, keep: &Keep<'_>) -> Result<Section, BenchError> {
    section(bench, keep, "Moving scenes: workbench", &WORKBENCH)
}

/// The embedded scene.
pub(super) fn orbit(bench: &Bench, keep: &Keep<'_>) -> Result<Section, BenchError> {
    section(bench, keep, "Moving scenes: orbit", &ORBIT)
}

/// What opens, splits and closes again.
pub(super) fn mouth(bench: &Bench, keep: &Keep<'_>) -> Result<Section, BenchError> {
    section(bench, keep, "Moving scenes: a mouth that opens and splits", &MOUTH)
}

/// A real video.
pub(super) fn nr(bench: &Bench, keep: &Keep<'_>) -> Result<Section, BenchError> {
    section(bench, keep, "Moving scenes: a real video", &NR)
}

/// Tissue behind a tool.
pub(super) fn tissue(bench: &Bench, keep: &Keep<'_>) -> Result<Section, BenchError> {
    section(bench, keep, "Moving scenes: tissue behind a tool", &TISSUE)
}

/// Scene flow without each of its parts, with priors that are exact, of a camera that jumps.
pub(super) fn orbit_exact(bench: &Bench, keep: &Keep<'_>) -> Result<Section, BenchError> {
    section(bench, keep, "Scene flow, part by part: orbit, exact priors", &ORBIT_EXACT)
}

/// The same with priors made of the photos.
pub(super) fn orbit_made(bench: &Bench, keep: &Keep<'_>) -> Result<Section, BenchError> {
    section(bench, keep, "Scene flow, part by part: orbit, priors made of the photos", &ORBIT_MADE)
}

/// Scene flow without each of its parts, with priors that are exact, of a camera that walks.
pub(super) fn walk_exact(bench: &Bench, keep: &Keep<'_>) -> Result<Section, BenchError> {
    section(bench, keep, "Scene flow, part by part: a walk, exact priors", &WALK_EXACT)
}

/// The same with priors made of the photos.
pub(super) fn walk_made(bench: &Bench, keep: &Keep<'_>) -> Result<Section, BenchError> {
    section(bench, keep, "Scene flow, part by part: a walk, priors made of the photos", &WALK_MADE)
}

fn section(bench: &Bench, keep: &Keep<'_>, title: &'static str, group: &Group) -> Result<Section, BenchError> {
    let quick = bench.extent == Extent::Quick;
    let folder = tempfile::tempdir().map_err(BenchError::file(&std::env::temp_dir()))?;
    let (mut rows, mut goals, mut missing): (Vec<Measured>, Vec<Goal>, Vec<&str>) = Default::default();
    let mut about = None;
    // Quick runs know embedded scenes only.
    if bench.wants(group.name) && (!quick || group.path.starts_with(engine::source::SYNTHETIC)) {
        let lpips = if quick { None } else { weights(bench)? };
        about = group.film.map(|film| film.write_priors(bench, folder.path())).transpose()?;
        for entry in group.entries.iter().filter(|entry| !quick || is_quick(group, entry)) {
            let Some(request) = request(bench, group, entry, folder.path())? else {
                missing.push(group.name);
                break;
            };
            let stop = stop(bench, group, entry, &rows);
            let measured = measure(bench, group, entry, &request, stop, lpips.as_ref())?;
            goals.extend(entry.aims.iter().filter_map(|aim| goal(*aim, group.name, entry, &measured, &rows)));
            rows.push(measured);
            keep(&page(title, group, about.as_deref(), &rows, goals.clone(), &missing)?)?;
        }
    }
    if quick {
        goals.clear();
    }
    let mut section = page(title, group, about.as_deref(), &rows, goals, &missing)?;
    if quick {
        section.items.push(Item::Text(QUICK.into()));
    }
    Ok(section)
}

/// Whether a quick run has this row. Of films it has only rows that another row takes a part out of: the whole systems.
fn is_quick(group: &Group, entry: &Entry) -> bool {
    group.film.is_none() || group.entries.iter().any(|other| other.without == Some(entry.name))
}

/// When a row ends: with the row it takes a part out of, else as asked for, else as planned.
fn stop(bench: &Bench, group: &Group, entry: &Entry, before: &[Measured]) -> Stop {
    if let Some(whole) = entry.without.and_then(|name| before.iter().find(|m| m.name == name)) {
        return Stop::Steps(whole.steps);
    }
    match (bench.steps, bench.seconds) {
        (Some(steps), _) => Stop::Steps(steps),
        (None, Some(seconds)) => Stop::Seconds(seconds),
        (None, None) => bench.pick(Stop::Steps(QUICK_STEPS), group.stop),
    }
}

/// The rows so far; `about`: what there is to say of the scene.
fn page(
    title: &'static str,
    group: &Group,
    about: Option<&str>,
    rows: &[Measured],
    goals: Vec<Goal>,
    missing: &[&str],
) -> Result<Section, BenchError> {
    let mut items: Vec<Item> = about.into_iter().map(|text| Item::Text(text.into())).collect();
    if !rows.is_empty() {
        items.extend([Item::Table(scores(rows)?), Item::Table(over_time(rows)?), Item::Plot(plot(group, rows))]);
    }
    items.extend(claims::note(rows.iter().map(|m| claims::Named { system: m.system, set: m.set })));
    items.extend(not_run(missing));
    Ok(Section { title, intro: INTRO, items, goals })
}

/// A row a system, at the end of its training.
fn scores(rows: &[Measured]) -> Result<Table, BenchError> {
    let mut table = Table::new(
        "systems",
        "PSNR in dB; rays a second are a mean over the training. One seed (0).",
        &[
            "system",
            claims::COLUMN,
            "train / test views",
            "steps",
            "seconds",
            "PSNR",
            "moving",
            "still",
            "hidden",
            "SSIM",
            "LPIPS",
            "depth",
            "depth, %",
            "depth of hidden",
            "behind",
            "found again, %",
            "flow, px",
            "scene flow",
            "scene flow, %",
            "end point, px",
            "scene flow of still",
            "end point of still, px",
            "rays/s",
        ],
    );
    for m in rows {
        table.row([
            m.name.into(),
            claims::mark(m.system, m.set),
            m.views.as_str().into(),
            (m.steps as usize).into(),
            m.seconds.into(),
            Table::decibels(m.psnr),
            Table::decibels(m.motion.psnr_moving),
            Table::decibels(m.motion.psnr_still),
            Table::decibels(m.motion.psnr_hidden),
            m.ssim.into(),
            m.lpips.into(),
            m.motion.depth_error.into(),
            m.motion.depth_relative.map(|x| 100.0 * x).into(),
            m.motion.depth_hidden.into(),
            Table::decibels(m.behind),
            m.motion.flow_found.map(|x| 100.0 * x).into(),
            m.motion.flow_error.into(),
            said(m, m.motion.scene_flow_error),
            said(m, m.motion.scene_flow_share().map(|x| 100.0 * x)),
            said(m, m.motion.end_point_error),
            said(m, m.motion.scene_flow_still),
            said(m, m.motion.end_point_still),
            m.rays_per_s.into(),
        ])?;
    }
    Ok(table.without_empty_columns())
}

/// A score of scene flow. `n/a`: the truth is known, but the system does not say where points go. Empty: the truth is not known.
fn said(m: &Measured, score: Option<f64>) -> Cell {
    let says_nothing = m.motion.scene_motion.is_some() && m.motion.scene_flow_error.is_none();
    if says_nothing { "n/a".into() } else { score.into() }
}

/// PSNR on the way.
fn over_time(rows: &[Measured]) -> Result<Table, BenchError> {
    let mut table = Table::new(
        "curves",
        "PSNR in dB over training seconds: at the first step from that time on. A tenth: of its own training time.",
        &["system", "10 s", "30 s", "60 s", "120 s", "300 s", "600 s", "a tenth", "the end", "seconds in all"],
    );
    for m in rows {
        let [a, b, c, d, e, f] = EVAL_AT.map(|at| Table::decibels(psnr_at(m, at)));
        let tenth = Table::decibels(psnr_at(m, 0.1 * m.seconds));
        table.row([m.name.into(), a, b, c, d, e, f, tenth, Table::decibels(m.psnr), Cell::from(m.seconds)])?;
    }
    Ok(table.without_empty_columns())
}

/// What was measured from `at` on, if that was soon after.
fn psnr_at(m: &Measured, at: f64) -> Option<f64> {
    m.curve.iter().find(|p| p.seconds >= at && p.seconds <= 1.2 * at).map(|p| p.psnr)
}

/// Curves of whole systems: those without a part would cover them.
fn plot(group: &Group, rows: &[Measured]) -> Plot {
    let is_whole = |m: &&Measured| group.entries.iter().any(|e| e.name == m.name && e.without.is_none());
    let points = |m: &Measured| m.curve.iter().map(|p| (p.seconds, p.psnr)).collect();
    Plot {
        name: "time",
        title: format!("{}: held-out PSNR over training time", group.name),
        x: Axis { label: "training seconds", scale: Scale::Log },
        y: Axis { label: "PSNR, dB", scale: Scale::Linear },
        series: rows.iter().filter(is_whole).map(|m| Series::line(m.name, points(m))).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::Cli;
    use crate::sections::scene::Point;
    use clap::Parser;
    use engine::eval::MotionScore;
    use std::cell::RefCell;

    fn row(name: &'static str, steps: u64, curve: &[(f64, f64)]) -> Measured {
        Measured {
            name,
            views: "8 / 2".into(),
            steps,
            seconds: curve.last().map_or(0.0, |c| c.0),
            psnr: curve.last().map(|c| c.1),
            curve: curve.iter().map(|&(seconds, psnr)| Point { step: 1, seconds, psnr }).collect(),
            ..Measured::default()
        }
    }

    #[test]
    fn settings_of_all_entries_are_toml_and_what_they_name_comes_before_them() {
        for group in [WORKBENCH, ORBIT, MOUTH, NR, TISSUE, ORBIT_EXACT] {
            for (i, entry) in group.entries.iter().enumerate() {
                for set in [entry.set, entry.quick] {
                    assert!(set.parse::<toml::Table>().is_ok(), "{set}");
                }
                assert!(systems::registry::find(entry.system).is_some(), "{}", entry.system);
                let known = |name: &str| group.entries[..i].iter().any(|e| e.name == name);
                assert!(entry.without.is_none_or(known), "{} {}", group.name, entry.name);
                assert!(!known(entry.name), "{} twice", entry.name);
                for aim in entry.aims {
                    let least = match *aim {
                        entry::Aim::Over(_, x) | entry::Aim::Costs(x) | entry::Aim::HiddenCosts(x) => x,
                        entry::Aim::DepthCosts(x) => x - 1.0,
                        _ => f64::INFINITY,
                    };
                    assert!(least > 0.0, "{}: {aim:?}: nothing at all would be enough", entry.name);
                    use entry::Aim::{Costs, DepthCosts, Faster, HiddenCosts, Moving, Over};
                    match *aim {
                        Moving(other, _) | Over(other, _) | Faster(other, _) => assert!(known(other), "{aim:?}"),
                        Costs(_) | HiddenCosts(_) | DepthCosts(_) => assert!(entry.without.is_some(), "{aim:?}"),
                        _ => {}
                    }
                }
            }
        }
    }

    #[test]
    fn tables_leave_out_what_nobody_measured() {
        let rows =
            [row("a", 9, &[(10.2, 20.0), (31.0, 22.0), (101.0, 25.0)]), row("b", 9, &[(10.1, 19.0), (99.0, 24.0)])];
        let text = over_time(&rows).unwrap().csv();
        let expected = "system,10 s,30 s,a tenth,the end,seconds in all\n\
                        a,20,22,20,25,101\nb,19,,19,24,99\n";
        assert_eq!(text, expected);
        let text = scores(&rows).unwrap().csv();
        assert!(text.starts_with("system,train / test views,steps,seconds,PSNR\n"), "{text}");
        let plot = plot(&WORKBENCH, &[row("ngp", 9, &[(1.0, 2.0)]), row("nerfies, no elastic loss", 9, &[(1.0, 2.0)])]);
        assert_eq!(plot.series.len(), 1);
    }

    #[test]
    fn what_says_nothing_of_where_points_go_has_no_number() {
        let with = |name, motion| Measured { motion, ..row(name, 9, &[(10.0, 20.0)]) };
        let silent = MotionScore { scene_motion: Some(0.02), ..MotionScore::default() };
        let says = MotionScore { scene_flow_error: Some(0.005), end_point_error: Some(0.25), ..silent };
        let text = scores(&[with("ngp", silent), with("d-nerf", says)]).unwrap().csv();
        let lines: Vec<&str> = text.lines().collect();
        assert!(lines[1].starts_with("ngp,") && lines[1].ends_with(",n/a,n/a,n/a,n/a,n/a"), "{text}");
        assert!(lines[2].ends_with(",0.00500000,25,0.250000,,"), "{text}");
        let columns = ",scene flow,\"scene flow, %\",\"end point, px\",scene flow of still,\"end point of still, px\"";
        assert!(lines[0].ends_with(columns), "{text}");
        // Nothing is known of the truth: no columns.
        assert!(!scores(&[row("ngp", 9, &[(10.0, 20.0)])]).unwrap().csv().contains("scene flow"));
    }

    #[test]
    fn a_page_is_kept_after_each_row() {
        // One that says nothing of where points go, and one that warps from the start.
        const ROWS: &[Entry] = &[ORBIT.entries[0], Entry { set: "background = 'moving'", ..ORBIT.entries[2] }];
        let words = ["nerf-bench", "--quick", "--steps", "2", "--threads", "1"];
        let bench = Bench::new(&Cli::parse_from(words)).unwrap();
        let kept = RefCell::new(Vec::new());
        let keep = |so_far: &Section| {
            let Some(Item::Table(table)) = so_far.items.first() else { panic!("a table comes first") };
            kept.borrow_mut().push(table.csv());
            Ok(())
        };
        let group = Group { entries: ROWS, ..ORBIT };
        let section = section(&bench, &keep, "Two rows", &group).unwrap();
        let kept: Vec<String> = kept.take();
        assert!(kept.iter().map(|csv| csv.lines().count()).eq([2, 3]), "{kept:?}");
        let says: Vec<bool> = kept[1].lines().map(|line| !line.contains("n/a")).collect();
        assert_eq!(says, [true, false, true], "{}", kept[1]);
        assert!(kept[1].contains("end point, px"), "{}", kept[1]);
        assert!(section.goals.is_empty(), "two steps reach nothing");
    }
}
