//! Photos or a video to cameras.
//!
//! [`prepare`] makes a scene in COLMAP's layout: upright pictures in `images`, poses and points in `sparse/0`. Frames come out of
//! videos by `ffmpeg`; poses come from the first of these that is there: the crate `openmvg-sfm` (feature `sfm`), `colmap`,
//! with `glomap` on demand. Each stage leaves a marker in `prepare/` and is done once for the same inputs; the output of these
//! programs is kept in `prepare.log`.
//!
//! [`priors`](fn@priors) makes priors of a scene that moves: optical flow between neighbouring photos ([`flow`]), and what moves by itself
//! ([`motion`]); also of a [`Film`] without cameras.
//!
//! [`compare`] tells how far two sets of cameras are apart.

mod batches;
mod cameras;
mod colmap;
mod compare;
mod error;
mod exif;
pub mod flow;
mod heic;
mod input;
pub mod motion;
mod outcome;
mod pairs;
mod photo;
mod pictures;
mod posers;
mod priors;
mod request;
#[cfg(feature = "sfm")]
mod sfm;
mod sharpness;
#[cfg(feature = "sfm")]
mod sparse_text;
mod stage;
mod task;
#[cfg(test)]
mod testing;
mod tool;
mod video;
mod watch;

pub use cameras::UnknownCameras;
pub use compare::{Comparison, compare};
pub use error::PrepareError;
pub use outcome::{ENOUGH, Summary};
pub use posers::Poser;
pub use priors::{Film, FitSummary, PriorsRequest, PriorsSummary, Sequence, priors};
pub use request::Request;
pub use tool::Toolbox;
pub use watch::{Event, Silent, Watch};

use crate::posers::Chosen;
use crate::stage::{Stages, hash};
use crate::task::Task;
use crate::tool::Log;
use scene_io::colmap::Model;
use std::path::{Path, PathBuf};

/// Folder of markers and of what stages hand on, in the scene.
const WORK: &str = "prepare";
/// What programs said, in the scene.
pub const LOG: &str = "prepare.log";

/// Makes a scene with cameras out of photos or a video. A second call with the same request goes on where an earlier one ended.
///
/// # Errors
/// [`PrepareError`], with what to do about it.
pub fn prepare(request: &Request, watch: &mut dyn Watch) -> Result<Summary, PrepareError> {
    let input = input::Input::find(&request.input)?;
    // Before minutes are spent on frames.
    let poser = Chosen::find(&request.tools, request.with)?;
    let stages = Stages { folder: request.out.join(WORK) };
    claim(&request.input, &request.out, &stages.folder)?;
    let mut log = Log::open(&request.out.join(LOG))?;
    let made = pictures::pictures(request, &input, &stages, &mut log, watch)?;
    let names: Vec<&str> = made.pictures.iter().map(|p| p.name.as_str()).collect();
    let groups = cameras::groups(&made.pictures, request.unknown_cameras);
    let count = if groups.len() == 1 { "one camera".to_string() } else { format!("{} cameras", groups.len()) };
    let known = groups.iter().filter(|g| g.focal.is_some()).count();
    watch.event(Event::Note(&format!(
        "{} photos, {count}, focal length known of {known}; poses by {}",
        names.len(),
        poser.name()
    )));
    let grouping = groups.iter().map(cameras::Group::marker);
    let task = Task {
        tools: &request.tools,
        stages: &stages,
        images: request.out.join("images"),
        model: request.out.join("sparse").join("0"),
        groups: &groups,
        in_order: made.in_order,
        threads: request.threads,
        inputs: hash(std::iter::once(made.hash.clone()).chain(grouping)),
        names,
    };
    poser.reconstruct(&task, &mut log, watch)?;
    let model = Model::read(&task.model)?;
    let summary = Summary::of(&model, &task.names, poser.name());
    if summary.placed < 2 {
        let what = format!("{} of {} photos could be placed", summary.placed, summary.photos);
        let remedy = "photos of one place need to overlap: take more of them, from more places".into();
        return Err(PrepareError::NoCameras { what, remedy });
    }
    Ok(summary)
}

/// Makes the folder of the scene; one that holds something else is left alone.
fn claim(input: &Path, out: &Path, work: &Path) -> Result<(), PrepareError> {
    let (from, to) = (real(input), real(out));
    if from == to || (from.starts_with(&to) && from.is_dir()) {
        let remedy = "give another folder as --out: pictures are written, photos are never changed";
        return Err(PrepareError::input(out, "is where the photos lie", remedy));
    }
    if to.starts_with(&from) {
        let remedy = "give a folder beside the photos as --out";
        return Err(PrepareError::input(out, "lies among the photos", remedy));
    }
    let is_empty = std::fs::read_dir(out).map_or(true, |mut entries| entries.next().is_none());
    if !is_empty && !work.is_dir() {
        let remedy = "give a new or an empty folder as --out";
        return Err(PrepareError::input(out, "holds files that were not made by `prepare`", remedy));
    }
    std::fs::create_dir_all(work).map_err(PrepareError::io(work, "make the folder"))
}

/// The path without links; what is not there yet follows what is.
fn real(path: &Path) -> PathBuf {
    let path = std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
    let known = path.ancestors().find_map(|a| Some((std::fs::canonicalize(a).ok()?, path.strip_prefix(a).ok()?)));
    known.map_or_else(|| path.clone(), |(known, rest)| known.join(rest))
}
