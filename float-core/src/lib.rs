//! Float functions from `std` or `libm`, kernels that are compiled for several SIMD levels, and random numbers: what the math
//! crates build on.
//!
//! | module or type | content |
//! | --- | --- |
//! | [`m32`], [`m64`] | `exp`, `sqrt`, `sin` and others that `core` lacks |
//! | [`Simd`], [`SimdLevel`] | a token: proof that this CPU can run a level (scalar, AVX2 with FMA, AVX-512) |
//! | [`Task`], [`Vector`] | a kernel, written once over a vector type and compiled for each level |
//! | [`vecmath`] | `exp`, `ln`, logistic, softplus, `tanh`, `sin`, `cos` of vectors, with measured errors |
//! | [`Bf16`] | a token for products of bf16 pairs |
//! | [`rng`] | counter-based random numbers: a function of (seed, stream, index), the same in any order |
//!
//! # Features
//! `std` (default), `libm` (functions in pure Rust: the same bits on every platform; where both are on, `libm` wins, so it is a
//! choice for the binary, not for a library in the middle).
//!
//! # Example
//! The sum of a slice at every level of this CPU:
//!
//! ```
//! use float_core::{Simd, Task, Vector};
//!
//! struct Sum<'a>(&'a [f32]);
//! impl Task for Sum<'_> {
//!     type Output = f32;
//!     #[inline(always)]
//!     fn run<V: Vector>(self) -> f32 {
//!         self.0.chunks(V::LANES).fold(V::splat(0.0), |sum, x| sum + V::load_part(x)).sum()
//!     }
//! }
//! for level in Simd::available() {
//!     assert_eq!(level.run(Sum(&[1.0; 35])), 35.0);
//! }
//! ```
#![no_std]
#[cfg(any(feature = "std", test))]
extern crate std;

#[cfg(not(any(feature = "std", feature = "libm")))]
compile_error!("float-core needs a float backend: enable `std` or `libm`");

mod bf16;
mod door;
pub mod rng;
mod setters;
mod simd;
pub mod vecmath;

pub use bf16::Bf16;
pub use door::{m32, m64};
pub use simd::{MAX_LANES, Simd, SimdLevel, Task, Vector};
