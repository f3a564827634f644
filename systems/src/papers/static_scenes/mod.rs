//! Systems for scenes that stand still.

pub mod mip_nerf;
pub mod mip_nerf_360;
pub mod nerf;
pub(crate) mod ngp;
pub(super) mod place;
