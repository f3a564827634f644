//! An error becomes a number and a gradient.
//!
//! * [`kernel`]: what one colour channel's error costs, its derivative and its weight: squared, L1, Charbonnier, Huber,
//!   log-squared; the general robust kernel, Cauchy, Geman-McClure, Welsch, Tukey, trimmed.
//! * [`photometric`]: kernels over a batch of rays, weighted, with the backward twin.
//! * [`dssim`]: L1 and structural similarity of a picture, as splats are trained.
//! * [`irls`]: robust fits by iteratively reweighted least squares.
//! * [`trimmed`]: which rays of a batch of patches to learn from, by the size of their errors (RobustNeRF).
//! * [`heuristics`]: masks of what stands still, from feature tracks, errors and segments (HuGS).
//! * [`uncertainty`]: errors under an uncertainty that is learned along (NeRF-W).
//! * [`visibility`], [`codes`]: a learned mask of strangers, and appearance codes that renders agree with (Ha-NeRF).
//! * [`concrete`], [`smoothness`], [`sparsity`]: opacities that decide, without flicker and without excess (SF-NeRF).
//! * [`elastic`], [`background`]: how far a deformation is from rigid, and from leaving alone what stands still (Nerfies).
//! * [`variation`]: neighbours in time and on a lattice should not differ.
//! * [`entropy`], [`point_colour`]: rays that end on something or nothing, samples of their pixel's colour (TiNeuVox).
//! * [`depth`]: measured depth, with its unit or up to a line.
//! * [`distortion`]: how far apart the weights of a ray lie, in linear time.
//! * [`interlevel`]: a proposal's weights have to bound those of the final network.
//! * [`metrics`]: how good a picture is: PSNR, SSIM, MS-SSIM, their masked forms, LPIPS; how good a mask is: IoU and F1.
//!
//! Axes, colour space and letters are those of the workspace's `CONVENTIONS.md`. `no_std` with `alloc`; `libm` instead of
//! `std` for the float functions; `rayon` spreads LPIPS and D-SSIM over threads, with the same bits for any number of them.
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

pub mod background;
pub mod codes;
pub mod concrete;
pub mod depth;
pub mod distortion;
pub mod dssim;
pub mod elastic;
pub mod entropy;
mod error;
pub mod heuristics;
pub mod interlevel;
pub mod irls;
pub mod kernel;
pub mod metrics;
mod order;
pub mod photometric;
pub mod point_colour;
mod ray_intervals;
pub mod smoothness;
pub mod sparsity;
pub mod trimmed;
pub mod uncertainty;
pub mod variation;
pub mod visibility;

pub use error::LossError;
pub use ray_intervals::{Edges, RayIntervals, Reduction};
