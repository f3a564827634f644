//! What the engine asks of a system of two levels.

use super::cones::{self, Cones};
use super::fit;
use super::recipe::Recipe;
use super::two_level::{CHUNKS, TwoLevel};
use crate::survey::Surveys;
use engine::canonical::add_canonical;
use engine::data::Dataset;
use engine::system::{
    Appearance, Fit, FlowSource, Layers, Query, SkipRow, StepStats, System, SystemError, Tensor, TensorMap,
};
use render_core::ray::Ray;

impl<R: Recipe> System for TwoLevel<R> {
    fn name(&self) -> &'static str {
        self.photo_model.as_ref().map_or(R::NAME, |photo_model| photo_model.name())
    }

    fn step(&mut self, data: &Dataset, step: u64) -> Result<StepStats, SystemError> {
        self.train_step(data, step)
    }

    fn render(&self, rays: &[Ray], query: &Query) -> Layers {
        self.render_cones(rays, &vec![0.0; rays.len()], query)
    }

    fn render_cones(&self, rays: &[Ray], radii: &[f32], query: &Query) -> Layers {
        let ops = self.ops();
        let code = self.code_of(&query.appearance);
        let into = |cones: Cones<'_>, tile: &mut _, out: &mut Layers| {
            self.render_into(&ops, cones, query, &code, tile, out);
        };
        let mut layers = cones::render_tiles(rays, radii, query, into);
        add_canonical(self, rays, query, &mut layers);
        layers
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
        let d = vec![[0.0, 0.0, 1.0]; points.len()];
        self.evaluate(points, &d, time, |i, sigma, _| out[i] = sigma);
    }

    fn colour(&self, points: &[[f64; 3]], d: &[[f32; 3]], time: f64, out: &mut [[f32; 3]]) {
        self.evaluate(points, d, time, |i, _, rgb| out[i] = rgb);
    }

    fn canonical(&self, points: &[[f64; 3]], time: f64, out: &mut [[f64; 3]]) {
        self.canonical_points(points, time, out);
    }

    fn flow_source(&self) -> FlowSource {
        if self.shapes.displaces() { FlowSource::Canonical } else { FlowSource::Nothing }
    }

    fn first_sample(&self, ray: &Ray) -> f64 {
        self.space.world_distance(ray, self.space.internal_ray(ray).start)
    }

    fn bounds(&self) -> [[f64; 3]; 2] {
        self.space.world_bounds()
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        let mut state = self.trained.state();
        state.extend(self.photo_model.iter().flat_map(|photo_model| photo_model.state()));
        state
    }

    fn load_state(&mut self, tensors: &TensorMap) -> Result<(), SystemError> {
        let trained = self.trained.restored(tensors)?;
        if let Some(photo_model) = &mut self.photo_model {
            photo_model.load_state(tensors)?;
        }
        self.trained = trained;
        self.pack();
        Ok(())
    }

    fn parameter_count(&self) -> usize {
        self.trained.params.len() + self.photo_model.as_ref().map_or(0, |photo_model| photo_model.parameter_count())
    }

    fn memory_bytes(&self) -> usize {
        let arenas: usize =
            self.chunks.iter().map(|c| c.tile.coarse.arena.memory_bytes() + c.tile.fine.arena.memory_bytes()).sum();
        // Parameters, packed copies, gradient, two moments of Adam; a gradient a chunk.
        let networks = 4 * self.trained.params.len() * (6 + CHUNKS);
        networks + arenas + self.photo_model.as_ref().map_or(0, |photo_model| photo_model.memory_bytes())
    }

    fn skips(&self) -> Vec<SkipRow> {
        // A ray that a photo model leaves out is one of those that are not sampled, too: it is counted once.
        let mut rows = vec![cones::missed_row(self.missed - self.left_out.occluders(), self.cast)];
        rows.extend(self.left_out.occluders_row());
        if self.shapes.displaces() {
            let bound = "exact: nothing is displaced at t = 0".into();
            let what = "training: samples at the canonical time";
            rows.push(SkipRow::counted(what, self.still, self.placed, "samples", bound));
        }
        rows
    }

    fn timings(&self) -> Vec<(&'static str, f64)> {
        vec![("draw rays", self.seconds[0]), ("networks", self.seconds[1]), ("gradient fold and Adam", self.seconds[2])]
    }
}
