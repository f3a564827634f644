//! `priors`: optical flow and what moves, for a scene that moves and has no such files, or for photos of a film without cameras.

use super::watcher::watched;
use crate::cli::{Data, Priors};
use crate::session::{Done, Failure, Session, data_options, scene_spec};
use crate::show::{line, note};
use ::prepare::{Film, PriorsRequest, PriorsSummary, Sequence};
use engine::RunError;
use engine::source::{PERTURBED, SYNTHETIC, drawn};
use scene_io::MotionFiles;
use scene_io::synthetic::Drawn;
use std::path::{Path, PathBuf};

pub(crate) fn run(session: &Session, args: &Priors) -> Result<Done, Failure> {
    let exact = if args.exact { Some(known(&args.scene)?) } else { None };
    match (session.app.load)(&scene_spec(&args.scene), &data_options(&args.data)) {
        Ok(scene) => make(session, args, Sequence::Scene(&scene), exact.as_ref()),
        Err(error) => match film(args)? {
            Some(film) => make(session, args, Sequence::Film(&film), None),
            None => Err(error.into()),
        },
    }
}

/// The photos of a folder that holds nothing but photos.
fn film(args: &Priors) -> Result<Option<Film>, Failure> {
    let folder = PathBuf::from(scene_spec(&args.scene));
    if !scene_io::holds_no_dataset(&folder) {
        return Ok(None);
    }
    let Some(film) = Film::find(&folder)? else { return Ok(None) };
    let words = words_of_datasets(&args.data);
    if !words.is_empty() {
        let (words, folder) = (words.join("`, `"), folder.display());
        let what = format!("`{words}`: for datasets with cameras, and {folder} holds photos alone: leave it out");
        return Err(RunError::Option(what).into());
    }
    Ok(Some(film))
}

/// What was said of how a dataset is read that means nothing for photos alone.
fn words_of_datasets(data: &Data) -> Vec<&'static str> {
    let words = [
        ("--holdout", data.holdout.is_some()),
        ("--validation", data.validation.is_some()),
        ("--train-split", data.train_split.is_some()),
        ("--format", data.format.is_some()),
        ("--images", data.images.is_some()),
        ("--masks", data.masks.is_some()),
        ("--mask-white", data.mask_white.is_some()),
        ("--priors", data.priors.is_some()),
        ("--missing-images", data.missing_images.is_some()),
    ];
    words.into_iter().filter(|(_, is_said)| *is_said).map(|(word, _)| word).collect()
}

fn make(session: &Session, args: &Priors, sequence: Sequence<'_>, exact: Option<&Drawn>) -> Result<Done, Failure> {
    let out = match &args.out {
        Some(out) => out.clone(),
        None => beside(&args.scene, sequence.root())?,
    };
    let longest_side = args.data.longest_side;
    let request = PriorsRequest { sequence, exact, out: out.clone(), frames: args.frames, longest_side };
    let Some(summary) = watched(session.progress, |watch| ::prepare::priors(&request, watch))? else {
        return Ok(Done::Interrupted);
    };
    conclude(&summary, &out);
    Ok(Done::Finished)
}

/// The drawn scene that is known exactly.
fn known(word: &str) -> Result<Drawn, RunError> {
    drawn(word).ok_or_else(|| {
        let which = ["orbit", "mouth"].map(|name| format!("`{SYNTHETIC}{name}`")).join(" and ");
        RunError::Option(format!("`--exact`: `{word}` is not known exactly; {which} are: leave the option out"))
    })
}

/// The folder in that of the photos; those that no file holds, or that are changed when they are read, have none.
fn beside(word: &str, root: &Path) -> Result<PathBuf, RunError> {
    if word.starts_with(SYNTHETIC) || word.starts_with(PERTURBED) {
        return Err(RunError::Option(format!("`{word}` has no folder of its own: name one with `--out`")));
    }
    Ok(root.join(MotionFiles::MADE))
}

/// What came out.
fn conclude(summary: &PriorsSummary, out: &Path) {
    let (photos, seen, moving) = (summary.photos, 100.0 * summary.seen, 100.0 * summary.moving);
    if summary.exact {
        line(format_args!(
            "{photos} photos: {seen:.0} % of their pixels are shown by a neighbour, {moving:.1} % of the pixels show what moves"
        ));
        line(format_args!("exact flow, disparities and motion masks (white = moves) in {}", out.display()));
    } else {
        line(format_args!(
            "{photos} photos: {seen:.0} % of the flow vectors can be relied on, {moving:.1} % of the pixels that were judged move"
        ));
        if let Some(told_by) = summary.told_by() {
            line(told_by);
        }
        line(format_args!("flow and motion masks (white = moves) in {}", out.display()));
    }
    for warning in summary.warnings() {
        note(&format!("warning: {warning}"));
    }
}
