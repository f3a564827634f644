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
pub(crate) struct Shown {
    size: [usize; 2],
    stride: usize,
    pixels: Vec<Pixel>,
    truth: Vec<[f32; 3]>,
    alpha: Vec<f32>,
}

impl Shown {
    pub(crate) fn seen(&self, view: usize) -> ViewSeen<'_> {
        ViewSeen {
            view,
            size: self.size,
            stride: self.stride,
            pixels: &self.pixels,
            truth: &self.truth,
            alpha: &self.alpha,
        }
    }
}

/// Render a training view, one ray for each square of `stride` pixels a side.
pub(crate) fn show(ngp: &Ngp, data: &Dataset, view: usize, stride: u32) -> Result<Shown, SystemError> {
    let mut inputs = Inputs::default();
    let size = data.whole_view(view, stride, &mut inputs.batch)?;
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
    Ok(Shown { size, stride: stride as usize, pixels: tasks.concat(), truth: inputs.truth, alpha: inputs.batch.alpha })
}

/// See [`crate::system::System::visibility`].
pub(super) fn visibility(ngp: &Ngp, data: &Dataset, view: usize) -> Result<Option<Vec<f32>>, SystemError> {
    let Some(method) = &ngp.method else { return Ok(None) };
    Ok(method.visibility(&show(ngp, data, view, 1)?.seen(view)))
}

impl Ngp {
    /// What happens before step `step`: a method looks at all training views, or the field begins anew. Returns the step as
    /// the field's schedules count it.
    pub(super) fn between_steps(&mut self, data: &Dataset, step: u64) -> Result<u64, SystemError> {
        let Some(method) = &self.method else { return Ok(step) };
        let anew = method.begins_anew();
        if let Some(stride) = method.survey(step) {
            self.survey(data, stride)?;
        }
        if anew == Some(step) {
            self.begin_anew(data)?;
        }
        Ok(match anew {
            Some(first) if step >= first => step - first,
            _ => step,
        })
    }

    /// Show the method every training view.
    fn survey(&mut self, data: &Dataset, stride: u32) -> Result<(), SystemError> {
        for view in 0..data.len() {
            let shown = show(self, data, view, stride)?;
            // What the field renders does not depend on what the method learns here.
            if let Some(method) = &mut self.method {
                method.look(data, &shown.seen(view))?;
            }
        }
        if let Some(method) = &mut self.method {
            method.surveyed();
        }
        Ok(())
    }

    /// A new field for the same method.
    fn begin_anew(&mut self, data: &Dataset) -> Result<(), SystemError> {
        // Other numbers than the first: the same would repeat its mistakes.
        let seed = self.seed.wrapping_add(1);
        let method = self.method.take();
        let mut fresh = Self::with_method(self.config.clone(), self.space, self.background, seed, method)?;
        fresh.carve(data)?;
        (fresh.seed, fresh.seconds, fresh.guard) = (self.seed, self.seconds, self.guard);
        *self = fresh;
        Ok(())
    }
}
