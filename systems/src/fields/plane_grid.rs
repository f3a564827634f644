//! Products of planes of features, at several scales: three planes of space and, for scenes that move, three of time.
//!
//! ```text
//! f_s(q) = prod_c psi(P_c^s, pi_c(q))      q = (x, y, z) of a scene at rest, (x, y, z, t) of one that moves
//! f(q)   = concat_s f_s(q)                 scales s; time is not multiplied by s
//! ```
//!
//! Fridovich-Keil, Meanti, Warburg, Recht, Kanazawa, "K-Planes: Explicit Radiance Fields in Space, Time, and Appearance", 2023, equation
//! 1; what smooths the planes: equations 3 to 5. Planes of space begin uniform, planes of time at 1: the scene stands still until the
//! photos say otherwise.

use super::view_times::steps_of_time;
use super::{Detail, FeatureSource, Features, Names, Part, Places};
use crate::buffers::{shapes_hold, sized};
use crate::schedule::Done;
use crate::settings::{Settings, together};
use engine::memory::room_for;
use engine::system::{SystemError, Tensor, TensorMap, f32_tensor, push_adam, take_adam, take_numbers};
use field_core::encoding::EncodingBars;
use field_core::encoding::planes::{KPlanes, PlaneInfo, SPACE_INIT};
use field_core::rng::Rng;
use float_core::Simd;
use losses::planes::{
    Along, PlaneShape, distance_from_one_backward, plane_variation_backward, time_smoothness_backward,
};
use optim::{Adam, AdamConfig, BLOCK, touched_len};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::Arc;

/// Planes of features.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PlaneGridSettings {
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
    /// Factor of the second differences of planes of time along the time, the mean over these planes.
    pub(crate) plane_smoothness: f32,
    /// Factor of the distance of planes of time from 1.
    pub(crate) plane_transients: f32,
}

impl PlaneGridSettings {
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
pub(crate) struct PlaneGridSource {
    settings: PlaneGridSettings,
    times: Arc<[f32]>,
}

impl PlaneGridSource {
    /// Planes with these settings; of time too, where there are times.
    pub(crate) fn new(settings: PlaneGridSettings, times: Arc<[f32]>) -> Self {
        Self { settings, times }
    }

    /// Whether the planes are of space alone.
    pub(crate) fn is_still(&self) -> bool {
        self.times.is_empty()
    }

    fn time_steps(&self) -> u32 {
        if self.settings.plane_times > 0 {
            return self.settings.plane_times.max(2);
        }
        steps_of_time(&self.times)
    }

    fn planes(&self) -> Result<KPlanes, SystemError> {
        let PlaneGridSettings { plane_vertices, plane_scales, plane_features, .. } = &self.settings;
        let space = [*plane_vertices; 3];
        let planes = if self.times.is_empty() {
            KPlanes::still(space, plane_scales, *plane_features)
        } else {
            KPlanes::moving(space, self.time_steps(), plane_scales, *plane_features)
        };
        planes.map_err(|e| together("plane_vertices, plane_scales, plane_features, plane_times", &self.settings, e))
    }
}

impl FeatureSource for PlaneGridSource {
    fn asked(&self, settings: &mut Settings<'_>) -> Result<Arc<dyn FeatureSource>, SystemError> {
        let settings = settings.of(&self.settings)?;
        settings.check()?;
        Ok(Arc::new(Self { settings, times: self.times.clone() }))
    }

