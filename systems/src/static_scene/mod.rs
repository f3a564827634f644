//! Systems for scenes that stand still.

mod cones;
mod left_out;
pub mod mip_nerf;
pub mod mip_nerf_360;
pub mod nerf;
pub mod ngp;
pub(crate) mod parts;
pub(crate) mod survey;
mod trained;
pub mod two_level;
