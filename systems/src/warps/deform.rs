//! A deformation with its parameters, their optimiser and its losses.

use super::curriculum::Curriculum;
use super::deformation::Deformation;
use super::motion::Origin;
use super::parameters::Parameters;
use super::points::DeformGrad;
use super::regularisers::{BackgroundSettings, CoherenceSettings, ElasticSettings};
use super::time::{Time, TimeSettings, TimeSteps};
use super::window::Window;
use engine::system::SystemError;
use float_core::Simd;
use optim::{Adam, AdamConfig};
use std::sync::atomic::AtomicU64;

/// Points that were placed, and those of them that had to be warped.
#[derive(Debug, Default)]
pub(crate) struct Counts {
    pub(super) all: AtomicU64,
    pub(super) warped: AtomicU64,
    /// Points of an elastic loss, and those of them where it saw space folded over itself.
    pub(super) elastic: AtomicU64,
    pub(super) folded: AtomicU64,
    /// Octaves of windows, once for each point that was recorded, and those of them that were closed.
    pub(super) octaves: AtomicU64,
    pub(super) closed: AtomicU64,
}

/// A deformation, its parameters and their optimiser.
pub(crate) struct Deform {
    pub(super) deformation: Box<dyn Deformation>,
    pub(super) time: Time,
    /// `[dims]`, `t = 0` as networks see it, where the canonical scene is tied to that time.
    pub(super) origin: Option<Vec<f32>>,
    pub(super) elastic: ElasticSettings,
    pub(super) coherence: CoherenceSettings,
    pub(super) background: BackgroundSettings,
    pub(super) curriculum: Curriculum,
    pub(super) simd: Simd,
    /// Those of networks, then those of planes.
    pub(super) params: Vec<f32>,
    /// How many of them are of networks.
    pub(super) networks: usize,
    pub(super) adam: Adam,
    pub(super) plane_adam: Adam,
    pub(super) grad: Vec<f32>,
    /// The time steps of the training views.
    pub(super) steps: TimeSteps,
    /// Share of the schedule that is done, from 0 to 1, and what was done of it before the first step.
    pub(super) done: f64,
    pub(super) began: f64,
    /// `[3][n]`, points of the background in the unit cube.
    pub(super) background_points: Vec<f32>,
    /// Points that were warped, and all of them.
    pub(super) counts: Counts,
}

impl Deform {
    /// A deformation that moves nothing yet.
    pub(crate) fn new(deformation: Box<dyn Deformation>, time: Time, parameters: Parameters) -> Self {
        let Parameters { simd, values: params, networks, .. } = parameters;
        let mut deform = Self {
            adam: Adam::new(networks, AdamConfig::DEFAULT),
            plane_adam: Adam::new(params.len() - networks, AdamConfig::DEFAULT),
            grad: vec![0.0; params.len()],
            curriculum: Curriculum::new(time.times()),
            elastic: ElasticSettings::NONE,
            coherence: CoherenceSettings::NONE,
            background: BackgroundSettings::NONE,
            steps: TimeSteps::default(),
            done: 0.0,
            began: 0.0,
            background_points: Vec::new(),
            counts: Counts::default(),
            // Nothing is learned of such a time: see `Warp::new`.
            origin: (deformation.origin() == Origin::Tied).then(|| time.steps_at(&[0.0], |_| false).rows),
            deformation,
            time,
            simd,
            params,
            networks,
        };
        deform.renew();
        deform
    }

    /// It takes its first step after the share `done` of the schedule.
    pub(crate) fn begin(&mut self, done: f64) {
        self.began = done;
    }

    /// The same with an elastic loss.
    ///
    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot be.
    pub(crate) fn with_elastic(self, elastic: ElasticSettings) -> Result<Self, SystemError> {
        elastic.check()?;
        Ok(Self { elastic, ..self })
    }

    /// The same with a coherence loss.
    ///
    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot be.
    pub(crate) fn with_coherence(self, coherence: CoherenceSettings) -> Result<Self, SystemError> {
        coherence.check()?;
        Ok(Self { coherence, ..self })
    }

