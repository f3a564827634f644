//! The driver of networks as published, which look twice along each ray: coarsely everywhere, then finely where the first look saw something.
//!
//! Networks of one form, the quadrature on the tape, batches, the optimiser, renders,
//! checkpoints. What tells them apart is a [`Recipe`]: where to sample, what the position encoding sees, the density's
//! activation, losses and rates. Gradients stop at the samples' positions.

mod composite;
mod composite_two;
pub(crate) mod cones;
mod fit;
mod head;
mod network;
pub(crate) mod parts;
mod recipe;
mod render;
mod samples;
mod step;
mod survey;
mod trained;

pub use network::NetworkConfig;
pub(crate) use network::refuse;
pub use recipe::Recipe;
pub(crate) use samples::ray_random;
pub use samples::{Level, Tile};

use crate::left_out::LeftOut;
use crate::method::{Method, Pixel};
use crate::space::Space;
use crate::survey::Surveys;
pub use cones::Footprint;
use engine::canonical::add_canonical;
use engine::data::Dataset;
use engine::memory::room_for;
use engine::options::Background;
use engine::system::{Appearance, Fit, Layers, Query, SkipRow, StepStats, System, SystemError, Tensor, TensorMap};
use field_core::rng::Rng;
use field_core::tape::TapeError;
use float_core::Simd;
use head::Head;
use network::{Ops, PackedNetwork, Shapes};
use parts::Part;
use render_core::ray::Ray;
use step::{Chunk, Inputs};
pub(crate) use trained::Trained;

/// Chunks of a batch: fixed, so that sums do not depend on the number of threads. Each holds a gradient.
const CHUNKS: usize = 8;
/// Stream of random numbers.
const INIT: u64 = 0x6e65_7266;

/// A system made by a recipe.
pub struct TwoLevel<R: Recipe> {
    config: R,
    seed: u64,
    background: Background,
    space: Space,
    shapes: Shapes<R::Position>,
    /// What one photo alone shows; only where a method asks.
    head: Option<Head>,
    /// What else the loss depends on; `None`: the photos show the scene as it is.
    method: Option<Box<dyn Method>>,
    /// Coarse network, then fine; or one for both. Then the head's.
    trained: Trained,
    packed: Vec<PackedNetwork>,
    inputs: Inputs,
    chunks: Vec<Chunk>,
    grad: Vec<f32>,
    /// All pixels of the batch as they were rendered; only where a method asks.
    seen: Vec<Pixel>,
    seconds: [f64; 3],
    missed: u64,
    cast: u64,
    /// Training pixels that were not rendered.
    left_out: LeftOut,
}

/// The tape operations of both levels and of the head.
struct TwoLevelOps<'a, P> {
    levels: [Ops<'a, P>; 2],
    head: Option<Part<'a>>,
}

impl<R: Recipe> TwoLevel<R> {
    /// New networks for a space.
    ///
    /// # Errors
    /// [`SystemError::Config`] for settings that cannot work.
    pub fn new(config: R, space: Space, background: Background, seed: u64) -> Result<Self, SystemError> {
        Self::with_method(config, space, background, seed, None)
    }

    /// New networks that learn what a method says. The colour of both levels sees the photo's appearance code; the transient
    /// part is the fine level's alone.
    ///
    /// # Errors
    /// As [`TwoLevel::new`].
    pub fn with_method(
        config: R,
        space: Space,
        background: Background,
        seed: u64,
        method: Option<Box<dyn Method>>,
    ) -> Result<Self, SystemError> {
        config.check()?;
        let codes = method.as_ref().map_or([None; 2], |m| [m.appearance(), m.transient()]);
        let [appearance, transient] = codes.map(|codes| codes.map(|codes| codes.dims));
        let shapes = Shapes::new(&config.network()?, appearance.unwrap_or(0))?;
        let n = shapes.param_count();
        let head = transient.map(|dims| Head::new(shapes.width(), dims, n, config.mixture())).transpose()?;
        let networks = R::NETWORKS * n;
        let total = networks + head.as_ref().map_or(0, Head::param_count);
        room_for("width", shapes.width(), total)?;
        let mut params = vec![0.0; total];
        let rng = Rng::new(seed, INIT);
        for (i, params) in params[..networks].chunks_exact_mut(n).enumerate() {
            shapes.init(rng.substream(i as u64), params);
        }
        if let Some(head) = &head {
            head.init(rng.substream(R::NETWORKS as u64), &mut params[networks..]);
        }
        let mut system = Self {
            trained: Trained::new(params, R::ADAM),
            inputs: Inputs::default(),
            chunks: (0..CHUNKS).map(|_| Chunk::default()).collect(),
            grad: vec![0.0; total],
            seen: Vec::new(),
            packed: (0..R::NETWORKS).map(|_| PackedNetwork::default()).collect(),
            seconds: [0.0; 3],
            missed: 0,
            cast: 0,
            left_out: LeftOut::default(),
            config,
            seed,
            background,
            space,
            shapes,
            head,
            method,
        };
        system.pack();
        Ok(system)
    }

