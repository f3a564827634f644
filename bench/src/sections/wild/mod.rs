//! Photographs from the wild: how much of what occluders and appearance cost does each system win back, and at what cost a step.

mod cost;
mod measured;
mod protocols;
mod segments;

use super::training::not_run;
use crate::bench::{Bench, Extent, Keep, QUICK};
use crate::claims;
use crate::error::BenchError;
use crate::goals::Goal;
use crate::page::{Item, Section};
use crate::table::Table;
use engine::eval::Scored;
use measured::{Measured, measure, request};
use protocols::{Aim, Entry, Group, Kind, LEGO100, LEGO400, PLAZA, REAL, YARD};

pub(super) use cost::run as cost;
pub(super) use protocols::names;

/// Steps of everything in a quick run, and systems tried.
const QUICK_STEPS: u64 = 60;
const QUICK_SYSTEMS: usize = 2;

const INTRO: &str = "Whole views: held-out views in an appearance that is known (that of a photo left as it was, or the only one \
                     there is). Right halves: the appearance fitted on the left half of each held-out view, the right half scored, \
                     also where a system has no appearance to fit. Share: of the gap between `plain` on these photos and `plain` on \
                     clean photos of the same place; of a cloud the same, of `splat` instead of `plain`. Masks: training photos \
                     against the truth, means over photos; of many large photos some. The time is that of the training alone, with \
                     whatever else the machine does: compare it within a table.";

/// Lego, perturbed.
pub(super) fn lego100(bench: &Bench, keep: &Keep<'_>) -> Result<Section, BenchError> {
    section(bench, keep, "In the wild: perturbed lego, 100 pixels", LEGO100)
}

/// The same photos, larger.
pub(super) fn lego400(bench: &Bench, keep: &Keep<'_>) -> Result<Section, BenchError> {
    section(bench, keep, "In the wild: perturbed lego, 400 pixels", LEGO400)
}

/// Things in the way.
pub(super) fn yard(bench: &Bench, keep: &Keep<'_>) -> Result<Section, BenchError> {
    section(bench, keep, "In the wild: occluders in a yard", YARD)
}

/// Light and occluders.
pub(super) fn plaza(bench: &Bench, keep: &Keep<'_>) -> Result<Section, BenchError> {
    section(bench, keep, "In the wild: many people's photos of a plaza", PLAZA)
}

/// Real photographs.
pub(super) fn real(bench: &Bench, keep: &Keep<'_>) -> Result<Section, BenchError> {
    section(bench, keep, "In the wild: real photographs", REAL)
}

/// What a system that takes photos as they are reached in each appearance.
struct Plain<'a> {
    group: &'a str,
    kind: Kind,
    system: &'a str,
    psnr: Vec<Option<f64>>,
}

