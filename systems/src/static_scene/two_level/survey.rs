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
    pixels: Vec<Pixel>,
    truth: Vec<[f32; 3]>,
}

impl Shown {
    pub(super) fn seen(&self, view: usize) -> ViewSeen<'_> {
        ViewSeen { view, size: self.size, pixels: &self.pixels, truth: &self.truth }
    }
}

impl<R: Recipe> TwoLevel<R> {
    /// Render a training view; nothing of it is random.
    pub(super) fn show(&self, data: &Dataset, view: usize) -> Result<Shown, SystemError> {
        let mut inputs = Inputs::default();
        data.whole_view(view, &mut inputs.batch)?;
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
        let camera = data.view(view).camera;
        let size = [camera.width as usize, camera.height as usize];
        Ok(Shown { size, pixels: tasks.concat(), truth: inputs.truth })
    }

    /// Show the method every training view, then start with new networks.
    pub(super) fn survey(&mut self, data: &Dataset) -> Result<(), SystemError> {
        for view in 0..data.len() {
            let shown = self.show(data, view)?;
            // What the networks render does not depend on what the method learns here.
            if let Some(method) = &mut self.method {
                method.survey(data, &shown.seen(view))?;
            }
        }
        // Others than the first: the same numbers would repeat their mistakes.
        let seed = self.seed.wrapping_add(1);
        let method = self.method.take();
        let fresh = Self::with_method(self.config.clone(), self.space.clone(), self.background, seed, method)?;
        let (seed, seconds, missed, cast) = (self.seed, self.seconds, self.missed, self.cast);
        let guard = std::mem::take(&mut self.guard);
        *self = Self { seed, seconds, missed, cast, guard, ..fresh };
        Ok(())
    }
}
