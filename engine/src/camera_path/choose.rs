//! Which path, and its frames.

use super::file::from_file;
use super::hold::held;
use super::orbit::{arc, orbit};
use super::photos::{is_sequence, photos};
use super::rig::Rig;
use super::sight::{Sight, coverage_line};
use super::spiral::spiral;
use super::stretch::{Coverage, Frames, MEASURED_FRAMES};
use super::{PATHS, PathKind};
use crate::data::Dataset;
use crate::error::RunError;
use crate::time_path::TimePath;
use render_core::camera::Camera;
use render_core::path::Ends;
use scene_io::{LayoutHint, Scene};

/// Frames of a path where nothing is said.
pub const FRAMES: usize = 60;

/// The frames of a path, with what photos saw of each.
#[derive(Clone, Debug)]
pub struct Film {
    /// The path.
    pub path: PathKind,
    /// The camera of each frame.
    pub cameras: Vec<Camera>,
    /// The share of each frame that at least two photos saw.
    pub seen: Vec<f64>,
    /// Where it leads, for people.
    pub line: String,
    /// What was not taken into account; see [`Sight::limits`].
    pub limits: Option<String>,
}

impl Film {
    /// Lines for people: where the path leads, and what the photos saw of it.
    #[must_use]
    pub fn lines(&self) -> [String; 2] {
        let path = match self.line.as_str() {
            "" => format!("path {}", self.path),
            line => format!("path {}: {line}", self.path),
        };
        [path, coverage_line(&self.seen, self.limits.as_deref())]
    }
}

/// `frames` cameras along a path (default: 60, or as many as the file holds; a file's cameras are joined by a smooth curve
/// when another number is asked for), by the cameras' places alone. [`film`] takes what photos saw into account, too.
///
/// # Errors
/// [`RunError::Option`] when the cameras define no such path; [`RunError::Read`], [`RunError::Content`] for files.
///
/// # Panics
/// If there is no memory for the cameras of all frames.
pub fn cameras(kind: &PathKind, scene: &Scene, data: &Dataset, frames: Option<usize>) -> Result<Vec<Camera>, RunError> {
    let rig = rig(scene, data, None)?;
    along(kind, scene, data, &rig, frames, None).map(|found| found.0)
}

/// The same, with the share of each frame that two photos saw. Without a path the one that fits the scene is taken: through the
/// photos, or a whole turn where photos stand all round an object with nothing behind it, in no order. Paths that are made
/// here are made shorter until two photos saw each frame.
///
/// # Errors
/// As [`cameras`], and those of drawing.
///
/// # Panics
/// As [`cameras`] and [`Sight::share`].
pub fn film(
    kind: Option<&PathKind>,
    scene: &Scene,
    data: &Dataset,
    frames: Option<usize>,
    time: TimePath,
    sight: &Sight<'_>,
) -> Result<Film, RunError> {
    let rig = rig(scene, data, Some(sight))?;
    let kind = kind.cloned().unwrap_or_else(|| fitting(scene, data, &rig));
    let coverage = Coverage { sight, time };
    let (cameras, line) = along(&kind, scene, data, &rig, frames, Some(coverage))?;
    let seen = coverage.shares(&cameras)?;
    let some =
        (cameras.len() > MEASURED_FRAMES).then(|| format!("on {MEASURED_FRAMES} frames, straight lines between"));
    let limits: Vec<String> = sight.limits().into_iter().chain(some).collect();
    let limits = (!limits.is_empty()).then(|| limits.join("; "));
    Ok(Film { path: kind, cameras, seen, line, limits })
}

fn rig(scene: &Scene, data: &Dataset, sight: Option<&Sight<'_>>) -> Result<Rig, RunError> {
    Rig::of(scene, data, sight)
        .ok_or_else(|| RunError::Option("the run has no training views to take the optics from".into()))
}

/// The path of a scene where none is named.
fn fitting(scene: &Scene, data: &Dataset, rig: &Rig) -> PathKind {
    let alone = matches!(scene.layout, LayoutHint::Object { .. }) || data.is_cut_out();
    let around = || arc(rig).is_some_and(|arc| arc.ends == Ends::Closed);
    if alone && !is_sequence(rig) && around() { PathKind::Orbit } else { PathKind::Photos }
}

fn along(
    kind: &PathKind,
    scene: &Scene,
    data: &Dataset,
    rig: &Rig,
    frames: Option<usize>,
    coverage: Option<Coverage<'_>>,
) -> Result<(Vec<Camera>, String), RunError> {
    let n = Frames(frames.unwrap_or(FRAMES));
    let found = match kind {
        PathKind::Photos => photos(rig, n, coverage)?,
        PathKind::Orbit => orbit(rig, n, coverage)?,
        PathKind::Spiral => spiral(scene, rig, n, coverage)?,
        PathKind::Hold(name) => Some((vec![held(name, scene, data)?; n.0], String::new())),
        PathKind::File(path) => Some((from_file(path, &rig.optics, frames)?, String::new())),
    };
    found.ok_or_else(|| {
        let what = match kind {
            PathKind::Orbit => "define no arc about what they look at",
            PathKind::Spiral => "define no spiral",
            _ => "define no path with a direction to look into",
        };
        RunError::Option(format!("`--path {kind}`: the training cameras {what}; the paths are {PATHS}"))
    })
}
