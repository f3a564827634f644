//! What is scored of a scene that moves, where the dataset holds the truth: what things that move look like, and how far
//! everything is.

use super::measure::inside;
use crate::data::View;
use crate::error::RunError;
use crate::render::Rendered;
use image::RgbImage;
use scene_io::{DepthMap, Split};
use serde::{Deserialize, Serialize};

/// Scores of motion and depth; `None` where the dataset holds no truth for them. Means over views in an evaluation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct MotionScore {
    /// PSNR of the pixels that show things that move at some time, dB.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub psnr_moving: Option<f64>,
    /// PSNR of the pixels of a held-out view that were hidden when the photo of its moment was taken, dB: the truth about what
    /// does not belong to the place, of a view that shows the place itself.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub psnr_hidden: Option<f64>,
    /// Mean absolute error of z depth there, world units.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_hidden: Option<f64>,
    /// PSNR of the others.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub psnr_still: Option<f64>,
    /// Mean absolute error of z depth over the pixels whose depth is known, world units. A ray that ends nowhere counts with
    /// the whole depth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_error: Option<f64>,
    /// The same, relative to the depth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_relative: Option<f64>,
}

impl MotionScore {
    /// Scores of one view.
    ///
    /// # Errors
    /// [`RunError::Scene`] for truth that cannot be read.
    pub(super) fn of(
        view: &View,
        rendered: &Rendered,
        (picture, truth): (&RgbImage, &RgbImage),
        used: Option<&[u8]>,
    ) -> Result<Self, RunError> {
        let (width, height) = (view.camera.width, view.camera.height);
        let mut score = Self::default();
        let counts = |k: usize| used.is_none_or(|mask| mask[k] >= 128);
        if let Some(moving) = view.source.read_moving()? {
            let moving: Vec<bool> = moving.resized(width, height).iter().collect();
            let mask = |what: bool| -> Vec<u8> {
                moving.iter().enumerate().map(|(k, &m)| if m == what && counts(k) { 255 } else { 0 }).collect()
            };
            score.psnr_moving = inside(picture, truth, &mask(true));
            score.psnr_still = inside(picture, truth, &mask(false));
        }
        let hidden = view.source.read_transient()?.filter(|_| view.source.split == Split::Test);
        let hidden: Option<Vec<bool>> = hidden.map(|hidden| hidden.resized(width, height).iter().collect());
        if let Some(hidden) = &hidden {
            let mask: Vec<u8> = hidden.iter().enumerate().map(|(k, &h)| if h && counts(k) { 255 } else { 0 }).collect();
            score.psnr_hidden = inside(picture, truth, &mask);
        }
        if let Some(depth) = view.source.read_depth()? {
            [score.depth_error, score.depth_relative] = depth_errors(view, rendered, &depth, counts);
            if let Some(hidden) = &hidden {
                [score.depth_hidden, _] = depth_errors(view, rendered, &depth, |k| hidden[k] && counts(k));
            }
        }
        Ok(score)
    }

    /// Means of those that were measured.
    pub(super) fn mean(scores: impl Iterator<Item = Self> + Clone) -> Self {
        let mean = |value: fn(&Self) -> Option<f64>| {
            let values: Vec<f64> = scores.clone().filter_map(|s| value(&s)).collect();
            (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
        };
        Self {
            psnr_moving: mean(|s| s.psnr_moving),
            psnr_still: mean(|s| s.psnr_still),
            psnr_hidden: mean(|s| s.psnr_hidden),
            depth_hidden: mean(|s| s.depth_hidden),
            depth_error: mean(|s| s.depth_error),
            depth_relative: mean(|s| s.depth_relative),
        }
    }

    /// Whether anything was measured.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// What was measured, in words.
    #[must_use]
    pub fn words(&self) -> Vec<String> {
        let mut out = Vec::new();
        if let Some(db) = self.psnr_moving {
            out.push(format!("things that move: {db:.3} dB"));
        }
        if let Some(db) = self.psnr_still {
            out.push(format!("everything else: {db:.3} dB"));
        }
        if let Some(db) = self.psnr_hidden {
            out.push(format!("what was hidden: {db:.3} dB"));
        }
        if let Some(error) = self.depth_hidden {
            out.push(format!("depth of what was hidden: {error:.4} world units off"));
        }
        if let (Some(error), Some(relative)) = (self.depth_error, self.depth_relative) {
            out.push(format!("depth: {error:.4} world units off, {:.2} %", 100.0 * relative));
        }
        out
    }
}

/// Mean absolute and relative error of z depth; the truth is looked up at the nearest pixel.
fn depth_errors(
    view: &View,
    rendered: &Rendered,
    truth: &DepthMap,
    counts: impl Fn(usize) -> bool,
) -> [Option<f64>; 2] {
    let (width, height) = (view.camera.width, view.camera.height);
    if truth.width == 0 || truth.height == 0 {
        return [None; 2];
    }
    let axis = view.camera.optical_axis();
    let at = |i: u32, to: u32, from: u32| (2 * u64::from(i) + 1) * u64::from(from) / (2 * u64::from(to));
    let (mut sum, mut relative, mut n) = (0.0, 0.0, 0_u64);
    for y in 0..height {
        for x in 0..width {
            let k = (y * width + x) as usize;
            let z =
                truth.z[(at(y, height, truth.height) * u64::from(truth.width) + at(x, width, truth.width)) as usize];
            let Some(ray) = view.ray(x, y).filter(|_| z > 0.0 && counts(k)) else { continue };
            let t = f64::from(rendered.layers.depth[k]);
            let found = if t.is_finite() { t * ray.d.dot(axis) } else { 0.0 };
            let error = (found - f64::from(z)).abs();
            sum += error;
            relative += error / f64::from(z);
            n += 1;
        }
    }
    let mean = |sum: f64| (n > 0).then(|| sum / n as f64);
    [mean(sum), mean(relative)]
}
