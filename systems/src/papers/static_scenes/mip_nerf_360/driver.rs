//! The networks of a scene, and the memory of a training.

use super::config::MipNerf360Config;
use super::level::Level;
use super::network::{Ops, PackedNetworks, Shapes};
use crate::networks::Trained;
use crate::space::Space;
use engine::data::Batch;
use engine::memory::room_for;
use engine::options::Background;
use engine::system::SystemError;
use field_core::rng::Rng;
use float_core::Simd;
use losses::interlevel;
use optim::AdamConfig;
use render_core::proposal::Resampler;

/// Chunks of a batch: fixed, so that sums do not depend on the number of threads. Each holds a gradient.
pub(super) const CHUNKS: usize = 4;
/// Streams of random numbers.
const INIT: u64 = 0x6d33_3630;
pub(super) const SAMPLES: u64 = 0x7361_6d70;
pub(super) const BACKGROUND: u64 = 0x6261_636b;
/// Adam of the paper.
const ADAM: AdamConfig = AdamConfig::DEFAULT.with_eps(1e-6);

/// The system.
pub struct MipNerf360 {
    pub(super) config: MipNerf360Config,
    pub(super) seed: u64,
    pub(super) background: Background,
    pub(super) space: Space,
    pub(super) shapes: Shapes,
    /// Proposal network, then the final one.
    pub(super) trained: Trained,
    pub(super) packed: PackedNetworks,
    pub(super) batch: Batch,
    pub(super) chunks: Vec<Chunk>,
    pub(super) grad: Vec<f32>,
    pub(super) seconds: [f64; 3],
    pub(super) missed: u64,
    pub(super) cast: u64,
}

/// Memory of a tile.
#[derive(Default)]
pub(super) struct Tile {
    /// Of the proposal rounds, then of the final one.
    pub(super) levels: Vec<Level>,
    pub(super) resampler: Resampler,
    pub(super) interlevel: interlevel::Scratch,
    pub(super) background: Vec<f32>,
}

/// Memory of a chunk, kept from step to step.
#[derive(Default)]
pub(super) struct Chunk {
    pub(super) grad: Vec<f32>,
    pub(super) tile: Tile,
    pub(super) sums: Sums,
}

/// What a chunk adds up besides gradients.
#[derive(Clone, Copy, Default)]
pub(super) struct Sums {
    pub(super) loss: f64,
    pub(super) squared_error: f64,
    pub(super) samples: u64,
    pub(super) missed: u64,
}

impl MipNerf360 {
    /// New networks for a space.
    ///
    /// # Errors
    /// [`SystemError::Config`] for settings that cannot work.
    pub fn new(config: MipNerf360Config, space: Space, background: Background, seed: u64) -> Result<Self, SystemError> {
        config.check()?;
        let shapes = Shapes::new(&config.networks)?;
        let n = shapes.param_count();
        room_for("width", config.networks.width, n)?;
        let mut params = vec![0.0; n];
        shapes.init(Rng::new(seed, INIT), &mut params);
        let mut system = Self {
            trained: Trained::new(params, ADAM),
            batch: Batch::default(),
            chunks: (0..CHUNKS).map(|_| Chunk::default()).collect(),
            grad: vec![0.0; n],
            packed: PackedNetworks::default(),
            seconds: [0.0; 3],
            missed: 0,
            cast: 0,
            config,
            seed,
            background,
            space,
            shapes,
        };
        system.pack();
        Ok(system)
    }

    pub(super) fn pack(&mut self) {
        self.shapes.pack(&self.trained.params, &mut self.packed);
    }

    pub(super) fn ops(&self) -> Ops<'_> {
        self.shapes.ops(Simd::best(), &self.packed)
    }
}

/// Lengths are cut to fit: an error is a mistake in this module.
pub(super) fn fits<T, E: std::fmt::Display>(result: Result<T, E>) -> T {
    result.unwrap_or_else(|e| panic!("mip-nerf-360: the record does not fit: {e}"))
}
