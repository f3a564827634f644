//! How good the held-out views are.
//!
//! Renders are clipped to `[0, 1]` and rounded to 8 bit; the truth is the 8-bit image at training resolution,
//! composited on the run's background. PSNR is over all three channels; SSIM is the reference variant (11x11 Gaussian
//! window, per channel, no border). Pixels that a mask ignores count in neither. Means are over views.
//!
//! Photos from the wild have a light of their own each: see [`protocol`](Protocol) for which one a view is rendered in, and
//! why right halves alone are scored then. Views are measured one after the other and none depends on another: a view's
//! scores are the same bits in whatever company and with however many threads. One kind compares two views, where the truth
//! is known ([`correspondence`]): a view has it only beside the other one.

pub mod correspondence;
mod fog;
mod half;
pub mod masks;
mod measure;
mod motion;
mod protocol;
mod table;

pub use fog::{fog, opacity_before};
pub(crate) use half::pixels;
pub use motion::MotionScore;
pub use protocol::{EvalAppearance, FIT_LR, FIT_STEPS, Part, Protocol, Scored};
pub(crate) use protocol::{need_codes, view_of};

use crate::data::Dataset;
use crate::error::RunError;
use crate::picture::{colour, over_background};
use crate::render::{Rendered, render};
use crate::skips::MeasuredSkips;
use crate::system::{Canonical, LayerRequest, Median, Query, System};
use correspondence::Correspondence;
use image::RgbImage;
use losses::metrics::Lpips;
use measure::{inside, measure, object_mask};
use scene_io::Split;
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;

/// Which metrics are wanted.
#[derive(Clone, Copy)]
pub enum Measures<'a> {
    /// PSNR alone: for the curve during training.
    Psnr,
    /// All; LPIPS where its weights are there.
    All(Option<&'a Lpips>),
}

/// How views are rendered and measured.
#[derive(Clone, Copy)]
pub struct Terms<'a> {
    /// How they are rendered: [`Protocol::query`].
    pub query: &'a Query,
    /// In which light, and what is scored.
    pub protocol: &'a Protocol,
    /// What is measured.
    pub measures: Measures<'a>,
    /// Seed of the pixels an appearance is fitted to.
    pub seed: u64,
}

/// Scores of a view; `None` where not measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewScore {
    /// Name of the frame.
    pub name: String,
    /// Peak signal-to-noise ratio, dB; `None` when the render equals the truth (infinite) or all pixels are ignored.
    pub psnr: Option<f64>,
    /// The same inside the mask that cuts out an object; `None` without such masks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_object: Option<f64>,
    /// Motion and depth, where their truth is known.
    #[serde(default, skip_serializing_if = "MotionScore::is_empty")]
    pub motion: MotionScore,
    /// Fog before the camera: mean opacity nearer than 0.9 of the depth of the nearest point that the view shows, `0..=1`;
    /// `None` without such points, and where the scene moves.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fog: Option<f64>,
    /// Structural similarity; `None` for images under 11 pixels a side.
    pub ssim: Option<f64>,
    /// Multi-scale SSIM; `None` for images under its smallest side, and for masked ones.
    pub ms_ssim: Option<f64>,
    /// Perceptual distance; `None` without weights, and for masked images.
    pub lpips: Option<f64>,
    /// Difference that is seen when pictures alternate; `None` without the feature `flip`, and for masked images.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub flip: Option<f64>,
    /// Seconds to render.
    pub render_seconds: f64,
    /// Stem of the view's files in `renders/`, when they were written: `STEM.png`, `STEM_truth.png`, `STEM_error.png`,
    /// `STEM_depth.png`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub files: Option<String>,
}

/// Which views were measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Measured {
    /// The test views.
    #[default]
    Test,
    /// Views held out for choosing settings; the test views were not looked at, or there are none.
    Validation,
}

impl Measured {
    /// What the views of `data` are held out for.
    #[must_use]
    pub fn of(data: &Dataset) -> Self {
        match data.views().first() {
            Some(view) if view.source.split == Split::Val => Self::Validation,
            _ => Self::Test,
        }
    }

    /// The word in files and reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Test => "test",
            Self::Validation => "validation",
        }
    }
}

