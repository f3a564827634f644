//! How good the held-out views are.
//!
//! Renders are clipped to `[0, 1]` and rounded to 8 bit; the truth is the 8-bit image at training resolution,
//! composited on the run's background. PSNR is over all three channels; SSIM is the reference variant (11x11 Gaussian
//! window, per channel, no border). Pixels that a mask ignores count in neither. Means are over views.

use crate::data::Dataset;
use crate::error::RunError;
use crate::picture::{colour, over_background};
use crate::render::{Rendered, render};
use crate::skips::MeasuredSkips;
use crate::system::{Query, System};
use image::RgbImage;
use losses::metrics::{
    Image, Lpips, MS_SSIM_MIN_SIDE, MaskedSsim, SsimVariant, masked_psnr, masked_ssim, ms_ssim, psnr, ssim,
};
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

/// Scores of all held-out views: the content of `eval.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// Mean over views, dB.
    pub psnr: Option<f64>,
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
    /// Steps trained.
    pub steps: u64,
    /// Training seconds, evaluation not counted.
    pub seconds: f64,
    /// What a reader of the numbers should know.
    pub notes: Vec<String>,
    /// What renders skip, measured; `None` where that was not asked for, or where they skip nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub skips: Option<MeasuredSkips>,
}

/// A view with everything that was seen of it.
pub struct Seen<'a> {
    /// View of the dataset.
    pub index: usize,
    /// Its scores.
    pub score: &'a ViewScore,
    /// All layers.
    pub rendered: &'a Rendered,
    /// The colour layer, 8 bit.
    pub picture: &'a RgbImage,
    /// The held-out image on the background.
    pub truth: &'a RgbImage,
}

