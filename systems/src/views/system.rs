//! The driver as a [`System`]: rendering, checkpoints, accounts.

use super::appearance_fit::{encode, fit};
use super::cloud_frame::CloudFrame;
use super::cloud_parameters::{CloudParameters, joined};
use super::driver::{Clouds, OWN, Views};
use super::free_space;
use super::front::Front;
use super::memory;
use super::pass::PARTS;
use super::render::{RAY_RADIUS, one_pixel};
use crate::schedule::Position;
use engine::data::Dataset;
use engine::system::{
    Appearance, Canonical, Fit, FlowSource, Layers, Query, SkipRow, Splats, StepStats, System, SystemError, Tensor,
    TensorMap, take_counts, u64_tensor,
};
use glam::DVec3;
use optim::NonFiniteGuard;
use render_core::bounds::{Aabb, robust_box};
use render_core::camera::{Camera, Pose};
use render_core::ray::Ray;
use scene_io::Image;
use splat_core::Gaussians;
use std::borrow::Cow;

/// Logit of an opacity that no picture shows.
const TRANSPARENT: f32 = -30.0;
/// Bytes of a parameter of other parts: itself, its gradient, two moments.
const LEARNT_BYTES: usize = 4 * size_of::<f32>();
/// Name of the counters in checkpoints.
const COUNTERS: &str = "splats.steps";
/// Name of the position in the schedule in checkpoints.
const POSITION: &str = "splats.position";

impl Views {
    /// The layers of a camera's picture; those of nothing where it cannot see: ray by ray it would show no more.
    pub(super) fn picture(&self, clouds: &Clouds<'_>, camera: &Camera, query: &Query) -> Layers {
        let drawn = self.drawn(clouds);
        match self.renderer(&drawn, query).layers(camera, query, &self.buffers) {
            Ok((mut layers, skipped)) => {
                self.note(&skipped);
                self.canonical_layer(query, &mut layers);
                layers
            }
            Err(_) => Layers::nothing(camera.width as usize * camera.height as usize, query),
        }
    }

    /// Canonical points of a picture that is drawn, in the place of those at its time.
    fn canonical_layer(&self, query: &Query, layers: &mut Layers) {
        if query.layers.canonical == Canonical::Compute {
            let seen = layers.canonical.clone();
            self.canonical_points(&seen, query.time, &mut layers.canonical);
        }
    }

    /// Number of Gaussians.
    fn gaussians(&self) -> usize {
        self.parts.clouds.iter().map(|cloud| cloud.parameters.len()).sum()
    }

    /// Bytes of `gaussians` Gaussians in an appearance, besides those that all have.
    fn toned_bytes(&self, gaussians: usize) -> usize {
        let learnt = self.parts.appearance.as_ref().map_or(0, |part| part.shared_parameters());
        memory::toned(gaussians, learnt) + self.sizes.toned_bytes()
    }

    fn cloud_parameters(&self) -> usize {
        self.parts.clouds.iter().map(|cloud| cloud.parameter_count()).sum()
    }

    /// A picture of one ray: a camera of one pixel along it.
    fn ray(&self, clouds: &Clouds<'_>, ray: &Ray, radius: f32, query: &Query) -> Layers {
        let camera = one_pixel(ray, radius);
        let drawn = self.drawn(clouds);
        // Not counted: rays are what a picture is made of where there is nothing better.
        match self.renderer(&drawn, query).layers(&camera, query, &self.buffers) {
            Ok((mut layers, _)) => {
                self.canonical_layer(query, &mut layers);
                layers
            }
            Err(_) => Layers::nothing(1, query),
        }
    }
}

impl Views {
    /// Whether there is a cloud in front that pictures do not show.
    pub(super) fn hides_front(&self) -> bool {
        self.parts.layers.as_ref().is_some_and(|layers| layers.front == Front::Hidden)
    }
}

