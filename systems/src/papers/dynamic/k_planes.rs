//! K-Planes: features are products of planes, three of space and three of time (Fridovich-Keil, Meanti, Warburg, Recht, Kanazawa,
//! "K-Planes: Explicit Radiance Fields in Space, Time, and Appearance", 2023).
//!
//! ```text
//! f_s(q) = prod_c psi(P_c^s, pi_c(q))      q = (x, y, z) of a scene at rest, (x, y, z, t) of one that moves (equation 1)
//! f(q)   = concat_s f_s(q)                 scales s; time is not multiplied by s (section 3.1)
//! (log sigma, g) = MLP(f),  c = MLP(g, SH(d))          the hybrid model (section 3.4)
//! log sigma = a . f,  c_i = sigmoid(f . MLP_i(d))       the explicit model
//! L = |C - C'|^2 + a mean_c TV(P_c) + b mean_c |d^2 P_c / dt^2|^2 + e mean_c |1 - P_c|       (equations 3 to 5)
//! ```
//!
//! Planes of space begin uniform, planes of time at 1: the scene stands still until the photos say otherwise.

use crate::buffers::{shapes_hold, sized};
use crate::claims::Claim;
use crate::fields::{DecoderChoice, DecoderKind, Detail, ExplicitConfig, FeatureSource, Features, Names, Part, Places};
use crate::plan::{Ask, Built, Moving, MovingParts, Shown, chosen_sampler, field_settings, moving_field, planned};
use crate::rays::RayConfig;
use crate::schedule::Done;
use crate::settings::Settings;
use engine::data::Dataset;
use engine::memory::room_for;
use engine::system::{SystemError, Tensor, TensorMap, f32_tensor, push_adam, take_adam, take_numbers};
use field_core::encoding::EncodingBars;
use field_core::encoding::planes::{KPlanes, PlaneInfo, SPACE_INIT};
use field_core::rng::Rng;
use float_core::Simd;
use losses::planes::{
    Along, PlaneShape, distance_from_one_backward, plane_variation_backward, time_smoothness_backward,
};
use optim::{Adam, AdamConfig};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// What differs from the paper.
pub(crate) const CLAIM: Claim = Claim {
    name: "k-planes",
    paper: "Fridovich-Keil et al., 2023",
    what: "Products of planes of features at several scales: three planes of space and, for scenes that move, three of time",
    take: "to compare; one method for static scenes and moving ones",
    differs: "8 features at scales 1, 2 and 4 instead of 32 at 1 to 8, and an occupancy grid instead of proposals (which \
              `sampler=proposal` brings back); the schedule is that of `ngp` here, from 2 or 4 times the published rate. The \
              hybrid model, or with `decoder=explicit` the explicit one, whose basis sees the direction with a bias. There are no \
              codes of appearance.",
    mark: "8 features, 3 scales, occupancy grid",
};

/// Planes of features.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PlaneSettings {
    /// Vertices of a plane of space along each axis at scale 1.
    pub(crate) plane_vertices: u32,
    /// Scales: factors of `plane_vertices`.
    pub(crate) plane_scales: Vec<u32>,
    /// Features of each scale.
    pub(crate) plane_features: usize,
    /// Vertices along the time; 0: half the number of the photos' times.
    pub(crate) plane_times: u32,
    /// Factor of the variation of all planes along space.
    pub(crate) plane_variation: f32,
    /// Factor of the second differences of planes of time along the time.
    pub(crate) plane_smoothness: f32,
    /// Factor of the distance of planes of time from 1.
    pub(crate) plane_transients: f32,
}

impl PlaneSettings {
    /// Those of the released code for D-NeRF's scenes, with fewer features and scales.
    fn moving() -> Self {
        Self {
            plane_vertices: 64,
            plane_scales: vec![1, 2, 4],
            plane_features: 8,
            plane_times: 0,
            plane_variation: 1e-4,
            plane_smoothness: 0.1,
            plane_transients: 1e-4,
        }
    }

    /// Those of the released code for scenes at rest.
    fn still() -> Self {
        Self { plane_variation: 0.01, plane_smoothness: 0.0, plane_transients: 0.0, ..Self::moving() }
    }