/// Scores of all held-out views: the content of `eval.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// Which views were measured; `test` in files that do not say.
    #[serde(default)]
    pub split: Measured,
    /// Mean over views, dB.
    pub psnr: Option<f64>,
    /// Mean over views, dB.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_object: Option<f64>,
    /// Means over views.
    #[serde(default, skip_serializing_if = "MotionScore::is_empty")]
    pub motion: MotionScore,
    /// Mean over views: see [`ViewScore::fog`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fog: Option<f64>,
    /// Mean over views.
    pub ssim: Option<f64>,
    /// Mean over views.
    pub ms_ssim: Option<f64>,
    /// Mean over views.
    pub lpips: Option<f64>,
    /// Mean over views; only with the feature `flip`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub flip: Option<f64>,
    /// Every view, in the dataset's order.
    pub views: Vec<ViewScore>,
    /// Views that were not measured because somebody asked to stop; such an evaluation is not written to `eval.json`.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub left: usize,
    /// Whether a stop was asked for before all was measured and written down; not part of the file.
    #[serde(skip)]
    pub stopped: bool,
    /// Whether `eval.json` holds these scores; not part of the file.
    #[serde(skip)]
    pub written: bool,
    /// What could not be written, a line each; not part of the file.
    #[serde(skip)]
    pub unwritten: Vec<String>,
    /// Steps trained.
    pub steps: u64,
    /// Training seconds, evaluation not counted.
    pub seconds: f64,
    /// In which light views were rendered, and which of their pixels were scored.
    #[serde(default)]
    pub protocol: Protocol,
    /// What a reader of the numbers should know.
    pub notes: Vec<String>,
    /// What renders skip, measured; `None` where that was not asked for, or where they skip nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub skips: Option<MeasuredSkips>,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "what serde calls it with")]
fn is_zero(n: &usize) -> bool {
    *n == 0
}

/// A view that was measured before.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Known {
    /// Its scores.
    pub score: ViewScore,
    /// What was said of it.
    pub notes: Vec<String>,
}

/// A view with everything that was seen of it.
pub struct Seen<'a> {
    /// View of the dataset.
    pub index: usize,
    /// Its scores.
    pub score: &'a ViewScore,
    /// What a reader of them should know.
    pub notes: &'a [String],
    /// All layers.
    pub rendered: &'a Rendered,
    /// The colour layer, 8 bit.
    pub picture: &'a RgbImage,
    /// The held-out image on the background.
    pub truth: &'a RgbImage,
}

