//! Training views as the networks render them: what a method judges the photos by.

use super::step::{Chunk, Inputs};
use super::{Recipe, TwoLevel};
use crate::data::Dataset;
use crate::method::{Pixel, ViewSeen};
use crate::system::SystemError;
use rayon::prelude::*;

/// Pixels of one task.
const TASK: usize = 64;

/// A training view, rendered in its own light with all that stood in it.
pub(super) struct Shown {
    size: [usize; 2],
    stride: usize,
    pixels: Vec<Pixel>,
    truth: Vec<[f32; 3]>,
    alpha: Vec<f32>,
}

impl Shown {
    pub(super) fn seen(&self, view: usize) -> ViewSeen<'_> {
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

impl<R: Recipe> TwoLevel<R> {
    /// Render a training view, one ray for each square of `stride` pixels a side; nothing of it is random.
    pub(super) fn show(&self, data: &Dataset, view: usize, stride: u32) -> Result<Shown, SystemError> {
        let mut inputs = Inputs::default();
        let size = data.whole_view(view, stride, &mut inputs.batch)?;
        inputs.put_on(|_| self.background.colour());
        let n = inputs.batch.len();
        let ops = self.ops();
        let ctx = self.context(&ops, data, &inputs);
        let tasks: Vec<Vec<Pixel>> = (0..n.div_ceil(TASK))
            .into_par_iter()
            .map_init(Chunk::default, |chunk, task| {
                self.run(&ctx, task * TASK..((task + 1) * TASK).min(n), chunk);
                chunk.seen.clone()
            })
            .collect();
        Ok(Shown {
            size,
            stride: stride as usize,
            pixels: tasks.concat(),
            truth: inputs.truth,
            alpha: inputs.batch.alpha,
        })
    }

    /// What happens before step `step`: a method looks at all training views, or the networks begin anew. Returns the step as
    /// their schedule counts it.
    pub(super) fn between_steps(&mut self, data: &Dataset, step: u64) -> Result<u64, SystemError> {
        let Some(method) = &self.method else { return Ok(step) };
        let anew = method.begins_anew();
        if let Some(stride) = method.survey(step) {
            self.survey(data, stride)?;
        }
        if anew == Some(step) {
            self.begin_anew()?;
        }
        Ok(match anew {
            Some(first) if step >= first => step - first,
            _ => step,
        })
    }

    /// Show the method every training view.
    fn survey(&mut self, data: &Dataset, stride: u32) -> Result<(), SystemError> {
        for view in 0..data.len() {
            let shown = self.show(data, view, stride)?;
            // What the networks render does not depend on what the method learns here.
            if let Some(method) = &mut self.method {
                method.look(data, &shown.seen(view))?;
            }
        }
        if let Some(method) = &mut self.method {
            method.surveyed();
        }
        Ok(())
    }

    /// New networks for the same method.
    fn begin_anew(&mut self) -> Result<(), SystemError> {
        // Others than the first: the same numbers would repeat their mistakes.
        let seed = self.seed.wrapping_add(1);
        let method = self.method.take();
        let fresh = Self::with_method(self.config.clone(), self.space, self.background, seed, method)?;
        let old = std::mem::replace(self, fresh);
        (self.seed, self.seconds, self.missed, self.cast) = (old.seed, old.seconds, old.missed, old.cast);
        self.trained.count_on(&old.trained);
        Ok(())
    }
}
