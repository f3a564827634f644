//! `priors`: optical flow and what moves, for a scene that moves and has no such files.

use super::watcher::watched;
use crate::cli::Priors;
use crate::session::{Done, Failure, Session, data_options, scene_spec};
use crate::show::{line, note};
use ::prepare::{PriorsRequest, PriorsSummary};
use engine::RunError;
use engine::source::{PERTURBED, SYNTHETIC};
use scene_io::{MotionFiles, Scene};
use std::path::{Path, PathBuf};

pub(crate) fn run(session: &Session, args: &Priors) -> Result<Done, Failure> {
    let scene = (session.app.load)(&scene_spec(&args.scene), &data_options(&args.data))?;
    let out = match &args.out {
        Some(out) => out.clone(),
        None => beside(&args.scene, &scene)?,
    };
    let longest_side = args.data.longest_side;
    let request = PriorsRequest { scene: &scene, out: out.clone(), frames: args.frames, longest_side };
    let Some(summary) = watched(session.progress, |watch| ::prepare::priors(&request, watch))? else {
        return Ok(Done::Interrupted);
    };
    conclude(&summary, &out);
    Ok(Done::Finished)
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
    line(format_args!(
        "{} photos: {:.0} % of the flow vectors can be relied on, {:.1} % of the pixels that were judged move",
        summary.photos,
        100.0 * summary.seen,
        100.0 * summary.moving
    ));
    line(format_args!("flow and motion masks (white = moves) in {}", out.display()));
    for warning in summary.warnings() {
        note(&format!("warning: {warning}"));
    }
}
