//! The coarse and the fine level: their networks, and the memory of a training.

use super::chunk::{Chunk, Inputs, TwoLevelOps};
use super::head::Head;
use super::network::{PackedNetwork, Shapes};
use super::recipe::Recipe;
use super::trained::Trained;
use crate::left_out::LeftOut;
use crate::photo_model::{PhotoModel, Pixel};
use crate::space::Space;
use engine::memory::room_for;
use engine::options::Background;
use engine::system::{Appearance, System, SystemError};
use field_core::rng::Rng;
use field_core::tape::TapeError;
use float_core::Simd;

/// Chunks of a batch: fixed, so that sums do not depend on the number of threads. Each holds a gradient.
pub(super) const CHUNKS: usize = 8;
/// Stream of random numbers.
const INIT: u64 = 0x6e65_7266;

/// A system made by a recipe.
pub struct TwoLevel<R: Recipe> {
    pub(super) config: R,
    pub(super) seed: u64,
    pub(super) background: Background,
    pub(super) space: Space,
    pub(super) shapes: Shapes<R::Position>,
    /// What one photo alone shows; only where a photo model asks.
    pub(super) head: Option<Head>,
    /// What else the loss depends on; `None`: the photos show the scene as it is.
    pub(super) photo_model: Option<Box<dyn PhotoModel>>,
    /// Coarse network, then fine; or one for both. Then the head's.
    pub(super) trained: Trained,
    pub(super) packed: Vec<PackedNetwork>,
    pub(super) inputs: Inputs,
    pub(super) chunks: Vec<Chunk>,
    pub(super) grad: Vec<f32>,
    /// All pixels of the batch as they were rendered; only where a photo model asks.
    pub(super) seen: Vec<Pixel>,
    pub(super) seconds: [f64; 3],
    pub(super) missed: u64,
    pub(super) cast: u64,
    /// Training samples at which nothing moves, and all of them.
    pub(super) still: u64,
    pub(super) placed: u64,
    /// Training pixels that were not rendered.
    pub(super) left_out: LeftOut,
}

impl<R: Recipe> TwoLevel<R> {
    /// New networks for a space.
    ///
    /// # Errors
    /// [`SystemError::Config`] for settings that cannot work.
    pub fn new(config: R, space: Space, background: Background, seed: u64) -> Result<Self, SystemError> {
        Self::with_photo_model(config, space, background, seed, None)
    }

    /// New networks that learn what a photo model says. The colour of both levels sees the photo's appearance code; the transient
    /// part is the fine level's alone.
    ///
    /// # Errors
    /// As [`TwoLevel::new`].
    pub fn with_photo_model(
        config: R,
        space: Space,
        background: Background,
        seed: u64,
        photo_model: Option<Box<dyn PhotoModel>>,
    ) -> Result<Self, SystemError> {
        config.check()?;
        let codes = photo_model.as_ref().map_or([None; 2], |m| [m.appearance(), m.transient()]);
        let [appearance, transient] = codes.map(|codes| codes.map(|codes| codes.dims));
        let shapes = Shapes::new(&config.network()?, appearance.unwrap_or(0))?;
        let n = shapes.param_count();
        let head = transient.map(|dims| Head::new(shapes.width(), dims, n, config.mixture())).transpose()?;
        let count = config.networks();
        let networks = count * n;
        let total = networks + head.as_ref().map_or(0, Head::param_count);
        room_for("width", shapes.width(), total)?;
        let mut params = vec![0.0; total];
        let rng = Rng::new(seed, INIT);
        for (i, params) in params[..networks].chunks_exact_mut(n).enumerate() {
            shapes.init(rng.substream(i as u64), params);
        }
        if let Some(head) = &head {
            head.init(rng.substream(count as u64), &mut params[networks..]);
        }
        let mut system = Self {
            trained: Trained::new(params, R::ADAM),
            inputs: Inputs::default(),
            chunks: (0..CHUNKS).map(|_| Chunk::default()).collect(),
            grad: vec![0.0; total],
            seen: Vec::new(),
            packed: (0..count).map(|_| PackedNetwork::default()).collect(),
            seconds: [0.0; 3],
            missed: 0,
            cast: 0,
            still: 0,
            placed: 0,
            left_out: LeftOut::default(),
            config,
            seed,
            background,
            space,
            shapes,
            head,
            photo_model,
        };
        system.pack();
        Ok(system)
    }

    pub(super) fn pack(&mut self) {
        let n = self.shapes.param_count();
        let (networks, head_params) = self.trained.params.split_at(self.config.networks() * n);
        for (params, packed) in networks.chunks_exact(n).zip(&mut self.packed) {
            self.shapes.pack(params, packed);
        }
        if let Some(head) = &mut self.head {
            head.pack(head_params);
        }
    }

    pub(super) fn ops(&self) -> TwoLevelOps<'_, R::Position> {
        let simd = Simd::best();
        TwoLevelOps {
            levels: [0, 1].map(|level| self.shapes.ops(simd, &self.packed[self.network_of(level)])),
            head: self.head.as_ref().map(|head| head.op(simd)),
        }
    }

    /// The network of a level: its own, or the only one.
    fn network_of(&self, level: usize) -> usize {
        level.min(self.packed.len() - 1)
    }

    /// Where the parameters of a level lie: those of its network, and behind the fine one's those of the head.
    pub(super) fn range(&self, level: usize) -> std::ops::Range<usize> {
        let (n, i) = (self.shapes.param_count(), self.network_of(level));
        i * n..if level == 1 { self.trained.params.len() } else { (i + 1) * n }
    }

    /// Parameters of the coarse (0) or fine (1) level.
    pub(super) fn network(&self, level: usize) -> &[f32] {
        &self.trained.params[self.range(level)]
    }

    /// The code of an appearance; empty for a system without codes.
    pub(super) fn code_of(&self, appearance: &Appearance) -> Vec<f32> {
        self.appearance_code(appearance).unwrap_or_default()
    }
}

/// The tape is built of shapes that fit: an error is a mistake in this file.
pub(super) fn recorded<T>(result: Result<T, TapeError>) -> T {
    result.unwrap_or_else(|e| panic!("the record does not fit: {e}"))
}
