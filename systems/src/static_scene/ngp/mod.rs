//! Instant-NGP: a hash grid, two tiny networks, an occupancy grid.
//!
//! Müller, Evans, Schied, Keller, "Instant Neural Graphics Primitives with a Multiresolution Hash Encoding", 2022.
//!
//! A step, as in the paper's section on NeRF:
//!
//! 1. rays of random training pixels; samples only where the occupancy grid has something (`chunk.rs`);
//! 2. hash grid -> density network -> density and geometry features; with the view direction's spherical harmonics
//!    -> colour network -> colour; composited to pixels; the loss, and all of it backwards;
//! 3. the gradient of each level of the grid, scattered in sample order, and Adam on the entries it touched;
//! 4. now and then, the occupancy grid looks at the field (`occupy.rs`).
//!
//! With `sampler = "proposal"` there is no occupancy grid: proposals place the samples (`proposal.rs`), for space without end.
//!
//! What differs from the paper, and why: `docs/decisions/0003-ngp-on-a-cpu.md`.

mod account;
#[cfg(test)]
mod budget_tests;
#[cfg(test)]
mod canonical_tests;
mod chunk;
mod config;
mod context;
mod cues;
mod field;
mod fit;
mod head;
mod look;
#[cfg(test)]
mod moving_tests;
mod occupy;
mod points;
mod proposal;
#[cfg(test)]
mod proposal_tests;
mod proposed;
mod relight;
#[cfg(test)]
mod relight_tests;
mod render;
mod state;
mod step;
mod survey;
mod tile;

pub use config::{MixtureKind, NetworkPrecision, NgpConfig, Sampler};
pub use cues::CueConfig;

use crate::deform::{Deform, StillWork};
use crate::method::{Method, Pixel};
use crate::space::{Space, SpaceKind};
use crate::static_scene::survey::Surveys;
use crate::terms::RayTerm;
use account::{Seconds, Skipped};
use chunk::Chunk;
use cues::Cues;
use engine::data::{Batch, Dataset, ErrorMap, Guide};
use engine::options::Background;
use engine::system::{
    Appearance, Fit, Layers, Query, SkipRow, StepStats, System, SystemError, Tensor, TensorMap, Trial,
};
use field::Field;
use occupy::{Moves, Occupy};
use optim::{Adam, AdamConfig, Decay, NonFiniteGuard};
use proposal::Proposals;
use relight::Relighting;
use render_core::budget::Ledger;
use render_core::ray::Ray;
use render_core::ray_distance::{RayDistance, Warp};

/// Chunks of a batch: fixed, so that sums do not depend on the number of threads.
const CHUNKS: usize = 16;

/// Training begins with steps so many times as long, and never makes them longer.
const MAX_STRETCH: f32 = 8.0;
/// Largest change of the steps' length from one batch to the next.
const STRETCH_RATE: f32 = 1.05;

/// Rays of the first batch, before anybody knows how many samples a ray has.
const FIRST_RAYS: usize = 256;

/// The system.
pub struct Ngp {
    name: &'static str,
    config: NgpConfig,
    seed: u64,
    background: Background,
    space: Space,
    /// What whole rays cost.
    terms: Vec<Box<dyn RayTerm>>,
    field: Field,
    occupy: Occupy,
    /// Where samples are placed by proposals.
    proposals: Option<Proposals>,
    /// What else the loss depends on; `None`: the photos show the scene as it is.
    method: Option<Box<dyn Method>>,
    /// Where the photos are explained badly still, where that is asked for.
    errors: Option<ErrorMap>,
    /// Which pixels are drawn, where masks say so.
    guide: Option<Guide>,
    /// Measured depth; `None` where there is none, or nobody asks for it.
    cues: Option<Cues>,
    density_adam: Adam,
    colour_adam: Adam,
    guard: NonFiniteGuard,
    /// Rays of the next batch.
    rays: usize,
    /// Training steps are so many times as long as those of a render, `>= 1`.
    stretch: f32,
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
    relighting: Relighting,
}

/// Normalised distance of a ray: even across a box, half linear and half inverse where space has no end.
fn normalised_distance(space: &Space, near: f32) -> RayDistance {
    let near = f64::from(near);
    let (warp, far) = match space.kind() {
        SpaceKind::Contracted => (Warp::Piecewise, f64::INFINITY),
        // Further than any ray from a camera nearby goes through a box of half side 1.
        SpaceKind::Box | SpaceKind::Ndc => (Warp::Linear, near + 8.0),
    };
    RayDistance::new(warp, near, far).expect("`near` is positive and finite, and checked before")
}

impl Ngp {
    /// A new field for a space.
    ///
    /// # Errors
    /// [`SystemError::Config`] for settings that cannot work.
    pub fn new(config: NgpConfig, space: Space, background: Background, seed: u64) -> Result<Self, SystemError> {
        Self::with_method(config, space, background, seed, None)
    }

    /// A new field that learns what a method says.
    ///
    /// # Errors
    /// As [`Ngp::new`].
    pub fn with_method(
        config: NgpConfig,
        space: Space,
        background: Background,
        seed: u64,
        method: Option<Box<dyn Method>>,
    ) -> Result<Self, SystemError> {
        let name = method.as_ref().map_or("ngp", |method| method.name());
        Self::moving(config, space, background, seed, (name, method, None))
    }

