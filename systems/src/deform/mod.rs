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

mod build;
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

use engine::data::Dataset;
use engine::system::{SkipRow, SystemError};
use field_core::encoding::frequency::Frequency;
use field_core::encoding::planes::Planes;
use field_core::encoding::window;
use field_core::mlp::{Mlp, Packed};
use float_core::Simd;
use moments::TimeNetwork;
use optim::Adam;
use std::sync::atomic::{AtomicU64, Ordering};

/// Views that a curriculum begins with.
const CURRICULUM_LEAST: usize = 3;

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

impl Deform {
    /// A deformation that moves nothing yet.
    ///
    /// # Errors
    /// [`SystemError::Config`] for networks that cannot be.
    pub(crate) fn new(config: DeformConfig, data: &Dataset, seed: u64) -> Result<Self, SystemError> {
        Self::of_times(config, Times::of(data), seed)
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

    /// Rows of the table of skips: points that were not warped; and where space folds over itself.
    pub(crate) fn skips(&self) -> Vec<SkipRow> {
        let read = |count: &AtomicU64| count.load(Ordering::Relaxed);
        let (all, warped) = (read(&self.counts.all), read(&self.counts.warped));
        let mut rows = Vec::new();
        if self.config.warp.is_some_and(|warp| warp.origin == Origin::Canonical) {
            let bound = "exact: nothing is warped at t = 0".to_string();
            rows.push(SkipRow::counted(
                "points at the canonical moment",
                (all.saturating_sub(warped), all),
                "points",
                bound,
            ));
        }
        let closed = read(&self.counts.closed);
        if closed > 0 {
            let (bound, all) = ("exact: they are multiplied by 0".to_string(), read(&self.counts.octaves));
            rows.push(SkipRow::counted("octaves of closed windows", (closed, all), "octaves of points", bound));
        }
        let looked = read(&self.counts.looked);
        if looked > 0 {
            // Nothing is skipped here: the loss does not see the sign of a determinant, so somebody has to say it.
            let bound = "not skipped, counted: the elastic loss does not see it".to_string();
            rows.push(SkipRow::counted(
                "points where space folds over",
                (read(&self.counts.folded), looked),
                "points",
                bound,
            ));
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
        self.smooth_planes();
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
