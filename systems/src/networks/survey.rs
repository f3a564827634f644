//! Training views as the networks render them: what a photo model judges the photos by.

use super::chunk::{Chunk, Inputs};
use super::recipe::Recipe;
use super::two_level::TwoLevel;
use crate::photo_model::{PhotoModel, Pixel};
use crate::survey::{RenderedView, Surveys};
use engine::data::Dataset;
use engine::system::SystemError;
use rayon::prelude::*;

/// Pixels of one task.
const TASK: usize = 64;

impl<R: Recipe> Surveys for TwoLevel<R> {
    fn photo_model(&self) -> Option<&dyn PhotoModel> {
        self.photo_model.as_deref()
    }

    fn photo_model_mut(&mut self) -> Option<&mut Box<dyn PhotoModel>> {
        self.photo_model.as_mut()
    }

    fn render_training_view(&self, data: &Dataset, view: usize, stride: u32) -> Result<RenderedView, SystemError> {
        let mut inputs = Inputs::default();
        let size = data.whole_view(view, stride, &mut inputs.batch)?;
        inputs.put_on(|_| self.background.colour());
        let n = inputs.batch.len();
        let ops = self.ops();
        let ctx = self.context(&ops, &inputs);
        let tasks: Vec<Vec<Pixel>> = (0..n.div_ceil(TASK))
            .into_par_iter()
            .map_init(Chunk::default, |chunk, task| {
                self.run(&ctx, data, task * TASK..((task + 1) * TASK).min(n), chunk);
                chunk.seen.clone()
            })
            .collect();
        // Networks have no cube of their own to say places in.
        let rendered = tasks.into_iter().flatten().map(|pixel| (pixel, [f32::NAN; 3]));
        Ok(RenderedView::new(size, stride, inputs.batch, inputs.truth, rendered))
    }

    fn begin_anew(&mut self, _data: &Dataset) -> Result<(), SystemError> {
        let seed = self.seed.wrapping_add(1);
        let photo_model = self.photo_model.take();
        let fresh = Self::with_photo_model(self.config.clone(), self.space, self.background, seed, photo_model)?;
        let old = std::mem::replace(self, fresh);
        (self.seed, self.seconds, self.missed, self.cast) = (old.seed, old.seconds, old.missed, old.cast);
        (self.still, self.placed) = (old.still, old.placed);
        self.left_out = old.left_out;
        self.trained.count_on(&old.trained);
        Ok(())
    }
}
