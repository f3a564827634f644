//! The system, and what it is made of.

use super::chunk::Chunk;
use super::config::{RayConfig, SamplerConfig};
use super::counts::{Seconds, Skipped};
use super::head::Head;
use super::movers::Movers;
use super::moving_config::MovingConfig;
use super::work::{CHUNKS, Inputs, SecondRenders, Work};
use crate::fields::{Field, NETWORK_ADAM};
use crate::photo_model::PhotoModel;
use crate::samplers::{DepthCueConfig, MeasuredDepth, Moves, Occupancy, ProposalNetwork, Proposals, Sampler};
use crate::schedule::Course;
use crate::space::{Space, SpaceKind};
use crate::terms::RayTerm;
use crate::warps::{Deform, StillWork};
use engine::data::{Dataset, ErrorMap, Guide};
use engine::options::Background;
use engine::system::SystemError;
use field_core::rng::Rng;
use optim::{Adam, Decay, NonFiniteGuard};
use render_core::ray_distance::{RayDistance, RaySpacing};

/// Stream of random numbers of the initial parameters.
const INIT: u64 = 0x696e_6974;

/// Rays of the first batch, before it is known how many samples a ray has.
const FIRST_RAYS: usize = 256;

/// The system.
pub struct RaySystem {
    pub(super) name: &'static str,
    pub(super) config: RayConfig,
    pub(super) seed: u64,
    pub(super) background: Background,
    pub(super) space: Space,
    /// What whole rays cost.
    pub(super) terms: Vec<Box<dyn RayTerm>>,
    pub(super) field: Field,
    /// What one photo alone shows; only where a photo model asks.
    pub(super) head: Option<Head>,
    pub(super) sampler: Sampler,
    /// What else the loss depends on; `None`: the photos show the scene as it is.
    pub(super) photo_model: Option<Box<dyn PhotoModel>>,
    /// Where the photos are explained badly still, where that is asked for.
    pub(super) errors: Option<ErrorMap>,
    /// Which pixels are drawn, where masks say so.
    pub(super) guide: Option<Guide>,
    /// What a part of the field for what moves waits for; `None`: there is no such part.
    pub(super) movers: Option<Movers>,
    /// Measured depth; `None` where there is none, or it is not asked for.
    pub(super) cues: Option<MeasuredDepth>,
    pub(super) density_adam: Adam,
    pub(super) colour_adam: Adam,
    pub(super) guard: NonFiniteGuard,
    /// The schedule, and where the training is in it.
    pub(super) course: Course,
    /// Rays of the next batch.
    pub(super) rays: usize,
    pub(super) work: Work,
    pub(super) seconds: Seconds,
    pub(super) skipped: Skipped,
}

/// Normalised distance of a ray: even across a box, half linear and half inverse where space has no end.
fn normalised_distance(space: &Space, near: f32) -> RayDistance {
    let near = f64::from(near);
    let (warp, far) = match space.kind() {
        SpaceKind::Contracted => (RaySpacing::Piecewise, f64::INFINITY),
        // Further than any ray from a camera nearby goes through a box of half side 1.
        SpaceKind::Box | SpaceKind::Ndc => (RaySpacing::Linear, near + 8.0),
    };
    RayDistance::new(warp, near, far).expect("`near` is positive and finite, and checked before")
}

impl RaySystem {
    /// A system of these parts before its first step, under the name of the composition.
    ///
    /// # Errors
    /// [`SystemError::Config`] for settings that cannot work.
    pub(crate) fn new(
        config: RayConfig,
        space: Space,
        background: Background,
        seed: u64,
        name: &'static str,
        photo_model: Option<Box<dyn PhotoModel>>,
        deform: Option<Deform>,
    ) -> Result<Self, SystemError> {
        config.check()?;
        let codes = photo_model.as_ref().map_or([None; 2], |m| [m.appearance(), m.transient()]);
        let [appearance, transient] = codes.map(|codes| codes.map(|codes| codes.dims));
        let moving = deform.is_some() || config.moving.is_some();
        let (movers, deform) = match &config.moving {
            Some(moving) => (Some(Movers::new(moving.clone(), deform)), None),
            None => (None, deform),
        };
        let rng = Rng::new(seed, INIT);
        let features = config.features.features(rng.substream(0))?;
        let field = Field::new(features, config.decoder(), appearance.unwrap_or(0), deform, &rng)?;
        let (sampler, step_min) = Self::sampler(&config, seed)?;
        let refuse = |problem: &str| {
            Err(SystemError::Config { field: "sampler", value: "proposal".into(), problem: problem.into() })
        };
        let head = match (transient, step_min) {
            (None, _) => None,
            (Some(_), None) => {
                return refuse("a transient part needs `occupancy`: proposals know of static matter only");
            }
            (Some(dims), Some(step_min)) => {
                let config = config.head.unwrap_or_default();
                Some(Head::new(field.density.outputs(), dims, &config, step_min, rng.substream(3))?)
            }
        };
        if moving && sampler.proposals().is_some() {
            return refuse("a scene that moves needs `occupancy`: proposals know of one time only");
        }
        let networks = NETWORK_ADAM.with_decay(Decay::L2(f64::from(config.rates.weight_decay)));
        let work = Work {
            inputs: Inputs::default(),
            chunks: (0..CHUNKS).map(|_| Chunk::new(&field, head.as_ref())).collect(),
            density_grad: vec![0.0; field.density_params.len()],
            colour_grad: vec![0.0; field.colour_params.len()],
            head_grad: vec![0.0; head.as_ref().map_or(0, |head| head.params.len())],
            moving_grad: Vec::new(),
            packed_grad: Vec::new(),
            seen: Vec::new(),
            appearance_bar: Vec::new(),
            transient_bar: Vec::new(),
            still: StillWork::default(),
            second_renders: SecondRenders::default(),
        };
        Ok(Self {
            errors: None,
            guide: None,
            cues: None,
            density_adam: Adam::new(field.density_params.len(), networks),
            colour_adam: Adam::new(field.colour_params.len(), networks),
            guard: NonFiniteGuard::default(),
            course: Course::default(),
            rays: FIRST_RAYS.min(config.batch.batch_rays),
            terms: config
                .terms
                .terms(normalised_distance(&space, config.space.near))
                .into_iter()
                .chain(config.moving.as_ref().and_then(MovingConfig::term))
                .collect(),
            movers,
            name,
            config,
            seed,
            background,
            space,
            photo_model,
            field,
            head,
            sampler,
            work,
            seconds: Seconds::default(),
            skipped: Skipped::default(),
        })
    }

