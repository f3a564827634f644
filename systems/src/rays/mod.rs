//! A system of rays: the driver that trains and renders a field, whatever it is made of.
//!
//! | part | room |
//! | --- | --- |
//! | what is learnt about places, and the networks behind it | [`crate::fields`] |
//! | where samples lie along a ray | [`crate::samplers`] |
//! | what whole rays cost | [`crate::terms`] |
//! | what moves | `deform` |
//! | appearance of photos, and what hides the scene in them | [`crate::photo_model`] |
//!
//! A step:
//!
//! 1. rays of random training pixels; samples where the sampler finds something (`chunk.rs`);
//! 2. features -> density network -> density and geometry; with the view direction's spherical harmonics -> colour network ->
//!    colour; composited to pixels; the loss, and all of it backwards (`tile.rs`);
//! 3. the gradients of the chunks, added in their order, and a step of each part's optimiser (`step.rs`).

mod account;
#[cfg(test)]
mod budget_tests;
#[cfg(test)]
mod canonical_tests;
mod chunk;
mod config;
mod context;
mod fit;
#[cfg(test)]
mod gradient_tests;
mod head;
#[cfg(test)]
mod moving_tests;
mod points;
mod prepass;
#[cfg(test)]
mod proposal_tests;
mod ray_gradient;
#[cfg(test)]
mod ray_gradient_tests;
mod render;
mod second_render;
#[cfg(test)]
mod second_render_tests;
mod state;
mod step;
mod survey;
mod tile;

pub use config::{BatchConfig, RateConfig, RayConfig, SamplerConfig};
pub use head::{HeadConfig, MixtureKind};

use crate::fields::Field;
use crate::photo_model::{PhotoModel, Pixel};
use crate::samplers::{CueConfig, MeasuredDepth, Moves, Occupancy, ProposalNetwork, Proposals, Sampler};
use crate::space::{Space, SpaceKind};
use crate::survey::Surveys;
use crate::terms::RayTerm;
use crate::warps::{Deform, StillWork};
use account::{Seconds, Skipped};
use chunk::Chunk;
use engine::data::{Batch, Dataset, ErrorMap, Guide};
use engine::options::Background;
use engine::system::{
    Appearance, Fit, Layers, Query, SkipRow, StepStats, System, SystemError, Tensor, TensorMap, Trial,
};
use field_core::rng::Rng;
use head::Head;
use optim::{Adam, AdamConfig, Decay, NonFiniteGuard};
use render_core::budget::Ledger;
use render_core::ray::Ray;
use render_core::ray_distance::{RayDistance, RaySpacing};
use second_render::SecondRenders;

/// Chunks of a batch: fixed, so that sums do not depend on the number of threads.
const CHUNKS: usize = 16;

/// Stream of random numbers of the initial parameters.
const INIT: u64 = 0x696e_6974;

/// Rays of the first batch, before it is known how many samples a ray has.
const FIRST_RAYS: usize = 256;

/// The system.
pub struct RaySystem {
    name: &'static str,
    config: RayConfig,
    seed: u64,
    background: Background,
    space: Space,
    /// What whole rays cost.
    terms: Vec<Box<dyn RayTerm>>,
    field: Field,
    /// What one photo alone shows; only where a method asks.
    head: Option<Head>,
    sampler: Sampler,
    /// What else the loss depends on; `None`: the photos show the scene as it is.
    method: Option<Box<dyn PhotoModel>>,
    /// Where the photos are explained badly still, where that is asked for.
    errors: Option<ErrorMap>,
    /// Which pixels are drawn, where masks say so.
    guide: Option<Guide>,
    /// Measured depth; `None` where there is none, or nobody asks for it.
    cues: Option<MeasuredDepth>,
    density_adam: Adam,
    colour_adam: Adam,
    guard: NonFiniteGuard,
    /// Rays of the next batch.
    rays: usize,
    work: Work,
    seconds: Seconds,
    skipped: Skipped,
}

/// Pixels to render and all that is random about them.
#[derive(Default)]
struct Inputs {
    batch: Batch,
    /// `[pixels * rays of a pixel]`
    rays: Vec<Ray>,
    background: Vec<[f32; 3]>,
    /// Colours on that background.
    truth: Vec<[f32; 3]>,
    /// `[1 + proposals][rays]`, jitter of each ray's first sample, `[0, 1)`.
    jitter: Vec<f32>,
}