/// Render and measure every view of `data`; `each` sees them as they come.
///
/// # Errors
/// [`RunError::Scene`] when an image cannot be read, and whatever `each` fails with.
pub fn evaluate(
    system: &dyn System,
    data: &Dataset,
    query: &Query,
    measures: Measures<'_>,
    (steps, seconds): (u64, f64),
    mut each: impl FnMut(Seen<'_>) -> Result<(), RunError>,
) -> Result<Evaluation, RunError> {
    let mut views = Vec::with_capacity(data.len());
    let mut notes = Vec::new();
    for index in 0..data.len() {
        let view = data.view(index);
        let image = data.image(index)?;
        let clock = std::time::Instant::now();
        let rendered = render(system, &view.camera, query);
        let render_seconds = clock.elapsed().as_secs_f64();
        let picture = colour(&rendered);
        let truth = over_background(&image, query.background);
        let mut score = measure(&picture, &truth, image.mask.as_deref(), measures, &mut |note| {
            notes.push(format!("{}: {note}", view.name));
        });
        score.name.clone_from(&view.name);
        score.render_seconds = render_seconds;
        each(Seen { index, score: &score, rendered: &rendered, picture: &picture, truth: &truth })?;
        views.push(score);
    }
    let mean = |value: fn(&ViewScore) -> Option<f64>| {
        let values: Vec<f64> = views.iter().filter_map(value).collect();
        (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
    };
    let (psnr, ssim) = (mean(|v| v.psnr), mean(|v| v.ssim));
    let (ms_ssim, lpips, flip) = (mean(|v| v.ms_ssim), mean(|v| v.lpips), mean(|v| v.flip));
    Ok(Evaluation { psnr, ssim, ms_ssim, lpips, flip, steps, seconds, notes, views, skips: None })
}

/// Scores of one picture; what is not defined for it stays `None`, with a note where that is a surprise.
fn measure(
    picture: &RgbImage,
    truth: &RgbImage,
    mask: Option<&[u8]>,
    measures: Measures<'_>,
    note: &mut dyn FnMut(&str),
) -> ViewScore {
    let mut score = ViewScore {
        name: String::new(),
        psnr: None,
        ssim: None,
        ms_ssim: None,
        lpips: None,
        flip: None,
        render_seconds: 0.0,
        files: None,
    };
    let (width, height) = (truth.width() as usize, truth.height() as usize);
    let image = |p| Image::from_u8(width, height, 3, p);
    let (a, b) = match (image(picture.as_raw()), image(truth.as_raw())) {
        (Ok(a), Ok(b)) => (a, b),
        (Err(e), _) | (_, Err(e)) => {
            note(&format!("not measured: {e}"));
            return score;
        }
    };
    let mask: Option<Vec<f32>> = mask.map(|m| m.iter().map(|&m| if m >= 128 { 1.0 } else { 0.0 }).collect());
    let measured = match &mask {
        Some(mask) => masked_psnr(&a, &b, mask),
        None => psnr(&a, &b),
    };
    match measured {
        Ok(db) if db.is_finite() => score.psnr = Some(db),
        Ok(_) => note("equals the truth in every pixel: its infinite PSNR is left out of the mean"),
        Err(e) => note(&format!("no PSNR: {e}")),
    }
    if let Measures::All(weights) = measures {
        let similarity = match &mask {
            Some(mask) => masked_ssim(&a, &b, mask, MaskedSsim::Corrected),
            None => ssim(&a, &b, SsimVariant::REFERENCE),
        };
        match similarity {
            Ok(x) => score.ssim = Some(x),
            Err(e) => note(&format!("no SSIM: {e}")),
        }
        if mask.is_none() && width.min(height) >= MS_SSIM_MIN_SIDE {
            score.ms_ssim = ms_ssim(&a, &b).ok();
        }
        if mask.is_none() {
            score.flip = flip(picture, truth, note);
        }
        if let (Some(weights), None) = (weights, &mask) {
            match weights.distance(&a, &b) {
                Ok(x) => score.lpips = Some(x),
                Err(e) => note(&format!("no LPIPS: {e}")),
            }
        }
    }
    score
}

#[cfg(feature = "flip")]
fn flip(picture: &RgbImage, truth: &RgbImage, note: &mut dyn FnMut(&str)) -> Option<f64> {
    match crate::flip::mean_flip(truth.width(), truth.height(), truth.as_raw(), picture.as_raw()) {
        Ok(x) => Some(x),
        Err(e) => {
            note(&format!("no FLIP: {e}"));
            None
        }
    }
}

#[cfg(not(feature = "flip"))]
fn flip(_: &RgbImage, _: &RgbImage, _: &mut dyn FnMut(&str)) -> Option<f64> {
    None
}

impl Evaluation {
    /// `eval.json`.
    #[expect(clippy::missing_panics_doc, reason = "plain structs always serialise")]
    pub fn json(&self) -> String {
        let mut text = serde_json::to_string_pretty(self).expect("a plain struct serialises");
        text.push('\n');
        text
    }

    /// `eval.csv`: a row a view; empty where not measured.
    pub fn csv(&self) -> String {
        let mut out = String::from("name,psnr,ssim,ms_ssim,lpips,flip,render_seconds\n");
        for v in &self.views {
            let name = match v.name.contains([',', '"', '\n']) {
                true => format!("\"{}\"", v.name.replace('"', "\"\"")),
                false => v.name.clone(),
            };
            let show = |x: Option<f64>| x.map_or_else(String::new, |x| format!("{x:.6}"));
            let scores = [v.psnr, v.ssim, v.ms_ssim, v.lpips, v.flip].map(show).join(",");
            out += &format!("{name},{scores},{:.4}\n", v.render_seconds);
        }
        out
    }

    /// The same as a table for a terminal, means last.
    pub fn table(&self) -> String {
        let widest = self.views.iter().map(|v| v.name.chars().count()).max().unwrap_or(0).clamp(4, 48);
        let row = |name: &str, scores: [Option<f64>; 4]| {
            let cell = |x: Option<f64>, digits: usize| x.map_or_else(|| "n/a".into(), |x| format!("{x:.digits$}"));
            let [psnr, ssim, ms_ssim, lpips] = scores;
            format!(
                "{name:widest$}  {:>8}  {:>7}  {:>7}  {:>7}\n",
                cell(psnr, 3),
                cell(ssim, 4),
                cell(ms_ssim, 4),
                cell(lpips, 4)
            )
        };
        let mut out =
            format!("{:widest$}  {:>8}  {:>7}  {:>7}  {:>7}\n", "view", "PSNR dB", "SSIM", "MS-SSIM", "LPIPS");
        for v in &self.views {
            let name: String = match v.name.chars().count() {
                n if n > widest => std::iter::once('…').chain(v.name.chars().skip(n - widest + 1)).collect(),
                _ => v.name.clone(),
            };
            out += &row(&name, [v.psnr, v.ssim, v.ms_ssim, v.lpips]);
        }
        out += &row("mean", [self.psnr, self.ssim, self.ms_ssim, self.lpips]);
        if let Some(skips) = &self.skips {
            out += &format!("\n{}", skips.table());
        }
        out
    }
}
