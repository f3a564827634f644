//! Training views as the field renders them: what a method judges the photos by.

use super::chunk::Chunk;
use super::step::{Plan, truth_on};
use super::{Inputs, Ngp};
use crate::data::Dataset;
use crate::method::{Method, Pixel};
use crate::static_scene::survey::{Shown, Surveys};
use crate::system::SystemError;
use rayon::prelude::*;

/// Pixels of one task.
const TASK: usize = 2048;

/// Where each ray's first sample lies within its step.
const JITTER: f32 = 0.5;

impl Surveys for Ngp {
    fn method(&self) -> Option<&dyn Method> {
        self.method.as_deref()
    }

    fn method_mut(&mut self) -> Option<&mut Box<dyn Method>> {
        self.method.as_mut()
    }

    fn show(&self, data: &Dataset, view: usize, stride: u32) -> Result<Shown, SystemError> {
        let mut inputs = Inputs::default();
        let size = data.whole_view(view, stride, &mut inputs.batch)?;
        let n = inputs.batch.len();
        inputs.rays.clone_from(&inputs.batch.rays);
        inputs.background = vec![self.background.colour(); n];
        inputs.jitter = vec![JITTER; (1 + self.proposals.as_ref().map_or(0, |p| p.fields.len())) * n];
        truth_on(&inputs.batch, &inputs.background, &mut inputs.truth);
        let plan = Plan { step: u64::MAX, per_pixel: 1, share: 1.0 };
        let ctx = self.context(&plan, &inputs);
        let tasks: Vec<Vec<(Pixel, [f32; 3])>> = (0..n.div_ceil(TASK))
            .into_par_iter()
            .map_init(
                || Chunk::new(&self.field),
                |chunk, task| {
                    let pixels = task * TASK..((task + 1) * TASK).min(n);
                    chunk.sample(&ctx, pixels.clone());
                    let places = chunk.look_where(&ctx, pixels);
                    chunk.seen.iter().copied().zip(places).collect()
                },
            )
            .collect();
        Ok(Shown::new(size, stride, inputs.batch, inputs.truth, tasks.into_iter().flatten()))
    }

    fn begin_anew(&mut self, data: &Dataset) -> Result<(), SystemError> {
        let seed = self.seed.wrapping_add(1);
        let method = self.method.take();
        let mut fresh = Self::with_method(self.config.clone(), self.space, self.background, seed, method)?;
        fresh.carve(data)?;
        (fresh.seed, fresh.seconds, fresh.guard) = (self.seed, self.seconds, self.guard);
        fresh.skipped = std::mem::take(&mut self.skipped);
        *self = fresh;
        Ok(())
    }
}