    fn proposal(&self, round: usize) -> Arc<dyn FeatureSource> {
        let plane_vertices = 64 << round.min(1);
        let PlaneGridSettings { plane_variation, plane_smoothness, .. } = self.settings;
        let settings = PlaneGridSettings {
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
        Ok(Box::new(PlaneGridFeatures::new(self.clone(), planes, params)))
    }
}

/// Factor of the variation of proposals at most, and that of their second differences as a share of the field's.
const PROPOSAL_VARIATION: f32 = 1e-4;
const PROPOSAL_SMOOTHNESS: f32 = 0.01;

/// Adam as released.
const ADAM: AdamConfig = AdamConfig::DEFAULT.with_eps(1e-15);

/// Products of planes, and their optimiser.
struct PlaneGridFeatures {
    source: PlaneGridSource,
    simd: Simd,
    planes: KPlanes,
    all: Vec<PlaneInfo>,
    params: Vec<f32>,
    adam: Adam,
    /// 0 between steps.
    grad: Vec<f32>,
    /// A bit for each block of parameters that a step changes, where not all do.
    touched: Vec<u64>,
    /// `[chunks][in_rows][n]`, points of a step.
    points: Vec<Vec<f32>>,
}

impl PlaneGridFeatures {
    fn new(source: PlaneGridSource, planes: KPlanes, params: Vec<f32>) -> Self {
        Self {
            source,
            simd: Simd::best(),
            all: planes.planes().collect(),
            adam: Adam::new(params.len(), ADAM),
            grad: vec![0.0; params.len()],
            touched: vec![0; touched_len(params.len())],
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
        let PlaneGridSettings { plane_features: features, plane_variation, plane_smoothness, plane_transients, .. } =
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
            if variation > 0.0 {
                plane_variation_backward(params, shape, along, variation, grad).expect(fits);
            }
            if plane.has_time() {
                time_smoothness_backward(params, shape, smoothness, grad).expect(fits);
                distance_from_one_backward(params, transients, grad).expect(fits);
            }
        });
    }

    /// Mark what a step changes where nothing smooths planes of space: planes of time, and the rows of planes of space that points lie
    /// in. What no point has seen is left as it is, as in a hash grid.
    fn mark(&mut self) {
        let features = self.source.settings.plane_features;
        for plane in &self.all {
            if plane.has_time() {
                mark(&mut self.touched, plane.range.clone());
                continue;
            }
            let (mut rows, last) = (vec![false; plane.rows], plane.rows - 1);
            for points in &self.points {
                let n = points.len() / self.planes.in_rows();
                for q in &points[plane.axes[1] * n..][..n] {
                    // One row more on either side: the last digit is the kernel's.
                    let row = (((0.5 * q + 0.5) * last as f32) as usize).min(last);
                    (row.saturating_sub(1)..=row + 2).for_each(|row| rows[row.min(last)] = true);
                }
            }
            let long = plane.columns * features;
            for row in (0..plane.rows).filter(|row| rows[*row]) {
                let first = plane.range.start + row * long;
                mark(&mut self.touched, first..first + long);
            }
        }
    }
}

/// Mark the blocks of some parameters.
fn mark(touched: &mut [u64], range: Range<usize>) {
    for block in range.start / BLOCK..range.end.div_ceil(BLOCK) {
        touched[block / 64] |= 1 << (block % 64);
    }
}

impl Features for PlaneGridFeatures {
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

    /// Each scale is one task, over the chunks in their order; then the regularisers, and Adam: on all numbers, or where no planes of space are
    /// smoothed on what may have changed.
    fn step(&mut self, lr: f64, parts: &[Part<'_>]) -> usize {
        let mut points = std::mem::take(&mut self.points);
        points.resize_with(parts.len(), Vec::new);
        points.par_iter_mut().zip(parts).for_each(|(points, part)| {
            points.clear();
            points.resize(self.planes.in_rows() * part.places.len(), 0.0);
            self.fill_points(part.places, points);
        });
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
        if self.source.settings.plane_variation > 0.0 {
            let bad = self.adam.step(self.simd, lr, &mut self.params, &self.grad);
            self.grad.fill(0.0);
            return bad;
        }
        self.mark();
        self.adam.step_touched(self.simd, lr, &mut self.params, &mut self.grad, &mut self.touched)
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

#[cfg(test)]
#[path = "plane_grid_tests.rs"]
mod tests;
