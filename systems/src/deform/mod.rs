//! What moves: the seam between a radiance field and a scene that is not the same at all times.
//!
//! A field knows one scene, the *canonical* one. A [`Deform`] says where in it the point of a moment is, and what else the
//! density there depends on:
//!
//! 1. a moment is a row of numbers (`Moments`): the time's sines and cosines, or a free code;
//! 2. `Deform::place`: points of a moment, in the unit cube, to canonical points, and rows for the density network;
//! 3. the field learns; `Deform::learn`: the gradient of both, back to networks, moments and points.
//!
//! A field without one does none of this. Where nothing is warped (`Moments::still`) points stay as they are, bit for bit,
//! and no network is asked.

mod config;
mod moments;
mod pass;
mod record;
mod regular;
mod state;
#[cfg(test)]
mod tests;
mod times;

pub use config::{Ambient, DeformConfig, ElasticAt, Moment, Motion, Origin, PlanesOfTime, SeenBy, Sees, Warp};
pub(crate) use moments::Moments;
pub(crate) use pass::{DeformGrad, DeformScratch, Points};
pub(crate) use regular::StillWork;
pub(crate) use times::Times;

use crate::data::Dataset;
use crate::static_scene::parts;
use crate::system::{SkipRow, SystemError};
use field_core::encoding::frequency::{Base, Frequency, Identity};
use field_core::encoding::planes::Planes;
use field_core::encoding::window;
use field_core::init::Init;
use field_core::mlp::{Activation, Bias, Mlp, MlpConfig, Packed};
use field_core::rng::Rng;
use float_core::Simd;
use moments::TimeNetwork;
use optim::{Adam, AdamConfig};
use std::sync::atomic::{AtomicU64, Ordering};

/// Stream of the initial parameters.
const INIT: u64 = 0x6465_666f;
/// Largest number the last layer of a warp begins with: points start where they are.
const SMALL: f32 = 1e-4;
/// Views that a curriculum begins with.
const CURRICULUM_LEAST: usize = 3;
/// Codes begin in `0..CODE` (Nerfies).
const CODE: f32 = 0.05;

/// A deformation and its optimiser.
pub struct Deform {
    config: DeformConfig,
    simd: Simd,
    times: Times,
    time: Frequency,
    time_network: Option<TimeNetwork>,
    /// Octaves of the point that the warp, the ambient network and the density network see.
    warp_point: Option<Frequency>,
    ambient_point: Option<Frequency>,
    seen_point: Option<Frequency>,
    seen_ambient: Option<Frequency>,
    warp: Option<Mlp>,
    ambient: Option<Mlp>,
    /// What the warp sees of place and time besides.
    planes: Vec<Planes>,
    /// Those of the warp, then those of the ambient network, then from `plane_start` on those of the planes.
    params: Vec<f32>,
    plane_start: usize,
    packed: [Packed; 2],
    adam: Adam,
    plane_adam: Adam,
    grad: Vec<f32>,
    /// `[moments][dims]`, or the parameters of the time network.
    codes: Vec<f32>,
    code_adam: Adam,
    code_grad: Vec<f32>,
    /// Those of the training views.
    moments: Moments,
    /// Steps taken.
    steps: u64,
    /// Weights of the warp's octaves, and of the ambient ones, as of this step.
    warp_window: Vec<f32>,
    ambient_window: Vec<f32>,
    /// `[3][n]`, points of the background in the unit cube.
    still_points: Vec<f32>,
    /// Training views in the order of time.
    order: Vec<u32>,
    /// Points that were warped, and all of them.
    pub(crate) counts: pass::Counts,
}

fn refuse(e: impl ToString) -> SystemError {
    SystemError::Config { field: "warp, ambient", value: String::new(), problem: e.to_string() }
}

fn octaves(dims: usize, octaves: usize, identity: Identity) -> Result<Frequency, SystemError> {
    Frequency::new(dims, octaves, Base::One, identity).map_err(refuse)
}