/// Render and measure every view of `data`; `each` sees them as they come, whole, before views are compared with each other.
/// Where it breaks, the views after are left out, and means are over those measured. Once the query's halt is raised the view at
/// hand is left out, too: it is not whole.
///
/// # Errors
/// [`RunError::Scene`] when an image cannot be read, [`RunError::Option`] for views that are too narrow to have halves where
/// those are scored, and whatever `each` fails with.
///
/// # Panics
/// As [`render`].
pub fn evaluate(
    system: &dyn System,
    data: &Dataset,
    terms: &Terms<'_>,
    at: (u64, f64),
    each: impl FnMut(Seen<'_>) -> Result<ControlFlow<()>, RunError>,
) -> Result<Evaluation, RunError> {
    evaluate_from(system, data, terms, at, &|_| None, each)
}

/// [`evaluate`] without the views that are `known`: those are taken as they were measured, and `each` does not see them. A view
/// that others are compared with is measured again.
///
/// # Errors
/// As [`evaluate`].
///
/// # Panics
/// As [`evaluate`].
pub fn evaluate_from(
    system: &dyn System,
    data: &Dataset,
    terms: &Terms<'_>,
    (steps, seconds): (u64, f64),
    known: &dyn Fn(usize) -> Option<Known>,
    mut each: impl FnMut(Seen<'_>) -> Result<ControlFlow<()>, RunError>,
) -> Result<Evaluation, RunError> {
    let Terms { query, protocol, measures, seed } = *terms;
    need_halves(data, protocol)?;
    let mut views = Vec::with_capacity(data.len());
    let mut notes = Vec::new();
    let mut points = match (measures, protocol.scored) {
        (Measures::All(_), Scored::Whole) => Correspondence::of(data)?,
        _ => Correspondence::default(),
    };
    let still = data.moments() <= 1;
    for index in 0..data.len() {
        if query.halt.raised() {
            break;
        }
        if let Some(known) = if points.wants(index) { None } else { known(index) } {
            notes.extend(known.notes);
            views.push(known.score);
            continue;
        }
        let mut own_notes = Vec::new();
        let view = data.view(index);
        let image = data.image(index)?;
        let truth = over_background(&image, query.background);
        let own = protocol.light(system, (data, index), (&image, &truth), (query, seed));
        if own.is_none() && protocol.fit_steps.is_some() {
            own_notes
                .push(format!("{}: no pixel of its left half is used: rendered in the mean appearance", view.name));
        }
        let appearance = own.unwrap_or_else(|| query.appearance.clone());
        let canonical = if points.wants(index) { Canonical::Compute } else { query.layers.canonical };
        let layers = LayerRequest { canonical, median: Median::Skip, ..query.layers };
        let halt = &query.halt;
        let query = Query { appearance, time: view.time, layers, ..query.clone() };
        let clock = std::time::Instant::now();
        let mut rendered = render(system, &view.camera, &query);
        let render_seconds = clock.elapsed().as_secs_f64();
        if halt.raised() {
            break;
        }
        let picture = colour(&rendered);
        let mut note = |note: &str| own_notes.push(format!("{}: {note}", view.name));
        let object = data.is_cut_out().then(|| object_mask(&image)).flatten();
        let mut scored = |picture: &RgbImage, truth: &RgbImage, mask: Option<&[u8]>, object: Option<&[u8]>| ViewScore {
            psnr_object: object.and_then(|object| inside(picture, truth, object)),
            ..measure(picture, truth, mask, measures, &mut note)
        };
        let (mask, object) = (image.mask.as_deref(), object.as_deref());
        let mut score = match protocol.scored {
            Scored::Whole => scored(&picture, &truth, mask, object),
            Scored::RightHalf => {
                let [mask, object] = [mask, object].map(|mask| mask.map(|m| half::right_mask(m, image.width)));
                scored(&half::right(&picture), &half::right(&truth), mask.as_deref(), object.as_deref())
            }
        };
        score.name.clone_from(&view.name);
        score.render_seconds = render_seconds;
        if protocol.scored == Scored::Whole {
            score.motion = MotionScore::of(view, &rendered, (&picture, &truth), mask)?;
        }
        if matches!(measures, Measures::All(_)) && still {
            score.fog = fog(system, view, halt);
        }
        if halt.raised() {
            break;
        }
        let seen =
            Seen { index, score: &score, notes: &own_notes, rendered: &rendered, picture: &picture, truth: &truth };
        let next = each(seen)?;
        notes.append(&mut own_notes);
        points.keep(index, std::mem::take(&mut rendered.layers.canonical));
        views.push(score);
        if next.is_break() {
            break;
        }
    }
    let left = data.len() - views.len();
    // Views are compared with each other where all were rendered.
    for (index, found) in if left == 0 { points.scores(data) } else { Vec::new() } {
        (views[index].motion.flow_error, views[index].motion.flow_found) = (Some(found.error), Some(found.found));
    }
    let mean = |value: fn(&ViewScore) -> Option<f64>| {
        let values: Vec<f64> = views.iter().filter_map(value).collect();
        (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
    };
    let (psnr, psnr_object, ssim) = (mean(|v| v.psnr), mean(|v| v.psnr_object), mean(|v| v.ssim));
    let (ms_ssim, lpips, flip) = (mean(|v| v.ms_ssim), mean(|v| v.lpips), mean(|v| v.flip));
    let protocol = protocol.clone();
    Ok(Evaluation {
        split: Measured::of(data),
        psnr,
        psnr_object,
        motion: MotionScore::mean(views.iter().map(|v| v.motion)),
        fog: mean(|v| v.fog),
        ssim,
        ms_ssim,
        lpips,
        flip,
        steps,
        seconds,
        protocol,
        notes,
        views,
        left,
        stopped: left > 0,
        written: false,
        unwritten: Vec::new(),
        skips: None,
    })
}

/// Refuses views of one column where a protocol needs two halves.
///
/// # Errors
/// [`RunError::Option`] naming the view.
pub(crate) fn need_halves(data: &Dataset, protocol: &Protocol) -> Result<(), RunError> {
    let narrow = data.views().iter().find(|view| view.camera.width < 2);
    match (protocol.scored, narrow) {
        (Scored::RightHalf, Some(view)) => Err(RunError::Option(format!(
            "`{}` is {} pixel wide, which has no two halves: measure whole views with `--eval-appearance mean`",
            view.name, view.camera.width
        ))),
        _ => Ok(()),
    }
}
