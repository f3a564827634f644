//! Systems of Gaussians: one driver over views, instead of one over rays.
//!
//! * [`Splat`]: 3D Gaussian splatting. [`SplatConfig`]: its settings.
//! * [`frame`]: the frame a cloud is trained in, and the way back to the scene's.
//! * [`start`]: where a cloud begins: at reconstructed points, or anywhere in a box.
//! * [`Cloud`]: Gaussians from a file, to look at.
//!
//! What later systems of Gaussians need is open: whatever has a number for each Gaussian follows `splat_core::density::Rows`, a
//! picture of several clouds is one of their footprints laid one after the other, masks are features of a
//! `splat_core::Raster<K>`, and a loss that shall not lead the density control is left out of what `density` sees.

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