    fn check(&self) -> Result<(), SystemError> {
        let refuse =
            |field, value: String, problem: &str| Err(SystemError::Config { field, value, problem: problem.into() });
        if !(2..=1024).contains(&self.plane_vertices) {
            return refuse("plane_vertices", self.plane_vertices.to_string(), "must be in 2..=1024");
        }
        if !(1..=6).contains(&self.plane_scales.len()) || !self.plane_scales.iter().all(|s| (1..=16).contains(s)) {
            return refuse("plane_scales", format!("{:?}", self.plane_scales), "must be 1 to 6 numbers in 1..=16");
        }
        if !(1..=64).contains(&self.plane_features) {
            return refuse("plane_features", self.plane_features.to_string(), "must be in 1..=64");
        }
        if self.plane_times > 4096 {
            return refuse("plane_times", self.plane_times.to_string(), "must be at most 4096");
        }
        for (field, value) in [
            ("plane_variation", self.plane_variation),
            ("plane_smoothness", self.plane_smoothness),
            ("plane_transients", self.plane_transients),
        ] {
            if !(0.0..=100.0).contains(&value) {
                return refuse(field, value.to_string(), "must be in 0..=100");
            }
        }
        Ok(())
    }
}

/// The planes of a scene: their settings, and the times of its training views in `[-1, 1]`; none for a scene at rest.
#[derive(Clone, Debug)]
pub(crate) struct PlaneSource {
    settings: PlaneSettings,
    times: Arc<[f32]>,
}

impl PlaneSource {
    /// Planes for these photos: of time too, where they show several times.
    pub(crate) fn of(data: &Dataset) -> Self {
        let mut times: Vec<f32> = data.views().iter().map(|view| (2.0 * view.time - 1.0) as f32).collect();
        if times.windows(2).all(|pair| pair[0] == pair[1]) {
            times.clear();
        }
        let settings = if times.is_empty() { PlaneSettings::still() } else { PlaneSettings::moving() };
        Self { settings, times: times.into() }
    }

    /// Planes of space alone.
    fn still() -> Self {
        Self { settings: PlaneSettings::still(), times: Arc::default() }
    }

    /// Vertices along the time: half as many as there are times, at least two.
    fn time_steps(&self) -> u32 {
        if self.settings.plane_times > 0 {
            return self.settings.plane_times.max(2);
        }
        let mut times = self.times.to_vec();
        times.sort_unstable_by(f32::total_cmp);
        times.dedup();
        (times.len() as u32).div_ceil(2).max(2)
    }

    fn planes(&self) -> Result<KPlanes, SystemError> {
        let PlaneSettings { plane_vertices, plane_scales, plane_features, .. } = &self.settings;
        let space = [*plane_vertices; 3];
        let planes = if self.times.is_empty() {
            KPlanes::still(space, plane_scales, *plane_features)
        } else {
            KPlanes::moving(space, self.time_steps(), plane_scales, *plane_features)
        };
        planes.map_err(|e| SystemError::Config {
            field: "plane_vertices, plane_scales, plane_features",
            value: String::new(),
            problem: e.to_string(),
        })
    }
}

impl FeatureSource for PlaneSource {
    fn asked(&self, settings: &mut Settings<'_>) -> Result<Arc<dyn FeatureSource>, SystemError> {
        let settings = settings.of(&self.settings)?;
        settings.check()?;
        Ok(Arc::new(Self { settings, times: self.times.clone() }))
    }

    fn proposal(&self, round: usize) -> Arc<dyn FeatureSource> {
        let plane_vertices = 64 << round.min(1);
        let PlaneSettings { plane_variation, plane_smoothness, .. } = self.settings;
        let settings = PlaneSettings {
            plane_vertices,
            plane_scales: vec![1],
            plane_features: 8,
            // As released: densities alone need less of both.
            plane_variation: plane_variation.min(PROPOSAL_VARIATION),
            plane_smoothness: PROPOSAL_SMOOTHNESS * plane_smoothness,
            ..self.settings.clone()
        };
        Arc::new(Self { settings, times: self.times.clone() })
    }

    fn features(&self, rng: Rng) -> Result<Box<dyn Features>, SystemError> {
        let planes = self.planes()?;
        room_for("plane_vertices", self.settings.plane_vertices as usize, planes.params_len())?;
        let mut params = vec![0.0; planes.params_len()];
        planes.init(rng, SPACE_INIT, &mut params);
        Ok(Box::new(PlaneFeatures::new(self.clone(), planes, params)))
    }
}

/// Factor of the variation of proposals at most, and that of their second differences as a share of the field's.
const PROPOSAL_VARIATION: f32 = 1e-4;
const PROPOSAL_SMOOTHNESS: f32 = 0.01;

