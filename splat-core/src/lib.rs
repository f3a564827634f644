//! A cloud of Gaussians to an image, and back: 3D Gaussian splatting on the CPU.
//!
//! | part | what it does |
//! | --- | --- |
//! | [`Gaussians`] | raw parameters of a cloud, as they are optimised and stored, row by row |
//! | [`View`] | a pinhole camera: world-to-camera pose, focal lengths, size of the picture |
//! | [`RasterSettings`] | near plane, blur, [`Widening`], thresholds of alpha and transmittance |
//! | [`Projection`] | 3D Gaussians to [`ProjectedGaussian`]s and colours, and the backward pass |
//! | [`Raster`] | projected Gaussians with any `K` features to pixels, and the backward pass ([`ProjectedGradient`]) |
//! | [`density`] | density control: clone, split, prune, relocate |
//!
//! Everything that is composited is a feature: colour, depth, masks. Gradients are those of the picture as drawn: which Gaussians
//! contribute to which pixels is held constant. They are with respect to the clouds and, where asked for, to the camera's pose and
//! intrinsics ([`CameraGradient`]). Gaussians with a parameter that is not finite are not drawn. Results are the same bits
//! for any number of threads; SIMD levels agree to rounding.
//!
//! ```
//! use float_core::Simd;
//! use splat_core::{Gaussians, Projection, Raster, RasterSettings, View};
//!
//! // Opacity 1/2, standard deviation 1: a red one, and a blue one behind it.
//! let mut cloud = Gaussians::new(2, 0)?;
//! cloud.mean.copy_from_slice(&[-0.5, 0.5, 0.0, 0.0, 4.0, 6.0]);
//! cloud.dc.copy_from_slice(&[1.0, -1.0, -1.0, -1.0, -1.0, 1.0]);
//! let r = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
//! let view = View { r, t: [0.0; 3], f: [20.0; 2], c: [16.0; 2], size: [32, 32] };
//! let (simd, settings, degree) = (Simd::best(), RasterSettings::DEFAULT, 0);
//!
//! let mut projection = Projection::default();
//! projection.project(simd, &cloud, &view, &settings, degree)?;
//! let mut raster = Raster::<3>::default();
//! raster.draw(simd, &projection.gaussians, &projection.rgb, view.size, &settings)?;
//! let mut planes = vec![0.0; 4 * 32 * 32]; // red, green, blue, transmittance
//! raster.planes(&mut planes)?;
//! let [red, _, blue, transmittance] = [0, 1, 2, 3].map(|plane| planes[plane * 32 * 32 + 16 * 32 + 16]);
//! assert!(red > blue && transmittance < 0.4);
//!
//! // The loss is the mean of red.
//! let mut planes_bar = vec![0.0; 4 * 32 * 32];
//! planes_bar[..32 * 32].fill(1.0 / 1024.0);
//! let mut gradients = Vec::new();
//! raster.backward(simd, &projection.gaussians, &projection.rgb, &settings, &planes_bar, &mut gradients)?;
//! let mut cloud_bar = Gaussians::new(2, 0)?;
//! projection.backward(simd, &cloud, &view, &settings, degree, &gradients, None, &mut cloud_bar)?;
//! // More red: the front one more opaque, both redder; green and blue make no difference.
//! assert!(cloud_bar.logit[0] > 0.0 && cloud_bar.dc[0] > cloud_bar.dc[1] && cloud_bar.dc[1] > 0.0);
//! assert!(cloud_bar.dc[2..].iter().all(|&bar| bar == 0.0));
//! # Ok::<(), splat_core::SplatError>(())
//! ```
//!
//! Axes, pixel centres, letters and units are those of the repository's `CONVENTIONS.md`: CV axes (x right, y down, z forward),
//! pixel centres at `+ 0.5`, quaternions `wxyz`, gradients `x_bar`. Degrees and signs of spherical harmonics are those of 3DGS.
//!
//! Features: `std` (default), `libm` (float functions without `std`), `rayon` (chunks and tiles over threads).
//!
//! # Source
//! Kerbl et al., "3D Gaussian splatting for real-time radiance field rendering", 2023; Yu et al., "Mip-Splatting", 2024, section
//! 4.2 ([`Widening::Dims`]); Kheradmand et al., "3D Gaussian splatting as Markov chain Monte Carlo", 2024 ([`density::Mcmc`]).
#![no_std]
#![forbid(unsafe_code)]
extern crate alloc;
#[cfg(feature = "std")]
extern crate std;

#[cfg(not(any(feature = "std", feature = "libm")))]
compile_error!("splat-core needs a float backend: enable `std` or `libm`");

#[macro_use]
mod each;
#[macro_use]
mod setters;
mod chunks;
pub mod density;
mod error;
mod gaussians;
mod order;
mod project;
mod raster;
mod renderer;
mod settings;
mod sh;
mod tiles;
mod view;

pub use error::SplatError;
pub use gaussians::{Field, Gaussians, MAX_DEGREE, SH_0, rest_len};
pub use project::{CameraGradient, ProjectedGaussian, Projection};
pub use raster::{DrawStats, ProjectedGradient, Raster};
pub use renderer::{Cloud, CloudGradient, GradientOptions, Gradients, Picture, Renderer};
pub use settings::{RasterSettings, Widening};
pub use tiles::TILE;
pub use view::{MAX_SIDE, View};
