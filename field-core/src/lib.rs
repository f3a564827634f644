//! A point in space to density, colour and features: encodings, grids, tiny networks, random numbers. An image to a code:
//! convolutions ([`conv`]).
//!
//! Everything differentiable is a pair of plain functions on slices, `f` and `f_backward`; batches are feature-major,
//! `[feature][sample]`.
#![no_std]
extern crate alloc;
#[cfg(any(feature = "std", test))]
extern crate std;

#[cfg(not(any(feature = "std", feature = "libm")))]
compile_error!("field-core needs a float backend: enable `std` or `libm`");

pub mod conv;
pub mod deform;
pub mod embedding;
pub mod encoding;
mod error;
pub mod init;
pub mod lie;
pub mod mlp;
pub mod stumpff;
pub mod tape;

pub use error::FieldError;
pub use float_core::rng;