/// Adam as released.
const ADAM: AdamConfig = AdamConfig::DEFAULT.with_eps(1e-15);

/// Products of planes, and their optimiser.
struct PlaneFeatures {
    source: PlaneSource,
    simd: Simd,
    planes: KPlanes,
    all: Vec<PlaneInfo>,
    params: Vec<f32>,
    adam: Adam,
    grad: Vec<f32>,
    /// `[chunks][in_rows][n]`, points of a step.
    points: Vec<Vec<f32>>,
}

impl PlaneFeatures {
    fn new(source: PlaneSource, planes: KPlanes, params: Vec<f32>) -> Self {
        Self {
            source,
            simd: Simd::best(),
            all: planes.planes().collect(),
            adam: Adam::new(params.len(), ADAM),
            grad: vec![0.0; params.len()],
            planes,
            params,
            points: Vec::new(),
        }
    }

    /// Points of the unit cube as the planes take them: `[in_rows][n]` in `[-1, 1]`.
    fn fill_points(&self, places: Places<'_>, out: &mut [f32]) {
        let (space, time) = out.split_at_mut(places.x.len());
        space.iter_mut().zip(places.x).for_each(|(q, x)| *q = 2.0 * x - 1.0);
        if self.planes.in_rows() > 3 {
            time.copy_from_slice(places.times);
        }
    }

    /// Add the gradient of the regularisers, each the mean over the planes that it is for (equations 3 to 5).
    fn regularise(&mut self) {
        let PlaneSettings { plane_features: features, plane_variation, plane_smoothness, plane_transients, .. } =
            self.source.settings;
        let timed = self.all.iter().filter(|plane| plane.has_time()).count();
        let mean = |factor: f32, planes: usize| f64::from(factor) / planes.max(1) as f64;
        let [variation, smoothness, transients] =
            [mean(plane_variation, self.all.len()), mean(plane_smoothness, timed), mean(plane_transients, timed)];
        let mut rest = &mut self.grad[..];
        let mut jobs = Vec::with_capacity(self.all.len());
        for plane in &self.all {
            let (grad, after) = rest.split_at_mut(plane.range.len());
            rest = after;
            jobs.push((plane, &self.params[plane.range.clone()], grad));
        }
        jobs.into_par_iter().for_each(|(plane, params, grad)| {
            let shape = PlaneShape { rows: plane.rows, columns: plane.columns, features };
            let along = if plane.has_time() { Along::First } else { Along::Both };
            let fits = "gradients are as long as planes";
            plane_variation_backward(params, shape, along, variation, grad).expect(fits);
            if plane.has_time() {
                time_smoothness_backward(params, shape, smoothness, grad).expect(fits);
                distance_from_one_backward(params, transients, grad).expect(fits);
            }
        });
    }
}

impl Features for PlaneFeatures {
    fn rows(&self) -> usize {
        self.planes.out_rows()
    }

    fn parameters(&self) -> &[f32] {
        &self.params
    }

    #[cfg(test)]
    fn parameters_mut(&mut self) -> &mut [f32] {
        &mut self.params
    }

    fn view_times(&self) -> &[f32] {
        &self.source.times
    }

    fn encode(&self, places: Places<'_>, out: &mut [f32], raw: &mut Vec<f32>) {
        let points = sized(raw, self.planes.in_rows() * places.len());
        self.fill_points(places, points);
        shapes_hold(self.planes.encode(self.simd, &self.params, points, out));
    }

    fn pull<'b>(&self, _: &[f32], _: usize, bars: &'b mut [f32], _: &'b mut Vec<f32>) -> &'b [f32] {
        bars
    }

    fn pulls_in_place(&self) -> bool {
        true
    }

    fn pull_positions(&self, places: Places<'_>, raw_bar: &[f32], _: Detail, x_bar: &mut [f32]) {
        let n = places.len();
        let (mut points, mut bar) = (vec![0.0; self.planes.in_rows() * n], vec![0.0; self.planes.in_rows() * n]);
        self.fill_points(places, &mut points);
        let bars = EncodingBars { table: None, x: Some(&mut bar) };
        let raw_bar = &raw_bar[..self.rows() * n];
        shapes_hold(self.planes.encode_backward(self.simd, &self.params, &points, raw_bar, bars));
        // q = 2 x - 1.
        x_bar.iter_mut().zip(&bar).for_each(|(sum, bar)| *sum += 2.0 * bar);
    }

