//! The floor the math crates stand on: one door to float functions, one SIMD token, one generator of
//! random numbers.
//!
//! * [`m32`] and [`m64`]: `exp`, `sqrt`, `sin` … from `std` or, with the feature `libm`, from the pure Rust `libm`.
//!   `libm` wins where both are on: then every platform gives the same bits. That makes it a choice for the binary,
//!   never for a library in the middle.
//! * [`Simd`]: proof that this CPU can run a vector level. Kernels are written once, over [`Vector`], and compiled for
//!   each level (scalar, AVX2 with FMA, AVX-512).
//! * [`rng`]: counter-based random numbers, the same in any order and on any number of threads.
//!
//! ```
//! use float_core::{Simd, Task, Vector};
//!
//! struct Sum<'a>(&'a [f32]);
//! impl Task for Sum<'_> {
//!     type Output = f32;
//!     #[inline(always)]
//!     fn run<V: Vector>(self) -> f32 {
//!         let mut acc = V::splat(0.0);
//!         let (body, tail) = self.0.split_at(self.0.len() / V::LANES * V::LANES);
//!         for x in body.chunks_exact(V::LANES) {
//!             acc = acc + V::load(x);
//!         }
//!         acc.sum() + tail.iter().sum::<f32>()
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
mod simd;
pub mod vecmath;

pub use bf16::Bf16;
pub use door::{m32, m64};
pub use simd::{MAX_LANES, Simd, SimdLevel, Task, Vector};
