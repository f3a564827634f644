//! What terms of scene flow read of the rays that take part, and the gradients that they add.

use super::chosen::Chosen;
use super::film::{Film, PASSES};
use render_core::space_map::SpaceMap;
use std::fmt::Debug;

/// The moving part alone in one frame, along the rays of another.
#[derive(Clone, Debug, Default)]
pub(crate) struct Seen {
    /// `[rays]`, whether there is such a frame; what is seen of a ray without one counts for nothing.
    pub(crate) known: Vec<bool>,
    /// `[3][m]`, where the moving samples are in that frame, in the unit cube.
    pub(crate) x: Vec<f32>,
    /// `[6][m]`, their scene flow there: to the frame after that one, to the frame before.
    pub(crate) flow: Vec<f32>,
    /// `[2][m]`, whether they are hidden in these; empty where nothing is said of it.
    pub(crate) hidden: Vec<f32>,
    /// `[m]`, the blend weight of the moving part.
    pub(crate) blend: Vec<f32>,
    /// `[rays][3]`, rendered colours.
    pub(crate) colour: Vec<f32>,
    /// `[n]`, weights of all samples.
    pub(crate) w: Vec<f32>,
    /// `[rays]`, the moving part's share of what each ray shows of both parts together; of the rays' own frame alone, else empty.
    pub(crate) moving_share: Vec<f32>,
}

/// Gradients with respect to [`Seen`].
#[derive(Clone, Debug, Default)]
pub(crate) struct SeenBars {
    pub(crate) flow: Vec<f32>,
    pub(crate) hidden: Vec<f32>,
    pub(crate) blend: Vec<f32>,
    pub(crate) colour: Vec<f32>,
    pub(crate) w: Vec<f32>,
    pub(crate) moving_share: Vec<f32>,
}

impl SeenBars {
    /// All zero, as long as what was seen.
    pub(crate) fn begin(&mut self, seen: &Seen) {
        for (bar, of) in [
            (&mut self.flow, &seen.flow),
            (&mut self.hidden, &seen.hidden),
            (&mut self.blend, &seen.blend),
            (&mut self.colour, &seen.colour),
            (&mut self.w, &seen.w),
            (&mut self.moving_share, &seen.moving_share),
        ] {
            bar.clear();
            bar.resize(of.len(), 0.0);
        }
    }
}

/// The rays of a chunk that take part, and what is seen along them.
pub(crate) struct FlowRays<'a> {
    pub(crate) rays: &'a Chosen,
    /// The last of them is of no rays where it is not its time.
    pub(crate) seen: [&'a Seen; PASSES],
    /// Which way the last pass goes, `NEXT` or `PREVIOUS`.
    pub(crate) chained: Option<usize>,
    pub(crate) film: &'a Film,
    pub(crate) map: SpaceMap,
    /// Half the side of space, in NDC its near plane: world units.
    pub(crate) unit: f64,
    /// Factor of what priors say.
    pub(crate) fade: f64,
    /// One over the pixels of the batch that count.
    pub(crate) share: f32,
    /// What the cost of a sample is multiplied by in a mean over samples, then over pixels.
    pub(crate) per_sample: f64,
}

/// A term of the loss over such rays.
pub(crate) trait FlowTerm: Debug + Send + Sync {
    /// Add what the rays cost to `loss`, summed over pixels, and [`FlowRays::share`] times its derivatives to `bars`.
    fn add(&self, seen: &FlowRays<'_>, bars: &mut [SeenBars; PASSES], loss: &mut f64);
}
