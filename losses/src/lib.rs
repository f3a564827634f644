//! An error becomes a number and a gradient.
//!
//! * [`kernel`]: what one colour channel's error costs, and its derivative: squared, L1, Charbonnier, Huber, log-squared.
//! * [`photometric`]: kernels over a batch of rays, weighted, with the backward twin.
//! * [`distortion`]: how far apart the weights of a ray lie, in linear time.
//! * [`interlevel`]: a proposal's weights have to bound those of the final network.
//! * [`metrics`]: how good a picture is: PSNR, SSIM, MS-SSIM, their masked forms, LPIPS.
//!
//! Axes, colour space and letters are those of the workspace's `CONVENTIONS.md`. `no_std` with `alloc`; `libm` instead of
//! `std` for the float functions; `rayon` spreads LPIPS over threads, with the same bits for any number of them.
//!
//! ```
//! use losses::{kernel::Kernel, photometric};
//!
//! let (prediction, target) = ([[0.5, 0.5, 0.5]], [[0.2, 0.5, 0.5]]);
//! let loss = photometric::mean(Kernel::Squared, &prediction, &target, None)?;
//! assert!((loss - 0.09 / 3.0).abs() < 1e-7);
//!
//! let mut prediction_bar = [[0.0; 3]];
//! photometric::mean_backward(Kernel::Squared, &prediction, &target, None, 1.0, &mut prediction_bar)?;
//! assert!((prediction_bar[0][0] - 2.0 * 0.3 / 3.0).abs() < 1e-7);
//! # Ok::<(), losses::LossError>(())
//! ```
#![no_std]
extern crate alloc;
#[cfg(feature = "std")]
extern crate std;

#[cfg(not(any(feature = "std", feature = "libm")))]
compile_error!("losses needs a float backend: enable `std` or `libm`");

pub mod distortion;
mod error;
pub mod interlevel;
pub mod kernel;
pub mod metrics;
pub mod photometric;
mod ray_intervals;

pub use error::LossError;
pub use ray_intervals::{Edges, RayIntervals, Reduction};
