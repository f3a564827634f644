//! Training views as the field renders them: what a photo model judges the photos by.

use super::chunk::Chunk;
use super::context::{Placing, StepContext};
use super::driver::RaySystem;
use super::step::Plan;
use super::work::Inputs;
use crate::photo_model::{PhotoModel, Pixel};
use crate::survey::{RenderedView, Surveys};
use engine::data::{Batch, Dataset};
use engine::system::SystemError;
use rayon::prelude::*;

/// Pixels of one task.
const TASK: usize = 256;

/// Samples that a ray evaluates, in the mean at most, in units of [`samples_per_ray`](crate::samplers::OccupancyConfig::samples_per_ray):
/// where nothing is opaque yet, a survey of all photos with the steps of training costs as much as a thousand steps of training.
const MOST_SAMPLES: f64 = 2.0;
/// One pixel in this many says how many samples the rays of a picture evaluate.
const PROBE_EVERY: usize = 64;

impl RaySystem {
    /// The pixels of a view and their rays; nothing of it is random.
    fn of_view(&self, data: &Dataset, view: usize, stride: u32) -> Result<([usize; 2], Inputs), SystemError> {
        let mut batch = Batch::default();
        let size = data.whole_view(view, stride, &mut batch)?;
        Ok((size, self.not_random(batch, self.background.colour())))
    }

    /// What a picture is rendered with: the steps of training, longer where its rays would evaluate more than [`MOST_SAMPLES`].
    fn view_context<'a>(&'a self, inputs: &'a Inputs) -> StepContext<'a> {
        let ctx = self.context(&Plan::PICTURE, inputs);
        let Some(occupancy) = self.sampler.occupancy() else { return ctx };
        let most = MOST_SAMPLES * f64::from(occupancy.config().samples_per_ray);
        let longer = (self.evaluated(&ctx, inputs.batch.len()) / most).max(1.0) as f32;
        StepContext { placing: Placing::March(occupancy, occupancy.stretched(longer)), ..ctx }
    }

    /// Samples that the rays of a picture of `n` pixels evaluate before they are opaque or end, in the mean over some of them.
    fn evaluated(&self, ctx: &StepContext<'_>, n: usize) -> f64 {
        let probes = n.div_ceil(PROBE_EVERY);
        let evaluated: u64 = (0..probes)
            .into_par_iter()
            .map_init(
                || Chunk::new(&self.field, self.head.as_ref()),
                |chunk, k| {
                    let pixel = k * PROBE_EVERY;
                    chunk.sample(ctx, pixel..pixel + 1);
                    chunk.evaluated()
                },
            )
            .sum();
        evaluated as f64 / probes.max(1) as f64
    }
}

impl Surveys for RaySystem {
    fn photo_model(&self) -> Option<&dyn PhotoModel> {
        self.photo_model.as_deref()
    }

    fn photo_model_mut(&mut self) -> Option<&mut Box<dyn PhotoModel>> {
        self.photo_model.as_mut()
    }

    fn render_training_view(&self, data: &Dataset, view: usize, stride: u32) -> Result<RenderedView, SystemError> {
        let (size, inputs) = self.of_view(data, view, stride)?;
        let (n, ctx) = (inputs.batch.len(), self.view_context(&inputs));
        let tasks: Vec<Vec<(Pixel, [f32; 3])>> = (0..n.div_ceil(TASK))
            .into_par_iter()
            .map_init(
                || Chunk::new(&self.field, self.head.as_ref()),
                |chunk, task| {
                    let pixels = task * TASK..((task + 1) * TASK).min(n);
                    chunk.sample(&ctx, pixels.clone());
                    let places = chunk.render_ends(&ctx, pixels);
                    chunk.seen.iter().copied().zip(places).collect()
                },
            )
            .collect();
        Ok(RenderedView::new(size, stride, inputs.batch, inputs.truth, tasks.into_iter().flatten()))
    }

    fn begin_anew(&mut self, data: &Dataset) -> Result<(), SystemError> {
        let seed = self.seed.wrapping_add(1);
        let photo_model = self.photo_model.take();
        let mut fresh =
            Self::new(self.config.clone(), self.space, self.background, seed, self.name, photo_model, None)?;
        fresh.carve(data)?;
        (fresh.seed, fresh.seconds, fresh.guard) = (self.seed, self.seconds, self.guard);
        fresh.skipped = std::mem::take(&mut self.skipped);
        *self = fresh;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::budget_tests::{biased, occupancy};
    use super::*;
    use crate::plan::made::{Points, capture};
    use crate::samplers::OccupancyConfig;
    use crate::space::{Space, SpaceKind};
    use engine::options::Background;
    use glam::DVec3;

    #[test]
    fn pictures_of_a_field_that_is_mist_everywhere_take_longer_steps_and_others_those_of_training() {
        let (_, data) = capture(Points::None);
        let evaluated = |density_bias: f32| {
            let mut config = biased(SpaceKind::Contracted, density_bias);
            let grid = occupancy(&mut config);
            *grid = OccupancyConfig { samples_per_ray: 12.0, step_min: 0.002, step_cone: 0.002, ..*grid };
            let space = Space::contracted(DVec3::ZERO, 1.0, 4.0, 0.01);
            let driver = RaySystem::new(config, space, Background::Random, 3, "ngp", None, None).unwrap();
            let (_, inputs) = driver.of_view(&data, 0, 1).unwrap();
            let n = inputs.batch.len();
            let of_training = driver.evaluated(&driver.context(&Plan::PICTURE, &inputs), n);
            (of_training, driver.evaluated(&driver.view_context(&inputs), n))
        };
        let (mist, longer) = evaluated(-9.0);
        assert!(mist > 60.0 && (12.0..36.0).contains(&longer), "{mist} {longer}");
        let (wall, same) = evaluated(9.0);
        assert!(wall <= 24.0 && wall == same, "{wall} {same}");
    }
}
