//! What the tiles of a chunk read, and where their gradients go.

use crate::fields::{MovingBars, MovingPoints};

/// The samples of a chunk, as its tiles read them.
#[derive(Clone, Copy)]
pub(super) struct Marched<'a> {
    /// Rays of the chunk.
    pub(super) rays: usize,
    /// `[rays + 1]`
    pub(super) offsets: &'a [u32],
    /// `[n]`, distances and steps.
    pub(super) t: &'a [f32],
    pub(super) dt: &'a [f32],
    /// `[levels * features][n]`
    pub(super) features: &'a [f32],
    /// Samples of the chunk.
    pub(super) n: usize,
    /// `[sh + appearance][rays]`: what the colour network sees of a ray.
    pub(super) basis: &'a [f32],
    /// `[place + transient code][rays]`
    pub(super) transient: &'a [f32],
    /// Samples at which something moves, where a part of the field is for these.
    pub(super) moving: &'a MovingPoints,
}

/// Where a tile's gradients go.
pub(super) struct Gradients<'a> {
    /// `[levels * features][n]` of the chunk.
    pub(super) features: &'a mut [f32],
    pub(super) density: &'a mut [f32],
    pub(super) colour: &'a mut [f32],
    pub(super) head: &'a mut [f32],
    /// `[rays of the chunk][dims]`, added to.
    pub(super) appearance: &'a mut [f32],
    pub(super) transient: &'a mut [f32],
    pub(super) moving: &'a mut MovingBars,
    /// `[sh][rays of the chunk]`, of what the colour network sees of directions, added to; empty where they are not asked for.
    pub(super) directions: &'a mut [f32],
}