    fn pack(&mut self) {
        let n = self.shapes.param_count();
        let (networks, head_params) = self.trained.params.split_at(R::NETWORKS * n);
        for (params, packed) in networks.chunks_exact(n).zip(&mut self.packed) {
            self.shapes.pack(params, packed);
        }
        if let Some(head) = &mut self.head {
            head.pack(head_params);
        }
    }

    fn ops(&self) -> TwoLevelOps<'_, R::Position> {
        let simd = Simd::best();
        TwoLevelOps {
            levels: [0, 1].map(|level| self.shapes.ops(simd, &self.packed[network_of::<R>(level)])),
            head: self.head.as_ref().map(|head| head.op(simd)),
        }
    }

    /// Where the parameters of a level lie: those of its network, and behind the fine one's those of the head.
    fn range(&self, level: usize) -> std::ops::Range<usize> {
        let (n, i) = (self.shapes.param_count(), network_of::<R>(level));
        i * n..if level == 1 { self.trained.params.len() } else { (i + 1) * n }
    }

    /// Parameters of the coarse (0) or fine (1) level.
    fn network(&self, level: usize) -> &[f32] {
        &self.trained.params[self.range(level)]
    }

    /// The code of an appearance; empty for a system that knows one light only.
    fn code_of(&self, appearance: &Appearance) -> Vec<f32> {
        self.appearance_code(appearance).unwrap_or_default()
    }
}

/// The network of a level: its own, or the only one.
fn network_of<R: Recipe>(level: usize) -> usize {
    level.min(R::NETWORKS - 1)
}

/// The tape is built of shapes that fit: an error is a mistake in this file.
fn recorded<T>(result: Result<T, TapeError>) -> T {
    result.unwrap_or_else(|e| panic!("the record does not fit: {e}"))
}

impl<R: Recipe> System for TwoLevel<R> {
    fn name(&self) -> &'static str {
        self.method.as_ref().map_or(R::NAME, |method| method.name())
    }

    fn step(&mut self, data: &Dataset, step: u64) -> Result<StepStats, SystemError> {
        self.train_step(data, step)
    }

    fn render(&self, rays: &[Ray], query: &Query) -> Layers {
        self.render_cones(rays, &vec![0.0; rays.len()], query)
    }

    fn render_cones(&self, rays: &[Ray], radii: &[f32], query: &Query) -> Layers {
        let ops = self.ops();
        let code = self.code_of(&query.appearance);
        let into = |cones: (&[Ray], &[f32]), tile: &mut _, out: &mut Layers| {
            self.render_into(&ops, cones, query, &code, tile, out);
        };
        let mut layers = cones::render_tiles(rays, radii, query, into);
        add_canonical(self, rays, query, &mut layers);
        layers
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

    fn density(&self, points: &[[f64; 3]], _time: f64, out: &mut [f32]) {
        let d = vec![[0.0, 0.0, 1.0]; points.len()];
        self.evaluate(points, &d, |i, sigma, _| out[i] = sigma);
    }

    fn colour(&self, points: &[[f64; 3]], d: &[[f32; 3]], _time: f64, out: &mut [[f32; 3]]) {
        self.evaluate(points, d, |i, _, rgb| out[i] = rgb);
    }

    fn first_sample(&self, ray: &Ray) -> f64 {
        self.space.world_distance(ray, self.space.internal_ray(ray).start)
    }

    fn bounds(&self) -> [[f64; 3]; 2] {
        self.space.world_bounds()
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        let mut state = self.trained.state();
        state.extend(self.method.iter().flat_map(|method| method.state()));
        state
    }

    fn load_state(&mut self, tensors: &TensorMap) -> Result<(), SystemError> {
        let trained = self.trained.restored(tensors)?;
        if let Some(method) = &mut self.method {
            method.load_state(tensors)?;
        }
        self.trained = trained;
        self.pack();
        Ok(())
    }

    fn parameter_count(&self) -> usize {
        self.trained.params.len() + self.method.as_ref().map_or(0, |method| method.parameter_count())
    }

    fn memory_bytes(&self) -> usize {
        let arenas: usize =
            self.chunks.iter().map(|c| c.tile.coarse.arena.memory_bytes() + c.tile.fine.arena.memory_bytes()).sum();
        // Parameters, packed copies, gradient, two moments; a gradient a chunk.
        let networks = 4 * self.trained.params.len() * (6 + CHUNKS);
        networks + arenas + self.method.as_ref().map_or(0, |method| method.memory_bytes())
    }

    fn skips(&self) -> Vec<SkipRow> {
        // A ray that a method leaves out is one of those not looked at, too: it is counted once.
        let mut rows = vec![cones::missed_row(self.missed - self.left_out.occluders(), self.cast)];
        rows.extend(self.left_out.occluders_row());
        rows
    }

    fn timings(&self) -> Vec<(&'static str, f64)> {
        vec![("draw rays", self.seconds[0]), ("networks", self.seconds[1]), ("gradient fold and Adam", self.seconds[2])]
    }
}