    /// A new field of a scene that moves, under a system's name.
    ///
    /// # Errors
    /// As [`Ngp::new`].
    pub(crate) fn moving(
        config: NgpConfig,
        space: Space,
        background: Background,
        seed: u64,
        (name, method, deform): (&'static str, Option<Box<dyn Method>>, Option<Deform>),
    ) -> Result<Self, SystemError> {
        config.check()?;
        if config.sampler == Sampler::Proposal && deform.is_some() {
            let problem = "a scene that moves needs `occupancy`: proposals know of one moment only";
            return Err(config::bad("sampler", "proposal", problem));
        }
        if config.sampler == Sampler::Proposal && method.as_ref().is_some_and(|m| m.transient().is_some()) {
            let problem = "a transient part needs `occupancy`: proposals know of static matter only";
            return Err(config::bad("sampler", "proposal", problem));
        }
        let codes = method.as_ref().map_or([None; 2], |m| [m.appearance(), m.transient()]);
        let field = Field::new(&config, codes.map(|codes| codes.map(|codes| codes.dims)), deform, seed)?;
        let occupy = Occupy::new(&config)?;
        let networks = AdamConfig { decay: Decay::L2(f64::from(config.weight_decay)), ..AdamConfig::NGP };
        let work = Work {
            inputs: Inputs::default(),
            chunks: (0..CHUNKS).map(|_| Chunk::new(&field)).collect(),
            density_grad: vec![0.0; field.density_params.len()],
            colour_grad: vec![0.0; field.colour_params.len()],
            head_grad: vec![0.0; field.head.as_ref().map_or(0, |head| head.params.len())],
            packed_grad: Vec::new(),
            seen: Vec::new(),
            appearance_bar: Vec::new(),
            transient_bar: Vec::new(),
            still: StillWork::default(),
            relighting: Relighting::default(),
        };
        Ok(Self {
            proposals: (config.sampler == Sampler::Proposal).then(|| Proposals::new(&config, seed)).transpose()?,
            errors: None,
            guide: None,
            cues: None,
            density_adam: Adam::new(field.density_params.len(), networks),
            colour_adam: Adam::new(field.colour_params.len(), networks),
            guard: NonFiniteGuard::default(),
            rays: FIRST_RAYS.min(config.batch_rays),
            stretch: MAX_STRETCH,
            terms: config.terms().terms(normalised_distance(&space, config.near)),
            name,
            config,
            seed,
            background,
            space,
            method,
            field,
            occupy,
            work,
            seconds: Seconds::default(),
            skipped: Skipped::default(),
        })
    }

    /// Cells that no training view sees, or that a view with alpha sees through, are empty for good.
    ///
    /// # Errors
    /// [`SystemError::Scene`] when an image cannot be read.
    pub fn carve(&mut self, data: &Dataset) -> Result<(), SystemError> {
        let scene = if self.field.deform.is_some() { Moves::Yes } else { Moves::No };
        self.occupy.carve(&self.config, &self.space, data, scene)
    }

    /// Part of a ray's light that faint samples are left out with; nothing where something else than the scene learns from
    /// them.
    fn faint(&self) -> f32 {
        if self.proposals.is_none() && self.field.head.is_none() { self.config.train_faint } else { 0.0 }
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
        self.cues = Cues::read(config, &self.space, data)?;
        Ok(self.cues.is_some())
    }

    /// Share of the occupancy grid's cells that are empty for good.
    #[must_use]
    pub fn carved(&self) -> f64 {
        1.0 - self.occupy.grid.visible_cells() as f64 / self.occupy.grid.cells() as f64
    }

    /// Part of a sample's interval that lies in front of it: a march samples where a step begins, proposals in the middle.
    fn lead(&self) -> f32 {
        if self.proposals.is_some() { 0.5 } else { 0.0 }
    }
}

impl System for Ngp {
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
        self.config.rays_per_side
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

    fn look(&self, data: &Dataset, view: usize, stride: u32) -> Result<bool, SystemError> {
        self.look_once(data, view, stride)
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
        let proposals = self.proposals.as_ref().map_or(0, Proposals::parameter_count);
        let head = f.head.as_ref().map_or(0, |head| head.params.len());
        let deform = f.deform.as_ref().map_or(0, Deform::parameter_count);
        let method = self.method.as_ref().map_or(0, |method| method.parameter_count());
        f.features.parameters().len()
            + f.density_params.len()
            + f.colour_params.len()
            + proposals
            + head
            + deform
            + method
    }

    fn memory_bytes(&self) -> usize {
        let chunks: usize = self.work.chunks.iter().chain(self.work.relighting.chunks()).map(Chunk::bytes).sum();
        // Gradient and two moments of each parameter.
        let proposals = self.proposals.as_ref().map_or(0, |p| 4 * p.parameter_count());
        self.field.bytes()
            + proposals
            + 12 * self.parameter_count()
            + chunks
            + self.occupy.bytes()
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
