//! A gradient to a step: Adam (dense and sparse), learning-rate schedules, clipping, and a limit on non-finite gradients.
//!
//! Everything works on plain slices of `f32`, with coefficients in `f64`. Results are the same to the bit at every [`Simd`] level
//! and for any number of threads.
//!
//! | type or module | content |
//! | --- | --- |
//! | [`Adam`], [`AdamConfig`] | the optimiser's state, and three ways to step: [`Adam::step`], [`Adam::step_nonzero`], [`Adam::step_touched`] |
//! | [`LearningRate`] | a [`Schedule`] times a [`Warmup`] |
//! | [`clip`] | clipping by value and by global norm; [`clip::sanitise`] |
//! | [`NonFiniteGuard`] | ends a run in which too many steps had non-finite gradients |
//! | [`Ema`] | moving average of the parameters, for rendering |
//!
//! # Features
//! `std` (default), `libm` (float functions without `std`), `rayon` (parallel over fixed chunks).
//!
//! # Example
//! Minimise `(x - 3)^2`:
//!
//! ```
//! use optim::{Adam, AdamConfig, LearningRate, NonFiniteGuard, Schedule, Simd};
//!
//! let mut x = [0.0_f32];
//! let rate = LearningRate::from(Schedule::LogLerp { lr_init: 0.1, lr_final: 1e-3, steps: 500 });
//! let mut adam = Adam::new(x.len(), AdamConfig::DEFAULT);
//! let mut guard = NonFiniteGuard::default();
//! for step in 0..500 {
//!     let gradient = [2.0 * (x[0] - 3.0)];
//!     let non_finite = adam.step(Simd::best(), rate.at(step), &mut x, &gradient);
//!     guard.record(non_finite)?;
//! }
//! assert!((x[0] - 3.0).abs() < 1e-3);
//! # Ok::<(), optim::TooManyNonFinite>(())
//! ```
#![no_std]
#![forbid(unsafe_code)]
extern crate alloc;
#[cfg(any(feature = "std", test))]
extern crate std;

#[cfg(not(any(feature = "std", feature = "libm")))]
compile_error!("optim needs a float backend: enable `std` or `libm`");

mod adam;
pub mod clip;
mod ema;
mod error;
mod guard;
mod schedule;

pub use adam::{Adam, AdamConfig, BLOCK, Decay, touched_len};
pub use ema::Ema;
pub use error::OptimError;
pub use float_core;
pub use float_core::Simd;
pub use guard::{NonFiniteGuard, TooManyNonFinite};
pub use schedule::{LearningRate, Schedule, Warmup};

/// Length of the pieces that one thread works on: 64 KiB of each array. Fixed, so that results do not depend on the
/// number of threads.
const CHUNK: usize = 16_384;
