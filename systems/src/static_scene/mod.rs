//! Systems for scenes that stand still.

mod cones;
pub mod mip_nerf;
pub mod mip_nerf_360;
pub mod nerf;
pub(crate) mod parts;
mod trained;
pub mod two_level;
