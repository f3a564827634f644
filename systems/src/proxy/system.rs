//! A cloud that begins where a field sees surfaces, as a [`System`].

use super::seen::{BUDGET, seen};
use crate::rays::RaySystem;
use crate::views::outside::PhotoPixels;
use crate::views::sky;
use crate::views::start::Place;
use crate::views::{Views, first_of, positive, unless};
use engine::data::Dataset;
use engine::render::plain_query;
use engine::system::{
    Appearance, Fit, FlowSource, Layers, Query, SkipRow, Splats, StepStats, System, SystemError, Tensor, TensorMap,
    take_counts, u64_tensor,
};
use rayon::prelude::*;
use render_core::camera::Camera;
use render_core::ray::Ray;
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// A field before the cloud.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct FieldConfig {
    /// Steps of the field that is trained before the cloud.
    pub(crate) field_steps: u64,
    /// Standard deviation of a Gaussian that begins where the field sees what a badly drawn pixel shows, sizes of the pixel there.
    pub(crate) refill_size: f64,
}

impl FieldConfig {
    pub(crate) const PLANNED: Self = Self { field_steps: 500, refill_size: 2.0 };

    /// # Errors
    /// [`SystemError::Config`] naming the first setting that cannot work.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        first_of([
            unless(self.field_steps > 0, "field_steps", self.field_steps, "must be at least 1"),
            positive("refill_size", self.refill_size),
        ])
    }
}

/// What the field is for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ProxyTerms {
    pub(crate) config: FieldConfig,
    /// So many Gaussians begin where it sees surfaces; `None`: the cloud begins as it is.
    pub(crate) seeds: Option<usize>,
    /// Number of points of the sphere on which Gaussians of the sky begin, where the field sees no surface; `None`: there is no sky.
    pub(crate) sky: Option<usize>,
}

impl ProxyTerms {
    /// For people; `refill` is the share of later Gaussians that the cloud takes.
    pub(crate) fn line(&self, refill: f64) -> String {
        let seeds = self.seeds.map(|n| format!("{n} Gaussians begin where it sees surfaces"));
        let refill = (refill > 0.0)
            .then(|| format!("{:.0} % of later ones where it sees what badly drawn pixels show", 100.0 * refill));
        let what: Vec<String> = seeds.into_iter().chain(refill).collect();
        format!("field: a fast field is trained for {} steps first; {}", self.config.field_steps, what.join(", "))
    }
}

/// There is sky where the field sees that far through this share of its places.
const OPEN: f64 = 0.25;
/// No more pixels are drawn for a seed.
const MOST_DRAWN: usize = 16;
/// So many steps the cloud is given before it is shown instead of the field, or as many as that had: at its first ones it is 6 dB behind
/// (lego at 400x400).
const BEGUN: u64 = 100;
/// Name of the number of steps in checkpoints.
const STEPS: &str = "proxy.steps";

/// A cloud and the field before it.
pub(crate) struct Proxied {
    terms: ProxyTerms,
    /// Until nothing is asked of it any more.
    field: Option<RaySystem>,
    cloud: Views,
    steps: u64,
    /// Of the field's steps and seeds; of refilling.
    seconds: [f64; 2],
}

impl Proxied {
    pub(crate) fn new(terms: ProxyTerms, field: RaySystem, cloud: Views) -> Self {
        Self { terms, field: Some(field), cloud, steps: 0, seconds: [0.0; 2] }
    }

    /// The field for the first `steps` steps, then the cloud.
    fn after(&self, steps: u64) -> &dyn System {
        match &self.field {
            Some(field) if self.steps < steps => field,
            _ => &self.cloud,
        }
    }

    /// What is trained.
    fn current(&self) -> &dyn System {
        self.after(self.terms.config.field_steps)
    }

    /// What is looked at.
    fn shown(&self) -> &dyn System {
        self.after(self.shown_until())
    }

    /// Number of steps after which the cloud is shown instead of the field.
    fn shown_until(&self) -> u64 {
        let of_field = self.terms.config.field_steps;
        // The codes of the field are not those of the cloud: what is shown and what codes are asked for is one of them.
        let begun = if self.cloud.has_codes() { 0 } else { BEGUN.min(of_field) };
        of_field.saturating_add(begun)
    }

    /// Whether the field is asked for anything in the next step or a later one, or looked at after this one.
    fn asks_field(&self) -> bool {
        self.steps < self.shown_until() || self.cloud.takes_more()
    }

    fn see(&self, photo: &PhotoPixels) -> Vec<Place> {
        self.field.as_ref().map_or_else(Vec::new, |field| seen(field, photo))
    }

