//! `priors`: optical flow and what moves, for a scene that moves and has no such files.

use super::watcher::watched;
use crate::cli::Priors;
use crate::session::{Done, Failure, Session, data_options, scene_spec};
use crate::show::{line, note};
use ::prepare::{PriorsRequest, PriorsSummary};
use engine::RunError;
use engine::source::{PERTURBED, SYNTHETIC, drawn};
use scene_io::synthetic::Drawn;
use scene_io::{MotionFiles, Scene};
use std::path::{Path, PathBuf};

pub(crate) fn run(session: &Session, args: &Priors) -> Result<Done, Failure> {
    let exact = if args.exact { Some(known(&args.scene)?) } else { None };
    let scene = (session.app.load)(&scene_spec(&args.scene), &data_options(&args.data))?;
    let out = match &args.out {
        Some(out) => out.clone(),
        None => beside(&args.scene, &scene)?,
    };
    let request = PriorsRequest {
        scene: &scene,
        exact: exact.as_ref(),
        out: out.clone(),
        frames: args.frames,
        longest_side: args.data.longest_side,
    };
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

/// The folder in that of the scene; photos that no file holds, or that are changed when they are read, have none.
fn beside(word: &str, scene: &Scene) -> Result<PathBuf, RunError> {
    if word.starts_with(SYNTHETIC) || word.starts_with(PERTURBED) {
        return Err(RunError::Option(format!("`{word}` has no folder of its own: name one with `--out`")));
    }
    Ok(scene.root.join(MotionFiles::MADE))
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
        line(format_args!("flow and motion masks (white = moves) in {}", out.display()));
    }
    for warning in summary.warnings() {
        note(&format!("warning: {warning}"));
    }
}
