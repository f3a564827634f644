//! A cloud of Gaussians to an image, and back: 3D Gaussian splatting on the CPU.
//!
//! | part | what it does |
//! | --- | --- |
//! | [`Gaussians`] | raw parameters of a cloud, as they are optimised and stored, row by row |
//! | [`View`] | a pinhole camera: world-to-camera pose, focal lengths, size of the picture |
//! | [`Rules`] | who contributes to a pixel, and how much: near plane, blur, [`Widening`], thresholds |
//! | [`Projection`] | Gaussians to ellipses ([`Footprint`]) and colours; gradients of ellipses to those of raw parameters |
//! | [`Raster`] | ellipses with any `K` features to pixels, front to back; gradients back to ellipses ([`Record`]) |
//! | [`density`] | where a cloud has too few Gaussians, too many, or ones of no use: clone, split, prune, relocate |
//!
//! Whatever composites is a feature: colour, depth, masks. Gradients are those of the picture as it is drawn, with thresholds
//! held where they are; poses and intrinsics have none. A Gaussian with a number that is not finite is not seen. Results are the
//! same bits for any number of threads; levels of SIMD agree to rounding.
//!
//! ```
//! use float_core::Simd;
//! use splat_core::{Gaussians, Projection, Raster, Rules, View};
//!
//! // Half opaque, one unit large: a red one, and a blue one behind it.
//! let mut cloud = Gaussians::new(2, 0)?;
//! cloud.mean.copy_from_slice(&[-0.5, 0.5, 0.0, 0.0, 4.0, 6.0]);
//! cloud.dc.copy_from_slice(&[1.0, -1.0, -1.0, -1.0, -1.0, 1.0]);
//! let r = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
//! let view = View { r, t: [0.0; 3], f: [20.0; 2], c: [16.0; 2], size: [32, 32] };
//! let (simd, rules, degree) = (Simd::best(), Rules::DEFAULT, 0);
//!
//! let mut projection = Projection::default();
//! projection.project(simd, &cloud, &view, &rules, degree)?;
//! let mut raster = Raster::<3>::default();
//! raster.draw(simd, (&projection.footprints, &projection.rgb), view.size, &rules)?;
//! let mut planes = vec![0.0; 4 * 32 * 32]; // red, green, blue, what is left of the light
//! raster.planes(&mut planes)?;
//! let [red, _, blue, light] = [0, 1, 2, 3].map(|plane| planes[plane * 32 * 32 + 16 * 32 + 16]);
//! assert!(red > blue && light < 0.4);
//!
//! // The loss is the mean of red: which way are the Gaussians to go for more?
//! let mut planes_bar = vec![0.0; 4 * 32 * 32];
//! planes_bar[..32 * 32].fill(1.0 / 1024.0);
//! let mut records = Vec::new();
//! raster.backward(simd, (&projection.footprints, &projection.rgb), &rules, &planes_bar, &mut records)?;
//! let mut cloud_bar = Gaussians::new(2, 0)?;
//! projection.backward(simd, &cloud, &view, &rules, degree, (&records, None), &mut cloud_bar)?;
//! // The one in front is to be denser, both redder; green and blue make no difference.
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
mod rules;
mod sh;
mod tiles;
mod view;

pub use error::SplatError;
pub use gaussians::{Field, Gaussians, MAX_DEGREE, SH_0, rest_len};
pub use project::{Footprint, Projection};
pub use raster::{Drawn, Raster, Record};
pub use rules::{Rules, Widening};
pub use tiles::TILE;
pub use view::{MAX_SIDE, View};
