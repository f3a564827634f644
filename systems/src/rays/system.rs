//! What the engine asks of the driver.

use super::chunk::Chunk;
use super::driver::RaySystem;
use super::point_flow::LearnedFlow;
use super::{account, fit, points, render, state};
use crate::fields::MovingPart;
use crate::samplers::Occupancy;
use crate::static_maps::StaticMaps;
use crate::survey::Surveys;
use crate::warps::Deform;
use engine::data::Dataset;
use engine::system::{
    Appearance, Fit, FlowSource, Layers, Query, SkipRow, StepStats, System, SystemError, Tensor, TensorMap, Trial,
    follow_canonical,
};
use render_core::budget::Ledger;
use render_core::ray::Ray;

impl RaySystem {
    /// Which parts of all photos are static, where its model of the photos has found that.
    pub(crate) fn static_maps(&self) -> Option<&StaticMaps> {
        self.photo_model.as_ref()?.static_maps()
    }
}

impl System for RaySystem {
    fn name(&self) -> &'static str {
        self.name
    }

    fn step(&mut self, data: &Dataset, step: u64) -> Result<StepStats, SystemError> {
        self.train_step(data, step)
    }

    fn keep_up(&mut self, step: u64, time: f64) {
        self.course.keep_up(step, time);
    }

    fn news(&mut self) -> Option<String> {
        self.movers.as_mut()?.news()
    }

    fn render(&self, rays: &[Ray], query: &Query) -> Layers {
        render::render(self, rays, query)
    }

    fn rays_per_side(&self) -> u32 {
        self.config.batch.rays_per_side
    }

    fn render_trial(&self, rays: &[Ray], query: &Query, trial: &Trial) -> Option<(Layers, Ledger)> {
        Some(render::render_trial(self, rays, query, trial))
    }

    fn appearance_code(&self, appearance: &Appearance) -> Option<Vec<f32>> {
        Some(self.photo_model.as_ref()?.appearance()?.code_of(appearance))
    }

    fn fit_appearance(&self, pixels: &Fit<'_>) -> Option<Vec<f32>> {
        fit::fit(self, pixels)
    }

    fn encode_appearance(&self, photo: &scene_io::Image) -> Option<Vec<f32>> {
        self.photo_model.as_ref()?.encode(photo)
    }

    fn visibility(&self, data: &Dataset, view: usize) -> Result<Option<Vec<f32>>, SystemError> {
        self.visibility_of(data, view)
    }

    fn uncertainty(&self, data: &Dataset, view: usize) -> Result<Option<Vec<f32>>, SystemError> {
        self.uncertainty_of(data, view)
    }

    fn prepass(&self, data: &Dataset, view: usize, stride: u32) -> Result<bool, SystemError> {
        self.rehearse_survey(data, view, stride)
    }

    fn density(&self, points: &[[f64; 3]], time: f64, out: &mut [f32]) {
        points::density(self, points, time, out);
    }

    fn colour(&self, points: &[[f64; 3]], d: &[[f32; 3]], time: f64, out: &mut [[f32; 3]]) {
        points::colour(self, points, d, time, out);
    }

    fn canonical(&self, points: &[[f64; 3]], time: f64, out: &mut [[f64; 3]]) {
        points::canonical(self, points, time, out);
    }

    fn flow_source(&self) -> FlowSource {
        match LearnedFlow::of(self) {
            Some(_) => FlowSource::Learned,
            None if self.field.deform().is_some_and(Deform::warps) => FlowSource::Canonical,
            None => FlowSource::Nothing,
        }
    }

    fn scene_flow(&self, points: &[[f64; 3]], from: f64, to: f64, out: &mut [Option<[f64; 3]>]) {
        match LearnedFlow::of(self) {
            Some(learned) => learned.follow(points, [from, to], out),
            None => {
                let canonical = |x: &[[f64; 3]], time: f64, out: &mut [[f64; 3]]| self.canonical(x, time, out);
                follow_canonical(&canonical, self.bounds(), points, [from, to], out);
            }
        }
    }

    fn first_sample(&self, ray: &Ray) -> f64 {
        self.space.world_distance(ray, self.space.internal_ray(ray).start)
    }

    fn bounds(&self) -> [[f64; 3]; 2] {
        self.space.world_bounds()
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        state::save(self)
    }

    fn load_state(&mut self, tensors: &TensorMap) -> Result<(), SystemError> {
        state::load(self, tensors)
    }

    fn parameter_count(&self) -> usize {
        let f = &self.field;
        let head = self.head.as_ref().map_or(0, |head| head.params.len());
        let deform = f.deform.as_ref().map_or(0, Deform::parameter_count);
        let moving = f.moving.as_ref().map_or(0, MovingPart::parameter_count);
        let photo_model = self.photo_model.as_ref().map_or(0, |photo_model| photo_model.parameter_count());
        let field = f.features.parameters().len() + f.density_params.len() + f.colour_params.len();
        field + self.sampler.parameter_count() + head + deform + moving + photo_model
    }

    fn memory_bytes(&self) -> usize {
        let chunks: usize = self.work.chunks.iter().chain(self.work.second_renders.chunks()).map(Chunk::bytes).sum();
        // Gradient and two moments of each parameter.
        self.field.bytes()
            + 12 * self.parameter_count()
            + chunks
            + self.sampler.bytes()
            + self.photo_model.as_ref().map_or(0, |m| m.memory_bytes())
    }

    fn growth_bytes(&self) -> usize {
        let times = self.sampler.occupancy().filter(|_| self.may_move()).map_or(0, Occupancy::growth_bytes);
        self.field.features.growth_bytes() + times
    }

    fn skips(&self) -> Vec<SkipRow> {
        account::skips(self)
    }

    fn timings(&self) -> Vec<(&'static str, f64)> {
        account::timings(self)
    }
}
