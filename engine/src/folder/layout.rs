//! Names of what a run writes into its folder. What each holds stands where it is written.

use crate::{checkpoint, crop};

/// The configuration of the run.
pub(crate) const CONFIG: &str = "config.toml";
/// Names of the held-out frames, one a line.
pub(crate) const HELD_OUT: &str = "heldout.txt";
/// Names of the frames that `--validation` holds out.
pub(crate) const VALIDATION: &str = "validation.txt";
/// When the training stops and is measured.
pub(crate) const SCHEDULE: &str = "schedule.json";
/// The curve: a row an interval of training.
pub(crate) const METRICS: &str = "metrics.csv";
/// Points that were found in the photos.
pub(crate) const PHOTO_POINTS: &str = "photo_points.safetensors";
/// Scores of the held-out views.
pub(crate) const EVAL: &str = "eval.json";
/// The same as a table.
pub(crate) const EVAL_CSV: &str = "eval.csv";
/// Scores at several scales.
pub(crate) const EVAL_SCALES: &str = "eval_scales.json";
/// Views that were measured so far, while an evaluation goes on or was stopped.
pub(crate) const EVAL_VIEWS: &str = "eval_views.json";
/// The folder of the pictures of held-out views.
pub(crate) const RENDERS: &str = "renders";
/// The folder of one view in several appearances.
pub(crate) const APPEARANCE: &str = "appearance";
/// The folder of static masks of training photos.
pub const MASKS: &str = "masks";
/// What is known of the run besides scores and curve.
pub(crate) const SUMMARY: &str = "summary.json";
/// The report: one page about the run.
pub const REPORT: &str = "report.html";
/// The animation that the report shows: a short way along the photos' cameras.
pub const ANIMATION: &str = "animation.gif";
/// A cloud of Gaussians that a field was converted into, to look at and to export it.
pub const BAKED: &str = "baked.safetensors";
/// Written last, with the step that everything in the folder is of.
pub(crate) const FINISHED: &str = "finished.json";
/// The file that is locked by the process that writes.
pub(crate) const LOCK: &str = ".lock";
/// Written and removed again, to see whether anything can be written.
pub(crate) const PROBE: &str = ".writable";

/// All that a run writes, but for the probe.
pub(crate) const OWN: [&str; 21] = [
    CONFIG,
    HELD_OUT,
    VALIDATION,
    EVAL_VIEWS,
    FINISHED,
    SCHEDULE,
    METRICS,
    checkpoint::FOLDER,
    EVAL,
    EVAL_CSV,
    EVAL_SCALES,
    RENDERS,
    APPEARANCE,
    MASKS,
    SUMMARY,
    REPORT,
    ANIMATION,
    BAKED,
    PHOTO_POINTS,
    crop::FILE,
    LOCK,
];
