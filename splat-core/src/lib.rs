//! 3D Gaussian splatting on the CPU: a cloud of Gaussians to a picture, and exact gradients back.
//!
//! | group | part | what it is |
//! | --- | --- | --- |
//! | inputs | [`Gaussians`] | raw parameters of a cloud, as they are optimised and stored, row by row |
//! | | [`View`] | a pinhole camera: world-to-camera pose, intrinsics, size of the picture |
//! | | [`RasterSettings`] | near plane, blur, [`Widening`], thresholds of alpha and transmittance |
//! | usual way | [`Renderer`] | draws [`Cloud`]s to a [`Picture`]; [`Gradients`] of each cloud and of the camera, and absolute view-space gradients |
//! | functions | [`Projection`] | 3D Gaussians to [`ProjectedGaussian`]s and colours, and the backward pass |
//! | | [`Raster`] | projected Gaussians with any `K` features to pixels, and the backward pass ([`ProjectedGradient`]) |
//! | | [`CameraGradient`] | the gradient with respect to pose and intrinsics, and its conventions |
//! | | [`SmoothingFilter`], [`Smoothed`] | the smallest size that photos can show (3D filter), and its backward pass |
//! | training | [`density`] | density control: clone, split, prune, relocate; [`density::ViewSpaceGradients`] |
//! | errors | [`SplatError`] | why an input was refused |
//!
//! ```
//! use splat_core::{Cloud, GradientOptions, Gaussians, Gradients, RasterSettings, Renderer, View};
//!
//! // A red Gaussian of standard deviation 1 and opacity 1/2, four units in front of the camera.
//! let mut gaussians = Gaussians::new(1, 0)?;
//! gaussians.mean[2] = 4.0;
//! gaussians.dc[0] = 1.0;
//! let view = View { f: [20.0; 2], c: [16.0; 2], ..View::at_origin([32, 32]) };
//! let mut renderer = Renderer::<3>::new(RasterSettings::DEFAULT);
//! let mut picture = renderer.render(&[Cloud::new(&gaussians)], &view)?;
//! // The gradient of a loss with respect to red, green, blue and transmittance of each pixel: here, of the sum of all.
//! let planes_bar = vec![1.0; picture.planes().len()];
//! let mut gradients = Gradients::default();
//! picture.backward(&planes_bar, GradientOptions::DEFAULT.with_camera(true), &mut gradients)?;
//! assert!(gradients.clouds[0].gaussians.dc[0] > 0.0 && gradients.camera.is_some());
//! # Ok::<(), splat_core::SplatError>(())
//! ```
//!
//! Everything that is composited is a feature: colour, depth, masks. Gradients are those of the picture as drawn: which Gaussians
//! contribute to which pixels counts as constant. Gaussians with a parameter that is not finite are not drawn. Results are the
//! same to the bit for any number of threads; SIMD levels agree up to rounding.
//!
//! Axes are CV (x right, y down, z forward), pixel centres lie at `+ 0.5`, quaternions are `wxyz`, twists have the rotation
//! first; `x_bar` is the gradient of the loss with respect to `x`. Degrees and signs of spherical harmonics are those of 3DGS.
//!
//! Features: `std` (default), `libm` (float functions without `std`), `rayon` (chunks and tiles over threads). [`Simd`]
//! chooses the vector instructions; it and [`rng`] are those of `float-core`.
//!
//! # Source
//! Kerbl et al., "3D Gaussian splatting for real-time radiance field rendering", 2023; Yu et al., "Mip-Splatting", 2024, sections
//! 4.1 ([`SmoothingFilter`]) and 4.2 ([`Widening::Dims`]); Kheradmand et al., "3D Gaussian splatting as Markov chain Monte Carlo", 2024 ([`density::Mcmc`]);
//! Ye et al., "AbsGS", 2024 ([`Raster::backward_absolute`]).
#![no_std]
#![forbid(unsafe_code)]
extern crate alloc;
#[cfg(feature = "std")]
extern crate std;

#[cfg(not(any(feature = "std", feature = "libm")))]
compile_error!("splat-core needs a float backend: enable `std` or `libm`");

#[macro_use]
mod each;
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
mod smoothing;
mod tiles;
mod view;

pub use error::SplatError;
pub use float_core;
pub use float_core::{Simd, rng};
pub use gaussians::{Field, Gaussians, MAX_DEGREE, SH_0, rest_len};
pub use project::{CameraGradient, ProjectedGaussian, ProjectedGradient, Projection};
pub use raster::{DrawStats, Raster};
pub use renderer::{Cloud, CloudGradient, GradientOptions, Gradients, Picture, Renderer};
pub use settings::{RasterSettings, Widening};
pub use smoothing::{Smoothed, SmoothingFilter};
pub use tiles::TILE;
pub use view::{MAX_SIDE, View};

/// The example of the README is compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