    /// What places samples, and the length of the smallest step where that is fixed.
    fn sampler(config: &RayConfig, seed: u64) -> Result<(Sampler, Option<f32>), SystemError> {
        let bias = config.decoder().density_bias();
        Ok(match &config.sampler {
            SamplerConfig::Occupancy(occupancy) => {
                let sampler = Occupancy::new(*occupancy, &config.space, bias)?;
                (Sampler::Occupancy(Box::new(sampler)), Some(occupancy.step_min))
            }
            SamplerConfig::Proposals(proposals) => {
                let weight_decay = f64::from(config.rates.weight_decay);
                let network = ProposalNetwork { density_bias: bias, weight_decay };
                let kind = config.space.space;
                (Sampler::Proposals(Proposals::new(proposals, &*config.features, kind, network, seed)?), None)
            }
        })
    }

    /// Whether anything depends on the time, or may come to.
    pub(crate) fn may_move(&self) -> bool {
        self.is_timed() || self.movers.is_some()
    }

    /// Cells of an occupancy grid that no training view sees, or that a view with alpha sees through, are empty for good.
    ///
    /// # Errors
    /// [`SystemError::Scene`] when an image cannot be read.
    pub fn carve(&mut self, data: &Dataset) -> Result<(), SystemError> {
        let scene = if self.may_move() { Moves::Yes } else { Moves::No };
        self.sampler.occupancy_mut().map_or(Ok(()), |occupancy| occupancy.carve(&self.space, data, scene))
    }

    /// Part of a ray's colour that faint samples are left out with; nothing where something else than the scene learns from
    /// them.
    pub(super) fn faint(&self) -> f32 {
        let all = self.sampler.proposals().is_some() || self.head.is_some();
        if all { 0.0 } else { self.config.batch.train_faint }
    }

    /// Learn by a schedule of `horizon` steps, which keeps up with the time of a training that stops after seconds.
    pub(crate) fn follow_schedule(&mut self, horizon: u64) {
        self.course = Course::new(horizon);
    }

    /// Let errors lead the rays.
    pub(crate) fn follow_errors(&mut self, data: &Dataset) {
        self.errors = Some(ErrorMap::new(data));
    }

    /// Let masks lead the rays. Where there are any, the number of views of which they leave nothing.
    ///
    /// # Errors
    /// [`SystemError::Scene`] when an image cannot be read.
    pub(crate) fn follow_masks(&mut self, data: &Dataset) -> Result<Option<usize>, SystemError> {
        self.guide = Guide::of(data)?;
        Ok(self.guide.as_ref().map(Guide::hidden_views))
    }

    /// Let measured depth lead the training. Whether there is any.
    ///
    /// # Errors
    /// [`SystemError::Scene`] when a depth map cannot be read.
    pub(crate) fn follow_depth(&mut self, config: DepthCueConfig, data: &Dataset) -> Result<bool, SystemError> {
        self.cues = MeasuredDepth::read(config, &self.space, data)?;
        Ok(self.cues.is_some())
    }

    /// Whether anything depends on the time.
    pub(crate) fn is_timed(&self) -> bool {
        self.field.is_timed()
    }

    /// Share of the occupancy grid's cells that are empty for good; `None` where there is no such grid.
    #[must_use]
    pub fn carved(&self) -> Option<f64> {
        self.sampler.occupancy().map(Occupancy::carved)
    }

    /// Let the measured depths that disagree most with the rendered ones give way to these, where it is their turn.
    pub(super) fn refine_depth(&mut self, data: &Dataset, step: u64) -> Result<(), SystemError> {
        // Of the schedule: what is reached with the step before.
        let course = &self.course;
        let reached = |every| step.checked_sub(1).map_or(0, |last| course.steps_done(last, every));
        let Some(mut cues) = self.cues.take_if(|cues| cues.is_due(reached(cues.every()))) else { return Ok(()) };
        let refined = cues.refine(self, &self.space, self.background.colour(), data, step);
        self.cues = Some(cues);
        refined
    }
}
