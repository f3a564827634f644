//! How good a picture is.
//!
//! Order of operations: render, clip to `[0, 1]`, [round to 8 bits](quantise), measure. Average over images first, then
//! over scenes; never pool errors of several images into one PSNR. A PSNR of identical images is `inf` and stays out of
//! means, with a note. Numbers of different [`SsimVariant`]s are not comparable: keep the variant with the number (it
//! prints itself).
//!
//! Everything here but LPIPS computes in `f64`; LPIPS runs its network in `f32` and its distances in `f64`.
//!
//! ```
//! use losses::metrics::{Image, SsimVariant, psnr, quantise, ssim};
//!
//! let truth: Vec<f32> = (0..16 * 16 * 3).map(|i| (i % 7) as f32 / 8.0).collect();
//! let render: Vec<f32> = truth.iter().map(|x| x + 0.1).collect();
//! let (truth, render) = (quantise(&truth), quantise(&render));
//! let (truth, render) = (Image::from_u8(16, 16, 3, &truth)?, Image::from_u8(16, 16, 3, &render)?);
//! assert!((psnr(&render, &truth)? - 20.0).abs() < 0.1);
//! assert!(ssim(&render, &truth, SsimVariant::REFERENCE)? < 1.0);
//! # Ok::<(), losses::metrics::MetricError>(())
//! ```

mod error;
mod image;
pub mod lpips;
mod masked;
mod ms_ssim;
mod psnr;
mod segmentation;
mod ssim;

pub use error::MetricError;
pub use image::{Image, quantise, quantise_value};
pub use lpips::{Lpips, LpipsError};
pub use masked::{MaskedSsim, masked_mse, masked_psnr, masked_ssim};
pub use ms_ssim::{MS_SSIM_MIN_SIDE, MS_SSIM_WEIGHTS, ms_ssim};
pub use psnr::{mse, psnr, psnr_of_mse};
pub use segmentation::{Average, Confusion, EmptyClass, SegmentationScores, segmentation};
pub use ssim::{Border, C1, C2, Clamp, SsimVariant, Window, ssim};