    #[cfg(test)]
    fn scatter(&self, part: &Part<'_>, out: &mut [f32]) {
        let n = part.places.len();
        let mut points = vec![0.0; self.planes.in_rows() * n];
        self.fill_points(part.places, &mut points);
        let raw_bar = &part.raw_bar[..self.rows() * n];
        shapes_hold(self.planes.encode_backward(self.simd, &self.params, &points, raw_bar, EncodingBars::table(out)));
    }

    /// Each scale is one task, over the chunks in their order; then the regularisers, and Adam on all numbers.
    fn step(&mut self, lr: f64, parts: &[Part<'_>]) -> usize {
        let mut points = std::mem::take(&mut self.points);
        points.resize_with(parts.len(), Vec::new);
        points.par_iter_mut().zip(parts).for_each(|(points, part)| {
            self.fill_points(part.places, sized(points, self.planes.in_rows() * part.places.len()));
        });
        self.grad.fill(0.0);
        let (simd, rows, params) = (self.simd, self.source.settings.plane_features, &self.params);
        let (mut grad, mut from) = (&mut self.grad[..], 0);
        let mut jobs = Vec::with_capacity(self.planes.scales().len());
        for (scale, planes) in self.planes.scales().iter().enumerate() {
            let (own, rest) = grad.split_at_mut(planes.params_len());
            grad = rest;
            jobs.push((scale, planes, &params[from..from + own.len()], own));
            from += planes.params_len();
        }
        jobs.into_par_iter().for_each(|(scale, planes, params, grad)| {
            for (points, part) in points.iter().zip(parts) {
                let n = part.places.len();
                let bars = &part.raw_bar[scale * rows * n..][..rows * n];
                let points = &points[..planes.in_rows() * n];
                shapes_hold(planes.encode_backward(simd, params, points, bars, EncodingBars::table(grad)));
            }
        });
        self.points = points;
        self.regularise();
        self.adam.step(self.simd, lr, &mut self.params, &self.grad)
    }

    fn refine(&mut self, _: Done) {}

    fn push_state<'a>(&'a self, names: &Names, out: &mut Vec<Tensor<'a>>) {
        out.push(f32_tensor(names.parameters.clone(), &self.params));
        push_adam(out, &format!("{}.0", names.moments), &self.adam);
    }

    fn restored(&self, names: &Names, state: &TensorMap, _: Done) -> Result<Box<dyn Features>, SystemError> {
        let params = take_numbers(state, &names.parameters, self.params.len())?;
        let mut new = Self::new(self.source.clone(), self.planes.clone(), params);
        new.adam = take_adam(state, &format!("{}.0", names.moments), &new.adam)?;
        Ok(Box::new(new))
    }
}

/// Planes behind either decoder, the networks of the hybrid model where none is asked for.
fn planes(config: &mut RayConfig, planes: PlaneSource) {
    if planes.times.is_empty() && config.terms.distortion == 0.0 {
        config.terms.distortion = DISTORTION;
    }
    config.features = Arc::new(planes);
    (config.networks.width, config.networks.colour_layers) = (64, 2);
    let explicit = ExplicitConfig { density_bias: config.networks.density_bias, ..ExplicitConfig::PAPER };
    config.decoder = Some(DecoderChoice { decoder: DecoderKind::Hybrid, explicit });
    config.rates.lr = RATE;
}

/// The field of a scene that moves.
pub(crate) fn field(config: &mut RayConfig, data: &Dataset) {
    planes(config, PlaneSource::of(data));
}

/// Learning rate of either model; 0.01 as released is too small for runs of minutes, and with 0.04 the explicit model fails on lego
/// with most seeds (`docs/decisions/0039-k-planes.md`).
const RATE: f32 = 0.02;
/// Factor of the distortion loss of scenes at rest, as released.
const DISTORTION: f32 = 1e-3;

/// Planes for a scene at rest.
pub(crate) fn build(mut ask: Ask<'_>) -> Built {
    if Shown::of(ask.scene) == Shown::Times {
        return moving_field(ask, &Moving { field, asked: chosen_sampler, ..Moving::STILL });
    }
    let mut ground = ask.ground()?;
    let mut config = field_settings(&mut ground, ask.data);
    planes(&mut config, PlaneSource::still());
    let config = chosen_sampler(config, &mut ask.settings)?;
    let all = ask.settings.all()?;
    let system = ground.moving(ask.data, &config, ask.run.seed, ask.scene, CLAIM.name, MovingParts::default())?;
    Ok((Box::new(system), planned(ground, all)))
}