/// Factors that begin small in space and at 1 in time: a product that does not depend on time yet (K-Planes, section 3.2).
fn init_planes(planes: &Planes, rng: &Rng, params: &mut [f32]) {
    for (k, pair) in planes.pairs().enumerate() {
        let params = &mut params[planes.plane_range(k)];
        if pair.contains(&3) {
            params.fill(1.0);
        } else {
            rng.substream(k as u64).fill_uniform(0, params);
            params.iter_mut().for_each(|p| *p = 0.1 + 0.4 * *p);
        }
    }
}

fn new_planes(config: &PlanesOfTime) -> Result<Vec<Planes>, SystemError> {
    let of = |&cells: &usize| {
        let r = [cells, cells, cells, config.times].map(|r| r.min(1 << 16) as u32);
        Planes::k_planes(r, config.features).map_err(refuse)
    };
    config.cells.iter().map(of).collect()
}

/// Hidden layers with a skip of the input into the fifth, where there are so many.
fn network(inputs: usize, (depth, width): (usize, usize), outputs: usize) -> Result<Mlp, SystemError> {
    let skips = if depth > 4 { vec![4] } else { vec![] };
    Mlp::new(&MlpConfig {
        inputs,
        hidden: vec![width; depth],
        outputs,
        bias: Bias::Zero,
        hidden_activation: Activation::Relu,
        output_activation: Activation::None,
        skips,
    })
    .map_err(refuse)
}

impl Deform {
    /// A deformation that moves nothing yet.
    ///
    /// # Errors
    /// [`SystemError::Config`] for networks that cannot be.
    pub(crate) fn new(config: DeformConfig, data: &Dataset, seed: u64) -> Result<Self, SystemError> {
        Self::of_times(config, Times::of(data), seed)
    }

