//! Systems of Gaussians: one driver over views, instead of one over rays.
//!
//! * [`Splat`]: 3D Gaussian splatting. [`SplatConfig`]: its settings.
//! * [`frame`]: the frame a cloud is trained in, and the way back to the scene's.
//! * [`start`]: where a cloud begins: at reconstructed points, or anywhere in a box.
//! * [`Cloud`]: Gaussians from a file, to look at.
//!
//! What later systems of Gaussians need is there: whatever has a value for each Gaussian follows `splat_core::density::Rows`,
//! `splat_core::Renderer` draws several clouds on one picture, with masks and codes as features, and a loss that must not lead the density
//! control is left out of the gradients that `density` is given.

mod cloud;
mod config;
mod density;
mod empty;
mod flat;
pub mod frame;
mod look;
mod memory;
mod optimiser;
mod photo;
mod plan;
pub(crate) mod refine;
mod sight;
mod splat;
pub mod start;
mod state;
mod step;
mod upright;

pub use cloud::Cloud;
pub use config::SplatConfig;
pub(crate) use plan::{CLAIM, build};
pub use splat::Splat;
