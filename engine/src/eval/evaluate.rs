//! All held-out views, one after the other.

use super::correspondence::Correspondence;
use super::motion::MotionScore;
use super::protocol::{Protocol, Scored};
use super::score::{Evaluation, KnownView, Measured, Measures, ViewScore};
use super::view::{Terms, ViewResult, measure_view};
use crate::data::Dataset;
use crate::error::RunError;
use crate::progress::Reached;
use crate::system::System;
use std::ops::ControlFlow;

/// Render and measure every view of `data`; `each` sees them as they come, whole, before views are compared with each other.
/// Where it breaks, the views after are left out, and means are over those measured. Once the query's halt is raised the view at
/// hand is left out, too: it is not whole.
///
/// # Errors
/// [`RunError::Scene`] when an image cannot be read, [`RunError::Option`] for views that are too narrow to have halves where
/// those are scored, and whatever `each` fails with.
///
/// # Panics
/// As [`render`](crate::render::render).
pub fn evaluate(
    system: &dyn System,
    data: &Dataset,
    terms: &Terms<'_>,
    at: Reached,
    each: impl FnMut(ViewResult<'_>) -> Result<ControlFlow<()>, RunError>,
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
    at: Reached,
    known: &dyn Fn(usize) -> Option<KnownView>,
    mut each: impl FnMut(ViewResult<'_>) -> Result<ControlFlow<()>, RunError>,
) -> Result<Evaluation, RunError> {
    let Terms { query, protocol, measures, .. } = *terms;
    need_halves(data, protocol)?;
    let mut views = Vec::with_capacity(data.len());
    let mut notes = Vec::new();
    let mut points = match (measures, protocol.scored) {
        (Measures::All(_), Scored::Whole) => Correspondence::of(data)?,
        _ => Correspondence::default(),
    };
    for index in 0..data.len() {
        if query.halt.raised() {
            break;
        }
        if let Some(known) = if points.wants(index) { None } else { known(index) } {
            notes.extend(known.notes);
            views.push(known.score);
            continue;
        }
        let Some(mut view) = measure_view(system, data, index, terms, points.wants(index))? else { break };
        let next = each(ViewResult {
            index,
            score: &view.score,
            notes: &view.notes,
            rendered: &view.rendered,
            picture: &view.picture,
            truth: &view.truth,
        })?;
        notes.append(&mut view.notes);
        points.keep(index, std::mem::take(&mut view.rendered.layers.canonical));
        views.push(view.score);
        if next.is_break() {
            break;
        }
    }
    // Views are compared with each other where all were rendered.
    let compared = if views.len() == data.len() { points.scores(data) } else { Vec::new() };
    for (index, found) in compared {
        (views[index].motion.flow_error, views[index].motion.flow_found) = (Some(found.error), Some(found.found));
    }
    Ok(summed_up(views, notes, data, protocol, at))
}

/// The evaluation of all views of `data`, of which `views` were measured.
fn summed_up(
    views: Vec<ViewScore>,
    notes: Vec<String>,
    data: &Dataset,
    protocol: &Protocol,
    at: Reached,
) -> Evaluation {
    let mean = |value: fn(&ViewScore) -> Option<f64>| {
        let values: Vec<f64> = views.iter().filter_map(value).collect();
        (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
    };
    let left = data.len() - views.len();
    Evaluation {
        split: Measured::of(data),
        psnr: mean(|v| v.psnr),
        psnr_object: mean(|v| v.psnr_object),
        motion: MotionScore::mean(views.iter().map(|v| v.motion)),
        fog: mean(|v| v.fog),
        ssim: mean(|v| v.ssim),
        ms_ssim: mean(|v| v.ms_ssim),
        lpips: mean(|v| v.lpips),
        flip: mean(|v| v.flip),
        steps: at.step,
        seconds: at.seconds,
        protocol: protocol.clone(),
        notes,
        views,
        left,
        stopped: left > 0,
        written: false,
        unwritten: Vec::new(),
        skips: None,
    }
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
