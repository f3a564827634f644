//! From Gaussians in the world to ellipses on the picture, and the chain rule back.

mod backward;
mod block;
mod block_backward;
mod colour;
mod forward;
mod rows;

pub use forward::Projection;

/// What the rasteriser sees of a Gaussian: one cache line.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(64))]
pub struct Footprint {
    /// Centre, pixels.
    pub uv: [f32; 2],
    /// Inverse covariance `[[a, b], [b, c]]` as `a, b, c`, 1 / px².
    pub conic: [f32; 3],
    /// Opacity, less what widening takes.
    pub opacity: f32,
    /// Squared radius (in standard deviations) within which it contributes.
    pub q_max: f32,
    /// Half width and half height of that ellipse, pixels.
    pub half: [f32; 2],
    /// Depth along the optical axis, world units.
    pub z: f32,
    /// Which Gaussian.
    pub index: u32,
}
