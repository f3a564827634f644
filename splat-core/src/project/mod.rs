//! Projection: 3D Gaussians to 2D Gaussians on the picture, and its backward pass.

mod backward;
mod block;
mod block_backward;
mod camera;
mod colour;
mod forward;
mod gradient;
mod rows;

pub use camera::CameraGradient;
pub use forward::Projection;
pub use gradient::ProjectedGradient;
pub(crate) use rows::lanes;

/// A Gaussian projected onto the picture: 48 bytes in one cache line.
///
/// # Source
/// Zwicker et al., "EWA splatting", 2002; Kerbl et al., "3D Gaussian splatting", 2023, section 4.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(64))]
pub struct ProjectedGaussian {
    /// Centre `u, v`, pixels.
    pub uv: [f32; 2],
    /// Inverse of the 2D covariance (blur included), `[[a, b], [b, c]]` as `a, b, c`, 1 / px².
    pub conic: [f32; 3],
    /// Opacity, reduced by the blur where [`Widening`](crate::Widening) says so.
    pub opacity: f32,
    /// It contributes where the squared Mahalanobis distance is below this.
    pub q_max: f32,
    /// Half width and half height of that region, pixels.
    pub half: [f32; 2],
    /// Depth along the optical axis, world units.
    pub z: f32,
    /// Index of the Gaussian in its cloud.
    pub index: u32,
}
