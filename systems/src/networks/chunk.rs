//! What a pass through both levels is given, and the memory of its chunks.

use super::network::Ops;
use super::parts::Part;
use super::ray_bars::RayGeometryBars;
use super::samples::Tile;
use crate::photo_model::{Codes, PhotoModel, Pixel};
use engine::data::Batch;
use field_core::rng::Rng;

/// Pixels to render.
#[derive(Default)]
pub(super) struct Inputs {
    pub(super) batch: Batch,
    /// What is behind the scene, one colour a pixel.
    pub(super) background: Vec<[f32; 3]>,
    /// Colours on that background.
    pub(super) truth: Vec<[f32; 3]>,
}

impl Inputs {
    /// Put the pixels on backgrounds.
    pub(super) fn put_on(&mut self, background: impl Fn(u64) -> [f32; 3]) {
        let Self { batch, background: behind, truth } = self;
        behind.clear();
        behind.extend((0..batch.len() as u64).map(background));
        truth.clear();
        let colours = batch.rgb.iter().zip(&batch.alpha).zip(behind.iter());
        truth.extend(colours.map(|((rgb, a), behind)| [0, 1, 2].map(|c| rgb[c] * a + behind[c] * (1.0 - a))));
    }
}

/// What is done with pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Pass {
    /// They are rendered.
    Render,
    /// They are rendered, and their gradient is taken.
    Learn,
}

/// The tape operations of both levels and of the head.
pub(super) struct TwoLevelOps<'a, P> {
    pub(super) levels: [Ops<'a, P>; 2],
    pub(super) head: Option<Part<'a>>,
}

/// What all chunks of a pass share.
pub(super) struct Context<'a, P> {
    pub(super) ops: &'a TwoLevelOps<'a, P>,
    pub(super) inputs: &'a Inputs,
    /// Randomness of samples and densities; `None`: evenly spaced, and no noise.
    pub(super) random: Option<Rng>,
    /// One over the pixels of the batch that count.
    pub(super) share: f32,
    pub(super) photo_model: Option<&'a dyn PhotoModel>,
    pub(super) appearance: Option<Codes<'a>>,
    pub(super) transient: Option<Codes<'a>>,
    pub(super) pass: Pass,
    /// Whether the gradient goes on to the rays.
    pub(super) by_ray: bool,
}

/// Memory of a chunk, kept from step to step.
#[derive(Default)]
pub(super) struct Chunk {
    pub(super) grad: Vec<f32>,
    pub(super) tile: Tile,
    /// The chunk's pixels as they were rendered; only where a photo model asks.
    pub(super) seen: Vec<Pixel>,
    /// `[pixels][dims]`, gradients of the pixels' codes.
    pub(super) appearance_bar: Vec<f32>,
    pub(super) transient_bar: Vec<f32>,
    pub(super) sums: Sums,
    /// Of the pixels' rays, where they are asked for.
    pub(super) ray_bars: RayGeometryBars,
}

/// What a chunk adds up besides gradients.
#[derive(Clone, Copy, Default)]
pub(super) struct Sums {
    pub(super) loss: f64,
    pub(super) fine_error: f64,
    pub(super) weight: f64,
    pub(super) samples: u64,
    /// Those of them that were not displaced: nothing moves at their time.
    pub(super) still: u64,
    pub(super) missed: u64,
}