/// What steps reuse.
struct Work {
    inputs: Inputs,
    chunks: Vec<Chunk>,
    density_grad: Vec<f32>,
    colour_grad: Vec<f32>,
    head_grad: Vec<f32>,
    packed_grad: Vec<f32>,
    /// All pixels of the batch as they were rendered, and the gradients of their codes; only where a method asks.
    seen: Vec<Pixel>,
    appearance_bar: Vec<f32>,
    transient_bar: Vec<f32>,
    /// The background's pull on what moves.
    still: StillWork,
    /// What is rendered in another light; empty until a method asks.
    second_renders: SecondRenders,
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
        method: Option<Box<dyn PhotoModel>>,
        deform: Option<Deform>,
    ) -> Result<Self, SystemError> {
        config.check()?;
        let codes = method.as_ref().map_or([None; 2], |m| [m.appearance(), m.transient()]);
        let [appearance, transient] = codes.map(|codes| codes.map(|codes| codes.dims));
        let moving = deform.is_some();
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
            return refuse("a scene that moves needs `occupancy`: proposals know of one moment only");
        }
        let networks = AdamConfig::NGP.with_decay(Decay::L2(f64::from(config.rates.weight_decay)));
        let work = Work {
            inputs: Inputs::default(),
            chunks: (0..CHUNKS).map(|_| Chunk::new(&field, head.as_ref())).collect(),
            density_grad: vec![0.0; field.density_params.len()],
            colour_grad: vec![0.0; field.colour_params.len()],
            head_grad: vec![0.0; head.as_ref().map_or(0, |head| head.params.len())],
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
            rays: FIRST_RAYS.min(config.batch.batch_rays),
            terms: config.terms.terms(normalised_distance(&space, config.space.near)),
            name,
            config,
            seed,
            background,
            space,
            method,
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

    /// Cells of an occupancy grid that no training view sees, or that a view with alpha sees through, are empty for good.
    ///
    /// # Errors
    /// [`SystemError::Scene`] when an image cannot be read.
    pub fn carve(&mut self, data: &Dataset) -> Result<(), SystemError> {
        let scene = if self.is_timed() { Moves::Yes } else { Moves::No };
        self.sampler.occupancy_mut().map_or(Ok(()), |occupancy| occupancy.carve(&self.space, data, scene))
    }

    /// Part of a ray's colour that faint samples are left out with; nothing where something else than the scene learns from
    /// them.
    fn faint(&self) -> f32 {
        let all = self.sampler.proposals().is_some() || self.head.is_some();
        if all { 0.0 } else { self.config.batch.train_faint }
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
    pub(crate) fn follow_depth(&mut self, config: CueConfig, data: &Dataset) -> Result<bool, SystemError> {
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
    fn refine_depth(&mut self, data: &Dataset, step: u64) -> Result<(), SystemError> {
        let Some(mut cues) = self.cues.take_if(|cues| cues.is_due(step)) else { return Ok(()) };
        let refined = cues.refine(self, &self.space, self.background.colour(), data, step);
        self.cues = Some(cues);
        refined
    }
}

impl System for RaySystem {
    fn name(&self) -> &'static str {
        self.name
    }

    fn step(&mut self, data: &Dataset, step: u64) -> Result<StepStats, SystemError> {
        self.train_step(data, step)
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
        Some(self.method.as_ref()?.appearance()?.code_of(appearance))
    }

    fn fit_appearance(&self, pixels: &Fit<'_>) -> Option<Vec<f32>> {
        fit::fit(self, pixels)
    }

    fn encode_appearance(&self, photo: &scene_io::Image) -> Option<Vec<f32>> {
        self.method.as_ref()?.encode(photo)
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
        let method = self.method.as_ref().map_or(0, |method| method.parameter_count());
        let field = f.features.parameters().len() + f.density_params.len() + f.colour_params.len();
        field + self.sampler.parameter_count() + head + deform + method
    }

    fn memory_bytes(&self) -> usize {
        let chunks: usize = self.work.chunks.iter().chain(self.work.second_renders.chunks()).map(Chunk::bytes).sum();
        // Gradient and two moments of each parameter.
        self.field.bytes()
            + 12 * self.parameter_count()
            + chunks
            + self.sampler.bytes()
            + self.method.as_ref().map_or(0, |m| m.memory_bytes())
    }

    fn growth_bytes(&self) -> usize {
        self.field.features.growth_bytes()
    }

    fn skips(&self) -> Vec<SkipRow> {
        account::skips(self)
    }

    fn timings(&self) -> Vec<(&'static str, f64)> {
        account::timings(self)
    }
}
