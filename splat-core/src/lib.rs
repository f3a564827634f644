//! A cloud of Gaussians to an image, and back.
#![no_std]
extern crate alloc;
#[cfg(feature = "std")]
extern crate std;

#[cfg(not(any(feature = "std", feature = "libm")))]
compile_error!("splat-core needs a float backend: enable `std` or `libm`");

mod chunks;
pub mod density;
mod error;
mod gaussians;
mod order;
mod project;
mod raster;
mod rules;
mod sh;
mod tiles;
mod view;

pub use error::SplatError;
pub use gaussians::{Field, Gaussians, MAX_DEGREE, SH_0, rest_len};
pub use project::{Footprint, Projection};
pub use raster::{Drawn, Raster, Record};
pub use rules::{Rules, Widening};
pub use tiles::TILE;
pub use view::{MAX_SIDE, View};
