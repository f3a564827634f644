//! A batch on its way through a network: the buffers of either pass, for the kernels on f32 and for those on pairs of bf16.

use super::{Mlp, Packed};
use float_core::Simd;

/// The forward pass of a batch.
pub(super) struct Forward<'a> {
    pub(super) mlp: &'a Mlp,
    pub(super) simd: Simd,
    pub(super) packed: &'a Packed,
    pub(super) x: &'a [f32],
    pub(super) x_stride: usize,
    pub(super) n: usize,
    pub(super) y: &'a mut [f32],
    pub(super) y_stride: usize,
    pub(super) acts: &'a mut [f32],
    /// From one panel's activations to the next: 0 to use the same ones over again.
    pub(super) acts_step: usize,
    /// The last layer's output panel, before it is turned: the same for all panels.
    pub(super) last: &'a mut [f32],
}

/// The backward pass of a batch.
pub(super) struct Backward<'a> {
    pub(super) mlp: &'a Mlp,
    pub(super) simd: Simd,
    pub(super) packed: &'a Packed,
    pub(super) acts: &'a [f32],
    pub(super) y_bar: &'a [f32],
    pub(super) y_stride: usize,
    pub(super) n: usize,
    pub(super) x_bar: Option<(&'a mut [f32], usize)>,
    pub(super) grad: &'a mut [f32],
    pub(super) scratch: &'a mut [f32],
}
