//! An error to a number and a gradient: photometric losses, robust kernels, regularisers of radiance fields, image metrics.
//!
//! **Colour**
//!
//! * [`kernel`]: loss of one channel, derivative and weight: squared, L1, Charbonnier, Huber, log-squared, Barron's general
//!   kernel, Cauchy, Geman-McClure, Welsch, Tukey, trimmed
//! * [`photometric`]: kernels over a batch of rays, weighted
//! * [`dssim`]: L1 and structural similarity of a picture (3D Gaussian splatting)
//!
//! **Along rays**
//!
//! * [`distortion`]: how far apart the weights of a ray lie, in linear time (mip-NeRF 360)
//! * [`interlevel`]: weights of a proposal bound those of the final network (mip-NeRF 360)
//! * [`entropy`]: rays that end on matter or on the background (TiNeuVox), weights that lie in few samples (DynamicNeRF)
//! * [`point_colour`]: samples that have the colour of their pixel (TiNeuVox)
//! * [`depth`]: measured depth: supervised (EndoNeRF, DyCheck), up to scale and shift (MiDaS, NSFF), by medians (MiDaS,
//!   DynamicNeRF, RoDynRF), by correlation (Wild-GS)
//!
//! **Motion**
//!
//! * [`elastic`]: how far a deformation is from rigid (Nerfies)
//! * [`coherence`]: distances between neighbours that a deformation should keep (as rigid as possible)
//! * [`background`]: static points that a deformation must not move (Nerfies)
//! * [`variation`]: differences in time (NSFF, DynamicNeRF, D-NeRF, RoDynRF) and total variation of lattices (K-Planes,
//!   HexPlane, DVGO, TiNeuVox)
//! * [`scene_flow`]: there and back again, steady in time, alike along a ray (NSFF, DynamicNeRF)
//! * [`planes`]: feature planes that are smooth in space and time, planes of time near 1 (K-Planes)
//!
//! **Occluders and appearance**
//!
//! * [`trimmed`]: which rays of a batch of patches are inliers, by the size of their errors (RobustNeRF)
//! * [`heuristics`]: static masks from feature tracks, errors and segments (NeRF-HuGS), superpixels (SLIC)
//! * [`uncertainty`]: errors under a learned uncertainty, sparsity of transient density (NeRF-W)
//! * [`visibility`]: a learned mask of occluders (Ha-NeRF)
//! * [`codes`]: the encoder should find in a render the appearance code that it was made with (Ha-NeRF)
//! * [`concrete`]: nearly binary opacities with a derivative (SF-NeRF)
//! * [`edge_variation`]: depths that change where the photo has an edge (DeGauss)
//! * [`smoothness`]: opacities that change little from pixel to pixel (SF-NeRF)
//! * [`structure`]: two pictures that should not have the same structure (DeGauss)
//! * [`sparsity`]: little density, little opacity of occluders (SF-NeRF)
//!
//! **Gaussians**
//!
//! * [`anisotropy`]: the longest of three sizes over the shortest, above what is allowed (PhysGaussian)
//!
//! **Fits and metrics**
//!
//! * [`irls`]: robust fits by iteratively reweighted least squares
//! * [`metrics`]: PSNR, SSIM, MS-SSIM, their masked forms, LPIPS; IoU and F1 of masks
//!
//! Every module names its source. A function `f` comes with `f_backward`, which adds to gradients. Colours are as in files
//! (display-referred sRGB, expected in `[0, 1]`); letters are `w` for weights and `alpha` for opacity of samples, `trans` for
//! transmittance, `x_bar` for the gradient of the loss with respect to `x`.
//!
//! # Features
//! * `std` (default): float functions of the standard library.
//! * `libm`: those of `libm` instead, for `no_std` with `alloc`. One of the two is needed.
//! * `rayon`: LPIPS and D-SSIM over threads, with the same bits for any number of them.
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
#![forbid(unsafe_code)]
extern crate alloc;
#[cfg(feature = "std")]
extern crate std;

#[cfg(not(any(feature = "std", feature = "libm")))]
compile_error!("losses needs a float backend: enable `std` or `libm`");

pub mod anisotropy;
pub mod background;
pub mod codes;
pub mod coherence;
pub mod concrete;
pub mod depth;
pub mod distortion;
pub mod dssim;
pub mod edge_variation;
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
pub mod planes;
pub mod point_colour;
mod ray_intervals;
pub mod scene_flow;
pub mod smoothness;
pub mod sparsity;
pub mod structure;
pub mod trimmed;
pub mod uncertainty;
pub mod variation;
pub mod visibility;

pub use error::LossError;
pub use float_core;
pub use float_core::Simd;
pub use ray_intervals::{Edges, RayIntervals, Reduction};