fn section(bench: &Bench, keep: &Keep<'_>, title: &'static str, groups: &[Group]) -> Result<Section, BenchError> {
    let mut table = Table::new(
        "systems",
        "PSNR in dB. One seed (0).",
        &[
            "photos",
            "system",
            claims::COLUMN,
            "train / test views",
            "steps",
            "whole views",
            "share, %",
            "right halves",
            "share, %",
            "inside the object",
            "SSIM",
            "mIoU",
            "F1",
            "ms a step",
        ],
    );
    let folder = tempfile::tempdir().map_err(BenchError::file(&std::env::temp_dir()))?;
    let (mut plains, mut goals, mut missing): (Vec<Plain<'_>>, Vec<Goal>, Vec<&str>) =
        (Vec::new(), Vec::new(), Vec::new());
    let mut systems = Vec::new();
    let quick = bench.extent == Extent::Quick;
    // Quick runs know the embedded scene only.
    let wanted = |g: &&Group| bench.wants(g.name) && (!quick || g.path.starts_with(engine::source::SYNTHETIC));
    for group in groups.iter().filter(wanted) {
        for photos in group.photos {
            let entries = if quick { QUICK_SYSTEMS.min(photos.entries.len()) } else { photos.entries.len() };
            for entry in &photos.entries[..entries] {
                let Some(request) = request(bench, group, photos, entry, folder.path())? else {
                    missing.push(group.name);
                    continue;
                };
                let name = format!("{} {}", group.name, photos.name);
                let steps = bench.steps.unwrap_or(if quick { QUICK_STEPS } else { group.steps });
                let watched = format!("{name}, {}", entry.name);
                let measured = measure(bench, &watched, entry.segments, &request, steps, photos.appearances)?;
                if entry.system == entry.base {
                    let psnr = measured.scores.iter().map(|e| e.psnr).collect();
                    plains.push(Plain { group: group.name, kind: photos.kind, system: entry.system, psnr });
                }
                let of_its_kind: Vec<&Plain<'_>> = plains.iter().filter(|p| p.system == entry.base).collect();
                let shares = shares(&of_its_kind, group.name, photos.kind, &measured);
                goals.extend(entry.aims.iter().filter_map(|aim| {
                    goal(*aim, &name, entry, &measured, shares.first().copied().flatten(), &of_its_kind)
                }));
                systems.push(entry.system);
                row(&mut table, name, entry, steps, &measured, &shares)?;
                keep(&page(title, &table, &systems, goals.clone(), &missing))?;
            }
        }
    }
    if quick {
        goals.clear();
    }
    let mut section = page(title, &table, &systems, goals, &missing);
    if quick {
        section.items.push(Item::Text(QUICK.into()));
    }
    Ok(section)
}

fn page(title: &'static str, table: &Table, systems: &[&'static str], goals: Vec<Goal>, missing: &[&str]) -> Section {
    let table = (!table.is_empty()).then(|| Item::Table(table.clone()));
    let items = table.into_iter().chain(claims::note(systems.iter().copied())).chain(not_run(missing));
    Section { title, intro: INTRO, items: items.collect(), goals }
}

