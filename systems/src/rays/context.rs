//! What all chunks of a training step share: the field, where samples go, the batch, and what errors cost.

use super::head::Head;
use super::scene_flow::FlowContext;
use crate::fields::Field;
use crate::photo_model::{Codes, PhotoModel, Pixel, PixelBar};
use crate::samplers::{Marcher, MeasuredDepth, Occupancy, Proposals};
use crate::space::Space;
use crate::terms::RayTerm;
use crate::warps::{Deform, TimeSteps};
use engine::data::Batch;
use field_core::rng::Rng;
use losses::kernel::Kernel;
use render_core::ray::Ray;

/// How a step places samples.
#[derive(Clone, Copy)]
pub(super) enum Placing<'a> {
    /// A march through an occupancy grid.
    March(&'a Occupancy, Marcher),
    /// By proposals, whose weights have this exponent.
    Proposals(&'a Proposals, f32),
}

impl<'a> Placing<'a> {
    /// The proposals, where these place the samples.
    pub(super) fn proposals(&self) -> Option<&'a Proposals> {
        match *self {
            Self::March(..) => None,
            Self::Proposals(proposals, _) => Some(proposals),
        }
    }
}

/// What all chunks of a step share.
pub(super) struct StepContext<'a> {
    pub(super) field: &'a Field,
    pub(super) space: &'a Space,
    /// The transient head, where there is one.
    pub(super) head: Option<&'a Head>,
    pub(super) placing: Placing<'a>,
    /// Part of a sample's interval that lies in front of it.
    pub(super) lead: f32,
    pub(super) batch: &'a Batch,
    /// The time step of each view that the batch has pixels of.
    pub(super) time_steps: &'a TimeSteps,
    /// What else the loss depends on.
    pub(super) photo_model: Option<&'a dyn PhotoModel>,
    /// Codes of the training views.
    pub(super) appearance: Option<Codes<'a>>,
    pub(super) transient: Option<Codes<'a>>,
    /// Rays of a pixel: its colour is the mean of theirs.
    pub(super) per_pixel: usize,
    /// `[pixels * per_pixel]`
    pub(super) rays: &'a [Ray],
    /// Background and true colour of each pixel of the batch, the one on the other.
    pub(super) background: &'a [[f32; 3]],
    pub(super) truth: &'a [[f32; 3]],
    /// `[1 + proposals][rays]`, jitter of each ray's first sample, `[0, 1)`.
    pub(super) jitter: &'a [f32],
    /// Random neighbours of the samples that a loss of the deformation compares with theirs.
    pub(super) neighbours: Rng,
    /// Measured depth.
    pub(super) cues: Option<&'a MeasuredDepth>,
    pub(super) kernel: Kernel,
    /// What whole rays cost, besides measured depth.
    pub(super) terms: &'a [Box<dyn RayTerm>],
    /// What is known of the frames beside, where something moves and that is asked for.
    pub(super) flow: Option<FlowContext<'a>>,
    /// Optical depth behind which nothing is evaluated.
    pub(super) depth_limit: f64,
    /// Part of a ray's weight that faint samples are left out with.
    pub(super) faint: f32,
    /// One over the pixels of the batch that count.
    pub(super) share: f32,
    /// Whether the gradient goes on to the rays, and to nothing else.
    pub(super) by_ray: bool,
}

impl StepContext<'_> {
    /// Measured distance along the ray of pixel `i`, internal units; 0 where nothing is known.
    pub(super) fn measured(&self, i: usize) -> f32 {
        let Some(cues) = self.cues else { return 0.0 };
        // A share of the width is not enough: a pixel is asked for, not a place.
        let [x, y] = self.batch.pixel[i];
        cues.at(self.batch.view[i], [x, y])
    }

    /// Time of pixel `i`, in `[-1, 1]`; `None` where the field knows no time.
    pub(super) fn time_of(&self, i: usize) -> Option<f32> {
        self.time_steps.times.get(self.batch.view[i] as usize).copied()
    }

    /// Everything that whole rays cost.
    pub(super) fn terms(&self) -> impl Iterator<Item = &dyn RayTerm> {
        let depth = self.cues.filter(|cues| cues.holds()).map(|cues| cues as &dyn RayTerm);
        self.terms.iter().map(|term| &**term).chain(depth)
    }

    /// Whether a loss of the deformation depends on the weights of samples.
    pub(super) fn weighs_deform(&self) -> bool {
        self.field.deform().is_some_and(Deform::costs_by_weight)
    }

    /// What the error of pixel `i` costs and the derivative of that.
    pub(super) fn loss(&self, i: usize, pixel: &Pixel) -> (f32, PixelBar) {
        let truth = self.truth[i];
        match self.photo_model {
            Some(photo_model) => photo_model.loss(i, pixel, truth),
            None => {
                let value = |c: usize| self.kernel.value(pixel.rgb[c], truth[c]);
                let derivative = |c: usize| self.kernel.derivative(pixel.rgb[c], truth[c]) / 3.0;
                ((value(0) + value(1) + value(2)) / 3.0, PixelBar::colour([0, 1, 2].map(derivative)))
            }
        }
    }
}
