//! Training views as the field renders them: what a method judges the photos by.

use super::chunk::Chunk;
use super::step::{Plan, truth_on};
use super::{Inputs, Ngp};
use crate::data::Dataset;
use crate::method::{Pixel, ViewSeen};
use crate::system::SystemError;
use rayon::prelude::*;

/// Pixels of one task.
const TASK: usize = 2048;

/// Where each ray's first sample lies within its step.
const JITTER: f32 = 0.5;

/// A training view, rendered in its own light with all that stood in it.
pub(super) struct Shown {
    pub(super) size: [usize; 2],
    pub(super) pixels: Vec<Pixel>,
    pub(super) truth: Vec<[f32; 3]>,
}

impl Shown {
    pub(super) fn seen(&self, view: usize) -> ViewSeen<'_> {
        ViewSeen { view, size: self.size, pixels: &self.pixels, truth: &self.truth }
    }
}

/// Render a training view, one ray a pixel.
pub(super) fn show(ngp: &Ngp, data: &Dataset, view: usize) -> Result<Shown, SystemError> {
    let mut inputs = Inputs::default();
    data.whole_view(view, &mut inputs.batch)?;
    let n = inputs.batch.len();
    inputs.rays.clone_from(&inputs.batch.rays);
    inputs.background = vec![ngp.background.colour(); n];
    inputs.jitter = vec![JITTER; (1 + ngp.proposals.as_ref().map_or(0, |p| p.fields.len())) * n];
    truth_on(&inputs.batch, &inputs.background, &mut inputs.truth);
    let plan = Plan { step: u64::MAX, per_pixel: 1, share: 1.0 };
    let ctx = ngp.context(&plan, &inputs);
    let tasks: Vec<Vec<Pixel>> = (0..n.div_ceil(TASK))
        .into_par_iter()
        .map_init(
            || Chunk::new(&ngp.field),
            |chunk, task| {
                let pixels = task * TASK..((task + 1) * TASK).min(n);
                chunk.sample(&ctx, pixels.clone());
                chunk.look_ahead(&ctx, pixels);
                chunk.seen.clone()
            },
        )
        .collect();
    let camera = data.view(view).camera;
    let size = [camera.width as usize, camera.height as usize];
    Ok(Shown { size, pixels: tasks.concat(), truth: inputs.truth })
}

/// See [`crate::system::System::visibility`].
pub(super) fn visibility(ngp: &Ngp, data: &Dataset, view: usize) -> Result<Option<Vec<f32>>, SystemError> {
    let Some(method) = &ngp.method else { return Ok(None) };
    Ok(method.visibility(&show(ngp, data, view)?.seen(view)))
}

impl Ngp {
    /// Show the method every training view, then start with a new field.
    pub(super) fn survey(&mut self, data: &Dataset) -> Result<(), SystemError> {
        let Some(mut method) = self.method.take() else { return Ok(()) };
        for view in 0..data.len() {
            // What the field renders does not depend on what the method learns here.
            let shown = show(self, data, view)?;
            method.survey(data, &shown.seen(view))?;
        }
        let mut fresh = Self::with_method(
            self.config.clone(),
            self.space.clone(),
            self.background,
            // Another field than the first: the same numbers would repeat its mistakes.
            self.seed.wrapping_add(1),
            Some(method),
        )?;
        fresh.seed = self.seed;
        fresh.carve(data)?;
        (fresh.seconds, fresh.guard) = (self.seconds, self.guard);
        *self = fresh;
        Ok(())
    }
}