    /// The cloud begins. Of photos that show much of nothing more pixels are drawn the second time, so that as many see something.
    fn seed(&mut self, data: &Dataset) -> Result<(), SystemError> {
        // Nothing begins where masks say that a photo does not show the scene.
        if let Some(maps) = self.field.as_ref().and_then(RaySystem::static_maps) {
            self.cloud.begin_with_masks(maps);
        }
        let Some(seeds) = self.terms.seeds else { return Ok(()) };
        let mut points = self.see_spread(data, seeds)?;
        // Where the field sees nothing, the start that was planned stays.
        if points.is_empty() {
            return self.add_sky(data, &[]);
        }
        if points.len() < seeds {
            let more = (seeds.saturating_mul(seeds) / points.len()).min(seeds.saturating_mul(MOST_DRAWN));
            points = self.see_spread(data, more)?;
        }
        let count = points.len().min(seeds);
        let places: Vec<_> = (0..count).map(|k| points[k * points.len() / count]).collect();
        self.cloud.begin_at(&places)?;
        self.add_sky(data, &places)
    }

    /// Gaussians of the sky around a cloud that begins at `places`, where the field sees that there is anything beyond the scene.
    fn add_sky(&mut self, data: &Dataset, places: &[Place]) -> Result<(), SystemError> {
        let Some((count, field)) = self.terms.sky.zip(self.field.as_ref()) else { return Ok(()) };
        let places: Vec<_> = places.iter().map(|place| place.x).collect();
        let sphere = self.cloud.sky_around(&places, data, count);
        let reach = sphere.reach() as f32;
        let sky = sky::shown(data, &sphere.points(data), |rays| {
            let depths = field.render(rays, &plain_query([0.0; 3], BUDGET)).median_depth;
            depths.into_iter().map(|t| t >= reach).collect()
        })?;
        // A field paints the sky on the inside of its box, at any depth beyond the scene: where there is sky at all, all of it is added.
        let free = sky.iter().filter(|place| place.is_free).count();
        if (free as f64) < OPEN * sky.len() as f64 { Ok(()) } else { self.cloud.add_sky(&sphere, &sky) }
    }

    /// What about `count` pixels of all photos see.
    fn see_spread(&mut self, data: &Dataset, count: usize) -> Result<Vec<Place>, SystemError> {
        let photos = self.cloud.spread_pixels(data, count)?;
        // Of many photos a few pixels each.
        let seen: Vec<Vec<Place>> = photos.par_iter().map(|photo| self.see(photo)).collect();
        Ok(seen.concat())
    }

    fn refill(&mut self, step: u64) -> Result<(), SystemError> {
        let room = self.cloud.count_from_outside(step);
        if room == 0 {
            return Ok(());
        }
        let photo = self.cloud.erring_pixels(step, room);
        self.cloud.insert(&self.see(&photo), self.terms.config.refill_size)
    }
}

