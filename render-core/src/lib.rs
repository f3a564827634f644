//! A ray to a pixel: cameras, rays, sampling, quadrature, occupancy, contraction, lighting.
//!
//! Axes, pixel centres, letters and units are those of the repository's `CONVENTIONS.md`: camera-to-world poses with CV
//! axes (x right, y down, z forward), pixel centres at `+ 0.5`, unit ray directions, radians.
#![no_std]
extern crate alloc;
#[cfg(feature = "std")]
extern crate std;

#[cfg(not(any(feature = "std", feature = "libm")))]
compile_error!("render-core needs a float backend: enable `std` or `libm`");

pub mod bilateral;
pub mod bounds;
pub mod budget;
pub mod camera;
pub mod contract;
pub mod coverage;
pub mod error;
pub mod frustum;
pub mod histogram;
pub mod importance;
pub mod lighting;
pub mod ndc;
pub mod occupancy;
pub mod path;
pub mod pose;
pub mod proposal;
pub mod quadrature;
pub mod ray;
pub mod ray_distance;
pub mod real;
pub mod rig;
pub mod sample;
pub mod space_map;
mod symmetric;
