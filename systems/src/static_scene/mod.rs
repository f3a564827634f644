//! Systems for scenes that stand still.

pub mod mip_nerf;
pub mod mip_nerf_360;
pub mod nerf;
pub mod ngp;
pub mod two_level;