/// Per cent of the gap that was closed in each appearance, by what plain systems of its kind reached; nothing without clean photos, for them,
/// or where there is no gap.
fn shares(plains: &[&Plain<'_>], group: &str, kind: Kind, measured: &Measured) -> Vec<Option<f64>> {
    let plain = |kind| plains.iter().find(|p| (p.group, p.kind) == (group, kind));
    let of = |appearance: usize| {
        let (low, high) =
            (plain(kind)?.psnr.get(appearance).copied()??, plain(Kind::Clean)?.psnr.get(appearance).copied()??);
        let gap = high - low;
        (kind != Kind::Clean && gap > 0.0).then_some(100.0 * (measured.scores[appearance].psnr? - low) / gap)
    };
    (0..measured.scores.len()).map(of).collect()
}

fn row(
    table: &mut Table,
    photos: String,
    entry: &Entry,
    steps: u64,
    measured: &Measured,
    shares: &[Option<f64>],
) -> Result<(), BenchError> {
    let of = |scored: Scored| measured.scores.iter().position(|e| e.scored == scored);
    let pair = |scored| {
        let appearance = of(scored);
        let psnr = Table::decibels(appearance.and_then(|l| measured.scores[l].psnr));
        [psnr, appearance.and_then(|l| shares[l]).into()]
    };
    let ([whole, whole_share], [half, half_share]) = (pair(Scored::Whole), pair(Scored::RightHalf));
    let first = measured.scores.first();
    table.row([
        photos.into(),
        entry.name.into(),
        claims::mark(entry.system, entry.set),
        measured.views.as_str().into(),
        (steps as usize).into(),
        whole,
        whole_share,
        half,
        half_share,
        Table::decibels(first.and_then(|e| e.psnr_object)),
        first.and_then(|e| e.ssim).into(),
        measured.masks[0].into(),
        measured.masks[1].into(),
        measured.ms_per_step.into(),
    ])
}

/// An aim beside what was measured; nothing where that is missing.
fn goal(
    aim: Aim,
    photos: &str,
    entry: &Entry,
    measured: &Measured,
    share: Option<f64>,
    plains: &[&Plain<'_>],
) -> Option<Goal> {
    let (what, unit, figure, target) = match aim {
        Aim::Share(target) => ("share of the gap", "%", share?, target),
        Aim::F1(target) => ("F1 of masks", "", measured.masks[1]?, target),
        Aim::Loss(most) => {
            let plain = plains.last()?.psnr.first().copied()??;
            ("against plain", "dB", measured.scores.first()?.psnr? - plain, -most)
        }
    };
    Some(Goal {
        work: format!("{photos}, {}: {what}", entry.name),
        unit,
        figure,
        target,
        ceiling: None,
        peer: None,
        error: "the figure is one".into(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use measured::Score;

    fn measured(psnr: &[f64]) -> Measured {
        let score = |psnr: &f64| Score { scored: Scored::Whole, psnr: Some(*psnr), psnr_object: None, ssim: None };
        Measured {
            views: "8 / 2".into(),
            scores: psnr.iter().map(score).collect(),
            masks: [Some(0.5), Some(0.75)],
            ms_per_step: 1.0,
        }
    }

    #[test]
    fn shares_are_of_the_gap_between_plain_photos_and_clean_ones() {
        let plain = |kind, psnr: &[f64]| Plain {
            group: "g",
            kind,
            system: "plain",
            psnr: psnr.iter().copied().map(Some).collect(),
        };
        let plains = [plain(Kind::Clean, &[30.0, 20.0]), plain(Kind::AsIs, &[20.0, 20.0])];
        let plains: Vec<&Plain<'_>> = plains.iter().collect();
        let of = |group, kind, psnr: &[f64]| shares(&plains, group, kind, &measured(psnr));
        assert_eq!(of("g", Kind::AsIs, &[28.0, 19.0]), [Some(80.0), None], "no gap, no share");
        assert_eq!(of("g", Kind::AsIs, &[19.0]), [Some(-10.0)]);
        assert_eq!(of("g", Kind::Clean, &[30.0]), [None]);
        assert_eq!(of("other", Kind::AsIs, &[28.0]), [None]);
    }

    #[test]
    fn aims_are_compared_with_what_they_are_about() {
        let plains = [&Plain { group: "g", kind: Kind::Clean, system: "plain", psnr: vec![Some(30.0)] }];
        let entry = &YARD[0].photos[0].entries[0];
        let of = |aim, share| goal(aim, "g", entry, &measured(&[29.75]), share, &plains).map(|g| (g.figure, g.target));
        assert_eq!(of(Aim::Share(85.0), Some(87.0)), Some((87.0, 85.0)));
        assert_eq!(of(Aim::Share(85.0), None), None);
        assert_eq!(of(Aim::F1(0.9), None), Some((0.75, 0.9)));
        assert_eq!(of(Aim::Loss(0.5), None), Some((-0.25, -0.5)));
    }

    #[test]
    fn settings_of_all_entries_are_toml_and_every_group_begins_with_plain() {
        for group in [LEGO100, LEGO400, YARD, PLAZA, REAL].into_iter().flatten() {
            for photos in group.photos {
                assert_eq!(photos.entries[0].system, "plain", "{} {}", group.name, photos.name);
                for (i, entry) in photos.entries.iter().enumerate() {
                    let is_before = photos.entries[..=i].iter().any(|before| before.system == entry.base);
                    assert!(is_before || group.photos[0].kind != Kind::Clean, "{} before {}", entry.name, entry.base);
                    assert!(entry.set.parse::<toml::Table>().is_ok(), "{}", entry.set);
                    assert!(systems::registry::find(entry.system).is_some());
                }
                for appearance in photos.appearances {
                    assert!(appearance.parse::<engine::eval::EvalAppearance>().is_ok());
                }
            }
        }
    }
}
