//! Systems for scenes that stand still.

pub mod nerf;
pub mod ngp;