impl System for Views {
    fn name(&self) -> &'static str {
        self.parts.name
    }

    fn step(&mut self, data: &Dataset, step: u64) -> Result<StepStats, SystemError> {
        self.train_step(data, step)
    }

    fn keep_up(&mut self, step: u64, time: f64) {
        if let Some(planned) = &self.parts.time {
            self.position.mark(planned, step, time);
        }
    }

    fn unsettled(&self) -> u64 {
        self.settled_at.saturating_sub(self.steps)
    }

    fn render_view(&self, camera: &Camera, query: &Query) -> Option<Layers> {
        Some(self.picture(&self.clouds_at(query.time), camera, query))
    }

    fn render_before(&self, camera: &Camera, depth: f64, query: &Query) -> Option<Vec<f32>> {
        let before: Clouds<'_> = self
            .clouds_at(query.time)
            .iter()
            .map(|cloud| Cow::Owned(nearer(cloud, &camera.pose, depth, &self.parts.frame)))
            .collect();
        let drawn = self.drawn(&before);
        let pixels = camera.width as usize * camera.height as usize;
        // A camera that cannot see shows nothing.
        let layers = self.renderer(&drawn, query).layers(camera, query, &self.buffers);
        Some(layers.map_or_else(|_| vec![0.0; pixels], |(layers, _)| layers.opacity))
    }

    fn render(&self, rays: &[Ray], query: &Query) -> Layers {
        self.render_cones(rays, &vec![RAY_RADIUS; rays.len()], query)
    }

    fn render_cones(&self, rays: &[Ray], radii: &[f32], query: &Query) -> Layers {
        let clouds = self.clouds_at(query.time);
        let mut out = Layers::default();
        for (ray, &radius) in rays.iter().zip(radii) {
            out.extend(self.ray(&clouds, ray, radius, query));
        }
        out
    }

    fn is_cloud(&self) -> bool {
        true
    }

    fn splats(&self, query: &Query) -> Option<Splats> {
        let drawn = self.clouds_at(query.time);
        let toned = self.in_appearance(&drawn, query);
        let mut gaussians = match (&self.parts.layers, &drawn[..]) {
            (Some(layers), [_, front]) => match layers.front {
                Front::Hidden => joined(&[&*toned[0]]),
                Front::Shown => joined(&[&*toned[0], &layers.part.front_alone(front)]),
            },
            _ => joined(&toned.iter().map(|cloud| &**cloud).collect::<Vec<_>>()),
        };
        self.parts.frame.cloud_to_world(&mut gaussians);
        let raster = self.parts.pictures.raster();
        let near = (f64::from(raster.near) * self.parts.frame.scale) as f32;
        Some(Splats { gaussians, rules: raster.with_near(near) })
    }

    fn knows_behind(&self) -> bool {
        self.parts.layers.is_some()
    }

    fn appearance_code(&self, appearance: &Appearance) -> Option<Vec<f32>> {
        self.parts.appearance.as_deref().map(|part| part.code(appearance))
    }

    fn encode_appearance(&self, photo: &Image) -> Option<Vec<f32>> {
        encode(self, photo)
    }

    fn fit_appearance(&self, pixels: &Fit<'_>) -> Option<Vec<f32>> {
        fit(self, pixels)
    }

    fn visibility(&self, data: &Dataset, view: usize) -> Result<Option<Vec<f32>>, SystemError> {
        self.static_pixels(data, view)
    }

    fn prepass(&self, data: &Dataset, view: usize, stride: u32) -> Result<bool, SystemError> {
        self.rehearse_survey(data, view, stride)
    }

    fn canonical(&self, points: &[[f64; 3]], time: f64, out: &mut [[f64; 3]]) {
        self.canonical_points(points, time, out);
    }

    fn flow_source(&self) -> FlowSource {
        if self.shows_motion() { FlowSource::Canonical } else { FlowSource::Nothing }
    }

    fn scene_flow(&self, points: &[[f64; 3]], from: f64, to: f64, out: &mut [Option<[f64; 3]>]) {
        self.flow_of_points(points, from, to, out);
    }

    fn density(&self, _points: &[[f64; 3]], _time: f64, out: &mut [f32]) {
        // Gaussians are composited, not integrated: they have opacity on a picture and no density in space.
        out.fill(0.0);
    }

    fn colour(&self, _points: &[[f64; 3]], _d: &[[f32; 3]], _time: f64, out: &mut [[f32; 3]]) {
        out.fill([0.0; 3]);
    }

    fn bounds(&self) -> [[f64; 3]; 2] {
        // What pictures never show may be of another frame.
        let shown = if self.hides_front() { 1 } else { self.parts.clouds.len() };
        let clouds = self.parts.clouds.iter().take(shown).map(|cloud| &cloud.parameters.gaussians);
        let points: Vec<DVec3> =
            clouds.flat_map(|cloud| (0..cloud.len()).map(|i| world_point(cloud, i, &self.parts.frame))).collect();
        let around = robust_box(&points, 0.02).unwrap_or(Aabb { min: DVec3::ZERO, max: DVec3::ONE });
        [around.min.to_array(), around.max.to_array()]
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        let guard = &self.guard;
        let counters = vec![self.steps, guard.steps(), guard.bad_steps(), guard.entries()];
        let mut out = vec![u64_tensor(COUNTERS, counters)];
        out.extend(self.position.state(POSITION));
        out.extend(self.smoothing.iter().flat_map(|smoothing| smoothing.state()));
        for cloud in &self.parts.clouds {
            cloud.push(&mut out);
        }
        out.extend(self.parts.appearance.iter().flat_map(|part| part.state()));
        out.extend(self.parts.motion.iter().flat_map(|part| part.state()));
        out.extend(self.parts.surveys.iter().flat_map(|part| part.state()));
        out.extend(self.parts.judge.iter().flat_map(|part| part.state()));
        out
    }

    /// All arrays of clouds are read and checked before the first is put in its place.
    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        let clouds =
            self.parts.clouds.iter().map(|cloud| cloud.take(state)).collect::<Result<Vec<_>, SystemError>>()?;
        let counters = take_counts(state, COUNTERS, 4)?;
        let position = Position::take(state, POSITION)?;
        let filters = self.smoothing.as_ref().map(|smoothing| smoothing.take(state, &clouds)).transpose()?;
        if let Some(part) = &mut self.parts.appearance {
            part.load(state)?;
        }
        if let Some(part) = &mut self.parts.motion {
            part.load(state)?;
        }
        if let Some(part) = &mut self.parts.surveys {
            part.load(state)?;
        }
        if let Some(part) = &mut self.parts.judge {
            part.load(state)?;
        }
        self.parts.clouds = clouds;
        if let (Some(smoothing), Some(filters)) = (&mut self.smoothing, filters) {
            smoothing.put(filters);
        }
        self.steps = counters[0];
        self.position = position;
        self.guard = NonFiniteGuard::default().resumed(counters[1], counters[2], counters[3]);
        Ok(())
    }

    fn parameter_count(&self) -> usize {
        let appearance = self.parts.appearance.as_ref().map_or(0, |part| part.parameter_count());
        let motion = self.parts.motion.as_ref().map_or(0, |part| part.parameter_count());
        let judge = self.parts.judge.as_ref().map_or(0, |part| part.parameter_count());
        self.cloud_parameters() + appearance + motion + judge
    }

    fn memory_bytes(&self) -> usize {
        let finds = self.parts.clouds.iter().any(|cloud| cloud.training.density.schedule.free_space);
        let free_space = if finds { free_space::BYTES } else { 0 };
        let clouds: usize = self.parts.clouds.iter().map(|cloud| cloud.bytes(cloud.parameters.len())).sum();
        let appearance = self.parts.appearance.as_ref().map_or(0, |part| part.parameter_count());
        let motion = self.parts.motion.as_ref().map_or(0, |part| part.parameter_count());
        // A cloud that moves is there twice, where it is canonical and at the time of a photo.
        let copies = if self.parts.motion.is_some() { self.cloud_parameters() * size_of::<f32>() } else { 0 };
        let toned = if self.parts.appearance.is_some() { self.toned_bytes(self.gaussians()) } else { 0 };
        let judge = self.parts.judge.as_ref().map_or(0, |part| part.parameter_count() * LEARNT_BYTES + part.bytes());
        let terms: usize = self.parts.terms.iter().map(|term| term.bytes()).sum();
        let held = self.parts.appearance.as_ref().map_or(0, |part| part.bytes()) + judge + terms;
        clouds + copies + toned + held + (appearance + motion) * LEARNT_BYTES + self.sizes.bytes() + free_space
    }

    fn growth_bytes(&self) -> usize {
        let clouds: usize = self.parts.clouds.iter().map(|cloud| cloud.growth_bytes()).sum();
        let most: usize = self.parts.clouds.iter().map(|cloud| cloud.training.cloud.max_splats).sum();
        let more = |gaussians: usize| self.toned_bytes(most).saturating_sub(self.toned_bytes(gaussians));
        clouds + if self.parts.appearance.is_some() { more(self.gaussians()) } else { 0 }
    }

    fn skips(&self) -> Vec<SkipRow> {
        self.skipped.lock().map_or_else(|_| Vec::new(), |skipped| skipped.rows())
    }

    fn timings(&self) -> Vec<(&'static str, f64)> {
        PARTS.into_iter().chain(OWN).zip(self.seconds).collect()
    }
}

/// Centre of Gaussian `i` of an internal cloud, in the scene's frame.
fn world_point(cloud: &Gaussians, i: usize, frame: &CloudFrame) -> DVec3 {
    let n = cloud.len();
    frame.to_world([0, 1, 2].map(|k| f64::from(cloud.mean[k * n + i])).into())
}

/// Gaussians whose centres lie before `depth` along a camera's axis, world units; the others become transparent.
fn nearer(cloud: &CloudParameters, pose: &Pose, depth: f64, frame: &CloudFrame) -> CloudParameters {
    let mut before = cloud.clone();
    for i in 0..cloud.len() {
        if pose.to_camera(world_point(&cloud.gaussians, i, frame)).z >= depth {
            before.gaussians.logit[i] = TRANSPARENT;
        }
    }
    before
}
