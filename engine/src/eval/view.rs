//! One held-out view: rendered, measured, and handed on whole.

use super::fog::fog;
use super::half;
use super::masked::{inside, object_mask};
use super::measure::measure;
use super::motion::MotionScore;
use super::protocol::{HeldOutPhoto, Protocol, Scored};
use super::scene_flow;
use super::score::{Measures, ViewScore};
use crate::data::Dataset;
use crate::error::RunError;
use crate::picture::{colour, over_background};
use crate::render::{Rendered, render};
use crate::system::{Canonical, LayerRequest, Median, Query, System};
use image::RgbImage;

/// How views are rendered and measured.
#[derive(Clone, Copy)]
pub struct Terms<'a> {
    /// How they are rendered: [`Protocol::query`].
    pub query: &'a Query,
    /// In which appearance, and what is scored.
    pub protocol: &'a Protocol,
    /// What is measured.
    pub measures: Measures<'a>,
    /// Seed of the pixels an appearance is fitted to.
    pub seed: u64,
}

/// A view with everything that was seen of it.
pub struct ViewResult<'a> {
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

/// A view that was rendered and measured.
pub(super) struct RenderedView {
    pub(super) score: ViewScore,
    /// What a reader of the scores should know.
    pub(super) notes: Vec<String>,
    pub(super) rendered: Rendered,
    pub(super) picture: RgbImage,
    pub(super) truth: RgbImage,
}

/// Render and measure view `index` of `data`, with its canonical points where another view is compared with them. `None` once the
/// query's halt is raised: the view is not whole.
///
/// # Errors
/// [`RunError::Scene`] when an image or a truth cannot be read.
pub(super) fn measure_view(
    system: &dyn System,
    data: &Dataset,
    index: usize,
    terms: &Terms<'_>,
    is_compared: bool,
) -> Result<Option<RenderedView>, RunError> {
    let Terms { query, protocol, measures, seed } = *terms;
    let halt = &query.halt;
    let mut notes = Vec::new();
    let view = data.view(index);
    let image = data.image(index)?;
    let truth = over_background(&image, query.background);
    let own =
        protocol.appearance_of(system, data, index, HeldOutPhoto { image: &image, on_background: &truth }, query, seed);
    if own.is_none() && protocol.fit_steps.is_some() {
        notes.push(format!("{}: no pixel of its left half is used: rendered in the mean appearance", view.name));
    }
    let appearance = own.unwrap_or_else(|| query.appearance.clone());
    let canonical = if is_compared { Canonical::Compute } else { query.layers.canonical };
    let layers = LayerRequest { canonical, median: Median::Skip, ..query.layers };
    let own_query = Query { appearance, time: view.time, layers, ..query.clone() };
    let clock = std::time::Instant::now();
    let rendered = render(system, &view.camera, &own_query);
    let render_seconds = clock.elapsed().as_secs_f64();
    if halt.raised() {
        return Ok(None);
    }
    let picture = colour(&rendered);
    let object = data.is_cut_out().then(|| object_mask(&image)).flatten();
    let mut note = |note: &str| notes.push(format!("{}: {note}", view.name));
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
        score.motion = MotionScore::of(view, &rendered, &picture, &truth, mask)?;
        if matches!(measures, Measures::All(_)) {
            scene_flow::score(system, view, &mut score.motion);
        }
    }
    if matches!(measures, Measures::All(_)) && data.time_steps() <= 1 {
        score.fog = fog(system, view, halt);
    }
    Ok((!halt.raised()).then_some(RenderedView { score, notes, rendered, picture, truth }))
}