    /// The same for training views of these times.
    fn of_times(config: DeformConfig, times: Times, seed: u64) -> Result<Self, SystemError> {
        let simd = Simd::best();
        let dims = Self::moment_dims(config.moment);
        let rng = Rng::new(seed, INIT);
        let (time_octaves, code_len) = match config.moment {
            Moment::Time { octaves } => (octaves, 0),
            Moment::TimeNetwork { octaves, .. } => (octaves, 0),
            Moment::Codes { dims } => (0, dims * times.len()),
        };
        let time = octaves(1, time_octaves, Identity::Include)?;
        let mut codes = vec![0.0; code_len];
        let mut time_network = None;
        if let Moment::TimeNetwork { width, .. } = config.moment {
            let mlp = network(time.out_rows(), (1, width), dims)?;
            codes = vec![0.0; mlp.param_count()];
            parts::init([&mlp], Init::XavierUniform, rng.substream(0), &mut codes);
            time_network = Some(TimeNetwork { mlp, packed: Packed::default() });
        } else {
            rng.substream(0).fill_uniform(0, &mut codes);
            codes.iter_mut().for_each(|c| *c *= CODE);
        }
        let encoding = |n: Option<usize>, dims, identity| n.map(|n| octaves(dims, n, identity)).transpose();
        let warp_point = encoding(config.warp.as_ref().map(|w| w.octaves), 3, Identity::Include)?;
        let ambient_point = encoding(config.ambient.map(|a| a.octaves), 3, Identity::Omit)?;
        let seen = match config.sees {
            Sees::MomentAndPoint { octaves } => Some(octaves),
            Sees::Place | Sees::Moment => None,
        };
        let seen_point = encoding(seen, 3, Identity::Include)?;
        let ambients = config.ambient.map_or(1, |a| a.dims);
        // Without the coordinates themselves, which no window closes: before they come in they say nothing.
        let seen_ambient = encoding(config.ambient.map(|a| a.seen_octaves), ambients, Identity::Omit)?;
        let rows = |f: &Option<Frequency>| f.as_ref().map_or(0, Frequency::out_rows);
        let planes = config.planes.as_ref().map_or(Ok(Vec::new()), new_planes)?;
        let leads = config.planes.as_ref().is_some_and(|p| p.seen_by != SeenBy::Density);
        let plane_rows: usize = planes.iter().map(Planes::features).filter(|_| leads).sum();
        let warp = config.warp.as_ref().map(|w| {
            let outputs = if w.motion == Motion::Rigid { 6 } else { 3 };
            network(rows(&warp_point) + dims + plane_rows, (w.depth, w.width), outputs)
        });
        let ambient = config.ambient.map(|a| network(rows(&ambient_point) + dims, (a.depth, a.width), a.dims));
        let (warp, ambient) = (warp.transpose()?, ambient.transpose()?);
        let count = |mlp: &Option<Mlp>| mlp.as_ref().map_or(0, Mlp::param_count);
        let (warps, all) = (count(&warp), count(&warp) + count(&ambient));
        let plane_params: usize = planes.iter().map(Planes::params_len).sum();
        let mut params = vec![0.0; all + plane_params];
        let mut at = all;
        for (k, planes) in planes.iter().enumerate() {
            init_planes(planes, &rng.substream(8 + k as u64), &mut params[at..]);
            at += planes.params_len();
        }
        let places = [(&warp, 0..warps), (&ambient, warps..all)];
        for (k, (mlp, range)) in places.into_iter().enumerate() {
            let Some(mlp) = mlp else { continue };
            let (rng, params) = (rng.substream(1 + k as u64), &mut params[range]);
            parts::init([mlp], Init::XavierUniform, rng, params);
            // Points begin where they are.
            if let Some(last) = mlp.layers().last() {
                rng.substream(u64::MAX).fill_uniform(0, &mut params[last.weights.clone()]);
                params[last.weights.clone()].iter_mut().for_each(|w| *w *= SMALL);
            }
        }
        let mut deform = Self {
            adam: Adam::new(all, AdamConfig::DEFAULT),
            plane_adam: Adam::new(plane_params, AdamConfig::DEFAULT),
            plane_start: all,
            grad: vec![0.0; all + plane_params],
            planes,
            code_adam: Adam::new(codes.len(), AdamConfig::DEFAULT),
            code_grad: vec![0.0; codes.len()],
            packed: Default::default(),
            moments: Moments::default(),
            steps: 0,
            warp_window: vec![0.0; config.warp.as_ref().map_or(0, |w| w.octaves)],
            ambient_window: vec![0.0; config.ambient.map_or(0, |a| a.seen_octaves)],
            counts: pass::Counts::default(),
            order: times.in_order(),
            still_points: Vec::new(),
            config,
            simd,
            times,
            time,
            time_network,
            warp_point,
            ambient_point,
            seen_point,
            seen_ambient,
            warp,
            ambient,
            params,
            codes,
        };
        deform.renew();
        Ok(deform)
    }

    /// Whether planes of place and time are seen by the warp (or by the density network).
    fn planes_for(&self, whom: SeenBy) -> bool {
        self.config.planes.as_ref().is_some_and(|p| p.seen_by == whom || p.seen_by == SeenBy::Both)
    }

    /// Rows that the density network sees besides features.
    pub(crate) fn seen_rows(&self) -> usize {
        let dims = Self::moment_dims(self.config.moment);
        let seen = match self.config.sees {
            Sees::Place => 0,
            Sees::Moment => dims,
            Sees::MomentAndPoint { .. } => dims + self.seen_point.as_ref().map_or(0, Frequency::out_rows),
        };
        let planes: usize = self.planes.iter().map(Planes::features).filter(|_| self.planes_for(SeenBy::Density)).sum();
        seen + planes + self.seen_ambient.as_ref().map_or(0, Frequency::out_rows)
    }

