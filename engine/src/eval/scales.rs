//! How good the held-out views are when they are seen from further away: at full, half, quarter … size.
//!
//! The truth of a scale is the mean of the held-out image over squares of pixels, so that every measured pixel is what a
//! camera with larger pixels would have seen. A field that is sampled at points shows the difference: it has more detail
//! than such a pixel can hold, and aliases.

use super::evaluate::evaluate;
use super::score::Measured;
use super::view::Terms;
use crate::data::Dataset;
use crate::error::RunError;
use crate::folder::{EVAL_SCALES, Place, RENDERS};
use crate::names::stem;
use crate::output::{make_folder, note_unwritten, write_file};
use crate::picture::write_png;
use crate::progress::{Meter, Observer, Reached};
use crate::system::System;
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;

/// Scores at one scale, means over the views.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ScaleScore {
    /// Length of a pixel's side, in pixels of full size: 1, 2, 4, …
    pub pixel: u32,
    /// Columns and rows of the first view.
    pub size: [u32; 2],
    /// Peak signal-to-noise ratio, dB.
    pub psnr: Option<f64>,
    /// Structural similarity; `None` for images under 11 pixels a side.
    pub ssim: Option<f64>,
    /// Seconds to render a view.
    pub render_seconds: f64,
}

/// Scores at all scales: the content of `eval_scales.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ScaleTable {
    /// Which views were measured; `test` in files that do not say.
    #[serde(default)]
    pub split: Measured,
    /// Full size first.
    pub scales: Vec<ScaleScore>,
    /// What could not be written, a line each; not part of the file.
    #[serde(skip)]
    pub unwritten: Vec<String>,
}

impl ScaleTable {
    /// A row a scale, for a terminal.
    pub fn table(&self) -> String {
        let mut out = format!("{:>5}  {:>9}  {:>8}  {:>7}  {:>8}\n", "scale", "size", "PSNR dB", "SSIM", "s a view");
        for s in &self.scales {
            let cell = |x: Option<f64>, digits: usize| x.map_or_else(|| "n/a".into(), |x| format!("{x:.digits$}"));
            let scale = if s.pixel == 1 { "1".into() } else { format!("1/{}", s.pixel) };
            let size = format!("{}x{}", s.size[0], s.size[1]);
            let (psnr, ssim) = (cell(s.psnr, 3), cell(s.ssim, 4));
            out += &format!("{scale:>5}  {size:>9}  {psnr:>8}  {ssim:>7}  {:>8.3}\n", s.render_seconds);
        }
        if self.split == Measured::Validation {
            out += "measured: validation views\n";
        }
        out
    }
}

/// Render and measure all views of `data` at `scales` scales; the pictures go to `renders/scale_2` and so on. An observer that
/// asks to stop gets the scales that are done; they are not written to `eval_scales.json`. Scores come back even where a
/// file cannot be written.
pub(crate) fn evaluate_scales(
    place: Place<'_>,
    system: &dyn System,
    data: &Dataset,
    terms: &Terms<'_>,
    scales: u32,
    observer: &mut dyn Observer,
) -> Result<ScaleTable, RunError> {
    let Place { storage, folder, home } = place;
    let smallest = data.views().iter().map(|v| v.camera.width.min(v.camera.height)).min().unwrap_or(0);
    if scales == 0 || smallest.checked_shr(scales - 1).unwrap_or(0) == 0 {
        return Err(RunError::Option(format!(
            "`--scales {scales}`: the smallest held-out side is {smallest} pixels; the smallest scale needs one at least"
        )));
    }
    let (mut rows, mut unwritten) = (Vec::new(), Vec::new());
    let mut meter = Meter::new("held-out view", data.len() * scales as usize);
    for level in 0..scales {
        let (data, pixel) = (data.at_level(level), 1 << level);
        let renders = folder.join(RENDERS).join(format!("scale_{pixel}"));
        note_unwritten(home.guard(|| make_folder(&renders)), &mut unwritten)?;
        let scores = evaluate(system, &data, terms, Reached::default(), |seen| {
            let name = format!("{:03}_{}", seen.index, stem(&data.view(seen.index).name));
            for (ending, picture) in [("", seen.picture), ("_truth", seen.truth)] {
                let path = renders.join(format!("{name}{ending}.png"));
                let written = home.guard(|| write_png(storage, &path, picture));
                note_unwritten(written, &mut unwritten)?;
            }
            meter.advance(observer);
            Ok(if observer.stop_asked() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
        })?;
        // A scale that was begun and not finished has no mean.
        if scores.left > 0 {
            return Ok(ScaleTable { split: Measured::of(&data), scales: rows, unwritten });
        }
        let seconds: f64 = scores.views.iter().map(|v| v.render_seconds).sum();
        let camera = &data.view(0).camera;
        rows.push(ScaleScore {
            pixel,
            size: [camera.width, camera.height],
            psnr: scores.psnr,
            ssim: scores.ssim,
            render_seconds: seconds / data.len() as f64,
        });
    }
    let mut table = ScaleTable { split: Measured::of(data), scales: rows, unwritten };
    let mut text = serde_json::to_string_pretty(&table).expect("a plain struct serialises");
    text.push('\n');
    let written = home.guard(|| write_file(storage, &folder.join(EVAL_SCALES), text.as_bytes()));
    note_unwritten(written, &mut table.unwritten)?;
    Ok(table)
}
