//! What steps reuse.

use super::chunk::Chunk;
use crate::photo_model::Pixel;
use crate::warps::StillWork;
use engine::data::Batch;
use render_core::ray::Ray;

/// Chunks of a batch: fixed, so that sums do not depend on the number of threads.
pub(super) const CHUNKS: usize = 16;

/// Pixels to render and all that is random about them.
#[derive(Default)]
pub(super) struct Inputs {
    pub(super) batch: Batch,
    /// `[pixels * rays of a pixel]`
    pub(super) rays: Vec<Ray>,
    pub(super) background: Vec<[f32; 3]>,
    /// Colours on that background.
    pub(super) truth: Vec<[f32; 3]>,
    /// `[1 + proposals][rays]`, jitter of each ray's first sample, `[0, 1)`.
    pub(super) jitter: Vec<f32>,
}

/// What steps reuse.
pub(super) struct Work {
    pub(super) inputs: Inputs,
    pub(super) chunks: Vec<Chunk>,
    pub(super) density_grad: Vec<f32>,
    pub(super) colour_grad: Vec<f32>,
    pub(super) head_grad: Vec<f32>,
    pub(super) moving_grad: Vec<f32>,
    pub(super) packed_grad: Vec<f32>,
    /// All pixels of the batch as they were rendered, and the gradients of their codes; only where a photo model asks.
    pub(super) seen: Vec<Pixel>,
    pub(super) appearance_bar: Vec<f32>,
    pub(super) transient_bar: Vec<f32>,
    /// The background's pull on what moves.
    pub(super) still: StillWork,
    /// Patches that are rendered twice; empty until a photo model asks.
    pub(super) second_renders: SecondRenders,
}

/// Buffers of second renders, kept from step to step.
#[derive(Default)]
pub(super) struct SecondRenders {
    pub(super) inputs: Inputs,
    pub(super) chunks: Vec<Chunk>,
    /// Whether this step has patches.
    pub(super) active: bool,
}

impl SecondRenders {
    /// What this step brings to the colour network's gradient.
    pub(super) fn chunks(&self) -> impl Iterator<Item = &Chunk> {
        self.chunks.iter().filter(|_| self.active)
    }
}