    /// The training views that this step draws from; `None`: all. The first ones in time come first (D-NeRF, section 4.2:
    /// the canonical scene is learnt before what is far from it).
    pub(crate) fn open_views(&self) -> Option<&[u32]> {
        let all = self.order.len();
        let open = (u128::from(self.steps) * all as u128).checked_div(self.config.curriculum.into());
        let open = open.map_or(all, |open| open as usize);
        (open < all).then(|| &self.order[..open.max(CURRICULUM_LEAST).min(all)])
    }

    /// Rows of the table of skips: points that were not warped, and octaves that were not there yet.
    pub(crate) fn skips(&self) -> Vec<SkipRow> {
        let read = |count: &AtomicU64| count.load(Ordering::Relaxed);
        let (all, warped) = (read(&self.counts.all), read(&self.counts.warped));
        let mut rows = Vec::new();
        if self.config.warp.is_some_and(|warp| warp.origin == Origin::Canonical) {
            let bound = "exact: nothing is warped at t = 0".to_string();
            rows.push(SkipRow::counted("points at the canonical moment", (all - warped, all), "points", bound));
        }
        rows
    }

    /// Whether points are moved at all.
    pub(crate) fn warps(&self) -> bool {
        self.warp.is_some()
    }

    /// What it is made of.
    pub(crate) fn config(&self) -> &DeformConfig {
        &self.config
    }

    /// Moments of the training views.
    pub(crate) fn moments(&self) -> &Moments {
        &self.moments
    }

    /// Everything that follows from parameters and the count of steps.
    fn renew(&mut self) {
        let [warp, ambient] = &mut self.packed;
        let at = self.warp.as_ref().map_or(0, Mlp::param_count);
        let ambients = &self.params[at..self.plane_start];
        for (mlp, params, packed) in [(&self.warp, &self.params[..at], warp), (&self.ambient, ambients, ambient)] {
            if let Some(mlp) = mlp {
                mlp.pack(params, packed);
            }
        }
        if let Some(network) = &mut self.time_network {
            network.mlp.pack(&self.codes, &mut network.packed);
        }
        if let Some(warp) = &self.config.warp {
            let done = if warp.anneal == 0 { 1.0 } else { self.steps as f64 / warp.anneal as f64 };
            window::nerfies(done.min(1.0) * warp.octaves as f64, &mut self.warp_window);
        }
        if let Some(ambient) = self.config.ambient {
            let [first, length] = ambient.anneal;
            let done = self.steps.saturating_sub(first) as f64 / length.max(1) as f64;
            window::nerfies(done.min(1.0) * ambient.seen_octaves as f64, &mut self.ambient_window);
        }
        let times: Vec<f64> = self.times.of_views().collect();
        self.moments = self.moments_at(&times);
    }

    /// Fold the gradients of a batch's parts, in order, and take a step. Returns the count of non-finite gradients.
    pub(crate) fn step<'g>(&mut self, parts: impl Iterator<Item = &'g DeformGrad> + Clone, lr: f64) -> usize {
        self.grad.fill(0.0);
        let mut rows_bar = vec![0.0; self.moments.rows.len()];
        for part in parts {
            self.grad.iter_mut().zip(&part.params).for_each(|(sum, g)| *sum += g);
            rows_bar.iter_mut().zip(&part.moments).for_each(|(sum, g)| *sum += g);
        }
        let lr = lr * self.config.rate;
        let (networks, planes) = self.params.split_at_mut(self.plane_start);
        let (network_grad, plane_grad) = self.grad.split_at(self.plane_start);
        let mut bad = self.adam.step(self.simd, lr, networks, network_grad);
        if let Some(config) = &self.config.planes {
            bad += self.plane_adam.step(self.simd, lr * config.rate, planes, plane_grad);
        }
        bad += self.learn_moments(&rows_bar, lr);
        self.steps += 1;
        self.renew();
        bad
    }
}
