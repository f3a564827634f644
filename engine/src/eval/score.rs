//! Scores: of a view, and of all held-out views.

use super::motion::MotionScore;
use super::protocol::Protocol;
use super::skips::MeasuredSkips;
use crate::data::Dataset;
use losses::metrics::Lpips;
use scene_io::Split;
use serde::{Deserialize, Serialize};

/// Which metrics are wanted.
#[derive(Clone, Copy)]
pub enum Measures<'a> {
    /// PSNR alone: for the curve during training.
    Psnr,
    /// All; LPIPS where its weights are there.
    All(Option<&'a Lpips>),
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
    /// Views held out for choosing settings; the test views were not measured, or there are none.
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
    /// Views that were not measured because a stop was asked for; such an evaluation is not written to `eval.json`.
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
    /// In which appearance views were rendered, and which of their pixels were scored.
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
pub struct KnownView {
    /// Its scores.
    pub score: ViewScore,
    /// What was said of it.
    pub notes: Vec<String>,
}