    /// The same with a background loss.
    ///
    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot be.
    pub(crate) fn with_background(self, background: BackgroundSettings) -> Result<Self, SystemError> {
        background.check()?;
        Ok(Self { background, ..self })
    }

    /// The same with views that come in one after the other, within this share of the schedule; 0: all are there from the start.
    pub(crate) fn with_curriculum(mut self, share: f64) -> Self {
        self.curriculum.share = share;
        self
    }

    /// Whether anything depends on the time.
    pub(crate) fn does_something(&self) -> bool {
        self.warps() || self.seen_rows() > 0
    }

    /// Rows that the density network sees besides features.
    pub(crate) fn seen_rows(&self) -> usize {
        self.deformation.seen_rows()
    }

    /// The training views that this step draws from; `None`: all.
    pub(crate) fn open_views(&self) -> Option<&[u32]> {
        self.curriculum.open(self.done)
    }

    /// Whether points are moved at all.
    pub(crate) fn warps(&self) -> bool {
        self.deformation.warps()
    }

    /// Its elastic loss.
    pub(crate) fn config(&self) -> &ElasticSettings {
        &self.elastic
    }

    /// Factor of its elastic loss at what is done of the schedule.
    pub(crate) fn elastic_factor(&self) -> f32 {
        let ElasticSettings { elastic, elastic_rise: length, .. } = self.elastic;
        elastic * Window::Over { from: self.began, length }.open(self.done) as f32
    }

    /// Factor of its coherence loss; 0 where no point is moved.
    pub(crate) fn coherence_factor(&self) -> f32 {
        if self.warps() { self.coherence.coherence } else { 0.0 }
    }

    /// Whether a loss depends on the weights of samples.
    pub(crate) fn costs_by_weight(&self) -> bool {
        self.elastic.elastic > 0.0 || self.coherence_factor() > 0.0
    }

    /// The time steps of the training views.
    pub(crate) fn time_steps(&self) -> &TimeSteps {
        &self.steps
    }

    /// The time steps of times in `[0, 1]`.
    pub(crate) fn time_steps_at(&self, times: &[f64]) -> TimeSteps {
        self.time.steps_at(times, |t| self.deformation.origin().rests(t))
    }

    /// Everything that follows from parameters and what is done of the schedule.
    pub(super) fn renew(&mut self) {
        self.deformation.renew(&self.params, self.done);
        self.time.renew();
        let times: Vec<f64> = self.time.times().of_views().collect();
        self.steps = self.time_steps_at(&times);
    }

    /// Fold the gradients of a batch's parts, in order, and take a step, after which the share `done` of the schedule is over. Returns
    /// the count of non-finite gradients.
    pub(crate) fn step<'g>(
        &mut self,
        parts: impl Iterator<Item = &'g DeformGrad> + Clone,
        lr: f64,
        done: f64,
    ) -> usize {
        self.grad.fill(0.0);
        let mut rows_bar = vec![0.0; self.steps.rows.len()];
        for part in parts {
            self.grad.iter_mut().zip(&part.params).for_each(|(sum, g)| *sum += g);
            rows_bar.iter_mut().zip(&part.times).for_each(|(sum, g)| *sum += g);
        }
        let planes = self.deformation.planes().filter(|planes| !planes.is_empty());
        if let Some(planes) = planes {
            planes.smooth(&self.params, &mut self.grad);
        }
        let plane_rate = planes.map(|planes| planes.settings().rate);
        let TimeSettings { rate, warmup, .. } = *self.time.settings();
        let lr = lr * rate * Window::Over { from: self.began, length: warmup }.open(done);
        let (networks, planes) = self.params.split_at_mut(self.networks);
        let (network_grad, plane_grad) = self.grad.split_at(self.networks);
        let mut bad = self.adam.step(self.simd, lr, networks, network_grad);
        if let Some(rate) = plane_rate {
            bad += self.plane_adam.step(self.simd, lr * rate, planes, plane_grad);
        }
        bad += self.time.learn(&rows_bar, lr);
        self.done = done;
        self.renew();
        bad
    }
}