impl System for Proxied {
    fn name(&self) -> &'static str {
        self.cloud.name()
    }

    fn step(&mut self, data: &Dataset, step: u64) -> Result<StepStats, SystemError> {
        let first = self.terms.config.field_steps;
        let clock = Instant::now();
        let stats = match &mut self.field {
            Some(field) if step < first => {
                let stats = field.step(data, step)?;
                self.seconds[0] += clock.elapsed().as_secs_f64();
                stats
            }
            _ => {
                if step == first {
                    self.seed(data)?;
                    self.seconds[0] += clock.elapsed().as_secs_f64();
                }
                let stats = self.cloud.step(data, step - first)?;
                let clock = Instant::now();
                self.refill(step - first)?;
                self.seconds[1] += clock.elapsed().as_secs_f64();
                stats
            }
        };
        self.steps = step + 1;
        if !self.asks_field() {
            self.field = None;
        }
        Ok(stats)
    }

    fn keep_up(&mut self, step: u64, time: f64) {
        if let Some(of_cloud) = step.checked_sub(self.terms.config.field_steps).filter(|steps| *steps > 0) {
            self.cloud.keep_up(of_cloud, time);
        }
    }

    fn unsettled(&self) -> u64 {
        self.shown().unsettled()
    }

    fn render(&self, rays: &[Ray], query: &Query) -> Layers {
        self.shown().render(rays, query)
    }

    fn render_cones(&self, rays: &[Ray], radii: &[f32], query: &Query) -> Layers {
        self.shown().render_cones(rays, radii, query)
    }

    fn render_view(&self, camera: &Camera, query: &Query) -> Option<Layers> {
        self.shown().render_view(camera, query)
    }

    fn render_before(&self, camera: &Camera, depth: f64, query: &Query) -> Option<Vec<f32>> {
        self.shown().render_before(camera, depth, query)
    }

    fn rays_per_side(&self) -> u32 {
        self.shown().rays_per_side()
    }

    fn is_cloud(&self) -> bool {
        self.current().is_cloud()
    }

    fn knows_behind(&self) -> bool {
        self.shown().knows_behind()
    }

    fn splats(&self, query: &Query) -> Option<Splats> {
        self.current().splats(query)
    }

    fn appearance_code(&self, appearance: &Appearance) -> Option<Vec<f32>> {
        self.shown().appearance_code(appearance)
    }

    fn fit_appearance(&self, pixels: &Fit<'_>) -> Option<Vec<f32>> {
        self.shown().fit_appearance(pixels)
    }

    fn visibility(&self, data: &Dataset, view: usize) -> Result<Option<Vec<f32>>, SystemError> {
        self.current().visibility(data, view)
    }

    fn prepass(&self, data: &Dataset, view: usize, stride: u32) -> Result<bool, SystemError> {
        self.cloud.prepass(data, view, stride)
    }

    fn canonical(&self, points: &[[f64; 3]], time: f64, out: &mut [[f64; 3]]) {
        self.shown().canonical(points, time, out);
    }

    fn flow_source(&self) -> FlowSource {
        self.shown().flow_source()
    }

    fn scene_flow(&self, points: &[[f64; 3]], from: f64, to: f64, out: &mut [Option<[f64; 3]>]) {
        self.shown().scene_flow(points, from, to, out);
    }

    fn density(&self, points: &[[f64; 3]], time: f64, out: &mut [f32]) {
        self.shown().density(points, time, out);
    }

    fn first_sample(&self, ray: &Ray) -> f64 {
        self.shown().first_sample(ray)
    }

    fn colour(&self, points: &[[f64; 3]], d: &[[f32; 3]], time: f64, out: &mut [[f32; 3]]) {
        self.shown().colour(points, d, time, out);
    }

    fn bounds(&self) -> [[f64; 3]; 2] {
        self.shown().bounds()
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        let mut out = vec![u64_tensor(STEPS, vec![self.steps])];
        out.extend(self.cloud.state());
        out.extend(self.field.iter().flat_map(System::state));
        out
    }

    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        self.steps = take_counts(state, STEPS, 1)?[0];
        self.cloud.load_state(state)?;
        if !self.asks_field() {
            self.field = None;
        }
        self.field.as_mut().map_or(Ok(()), |field| field.load_state(state))
    }

    fn parameter_count(&self) -> usize {
        self.current().parameter_count()
    }

    fn memory_bytes(&self) -> usize {
        self.cloud.memory_bytes() + self.field.as_ref().map_or(0, System::memory_bytes)
    }

    fn growth_bytes(&self) -> usize {
        self.cloud.growth_bytes()
    }

    fn skips(&self) -> Vec<SkipRow> {
        self.current().skips()
    }

    fn timings(&self) -> Vec<(&'static str, f64)> {
        let mut all = self.cloud.timings();
        all.extend(["field", "refill"].into_iter().zip(self.seconds));
        all
    }
}

#[cfg(test)]
mod tests {
    use crate::plan::made;
    use crate::registry::build;
    use engine::options::{Background, RunOptions};

    /// Photos that show nothing, before random colours: a field of theirs sees no surface.
    #[test]
    fn where_the_field_sees_nothing_the_cloud_begins_as_it_was_planned() {
        let (scene, data) = made::scene(made::frames(4, |_, _, _| [0; 4]), Vec::new());
        let made = |more: toml::Table| {
            let mut set = toml::toml! {
                start_count = 50
                max_splats = 200
                densify_from = 1
                densify_every = 2
                densify_until = 20
            };
            set.extend(more);
            let run = RunOptions { seed: 3, background: Some(Background::Random), error_budget: None, stop: None, set };
            build("splat", &scene, &data, &run).unwrap()
        };
        let (mut random, _) = made(toml::toml! { start = "random" });
        let (mut field, plan) = made(toml::toml! {
            start = "field"
            field_steps = 100
        });
        assert!(plan.lines.iter().any(|line| line.contains("should the field see nothing")), "{:?}", plan.lines);
        for step in 0..101 {
            assert!(field.step(&data, step).unwrap().loss.is_finite());
        }
        random.step(&data, 0).unwrap();
        let query = engine::render::plain_query([0.0; 3], 0.0);
        let [planned, begun] = [random, field].map(|system| system.splats(&query).unwrap().gaussians);
        assert_eq!((planned.len(), &planned.mean), (50, &begun.mean));
    }
}
