//! Systems for scenes that stand still.

pub mod mip_nerf;
pub mod nerf;
pub mod ngp;
pub mod two_level;
