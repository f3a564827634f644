//! A point in space to density, colour and features: encodings, feature grids, small networks and reverse-mode differentiation.
//!
//! Everything differentiable is a pair of plain functions on slices, `f` and `f_backward`; the backward function **adds** to
//! gradients. Batches are feature-major, `[feature][sample]`. Functions that vectorise take the [`Simd`] level to run at, and
//! allocate nothing: buffers come from the caller.
//!
//! | module | content |
//! | --- | --- |
//! | [`encoding`] | positions and directions to features: frequencies, Gaussians, spherical harmonics, hash grid, dense grid, voxels at several distances, planes |
//! | [`mlp`] | multilayer perceptrons: [`Network`](mlp::Network) owns its parameters, [`Mlp`](mlp::Mlp) works on slices |
//! | [`conv`] | convolutions and pooling; an encoder of images |
//! | [`embedding`] | a learned vector for each image, camera or time |
//! | [`tape`] | reverse-mode differentiation over matrices, with tangents: Jacobians and second-order gradients |
//! | [`deform`] | translations and rigid motions of points, on the tape and without |
//! | [`lie`], [`stumpff`] | exponential maps of SO(3) and SE(3), and the functions behind them, in `f64` |
//! | [`init`], [`rng`] | initial parameters; random numbers as a function of (seed, stream, index) |
//!
//! # Features
//! `std` (default), `libm` (float functions without `std`, the same bits on every platform), `rayon` (hash grid over the current
//! thread pool; the same bits for any number of threads).
//!
//! # Example
//! Densities of two points from a hash grid and a small network, and the gradients of both:
//!
//! ```
//! use field_core::Simd;
//! use field_core::encoding::hash_grid::{HashGrid, HashGridConfig};
//! use field_core::mlp::{MlpConfig, Network};
//!
//! let grid = HashGrid::new(HashGridConfig::default().with_log2_table(14))?;
//! let mut network = Network::new(&MlpConfig::new(grid.out_rows(), vec![64], 1), 0)?;
//! let (table, x) = (vec![0.1; grid.params_len()], [0.1, 0.6, 0.2, 0.7, 0.3, 0.8]);
//! let (mut features, mut sigma) = (vec![0.0; 2 * grid.out_rows()], [0.0; 2]);
//! grid.encode(Simd::best(), &table, &x, &mut features)?;
//! network.forward(&features, &mut sigma)?;
//!
//! let (mut features_bar, mut table_bar) = (vec![0.0; features.len()], vec![0.0; table.len()]);
//! network.backward(&[1.0, 0.5], Some(&mut features_bar))?;
//! grid.encode_backward(Simd::best(), &x, &features_bar, &mut table_bar, None)?;
//! assert!(network.gradient().iter().chain(&table_bar).any(|g| *g != 0.0));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![no_std]
extern crate alloc;
#[cfg(any(feature = "std", test))]
extern crate std;

#[cfg(not(any(feature = "std", feature = "libm")))]
compile_error!("field-core needs a float backend: enable `std` or `libm`");

pub mod conv;
pub mod deform;
pub mod embedding;
pub mod encoding;
mod error;
pub mod init;
pub mod lie;
pub mod mlp;
pub mod stumpff;
pub mod tape;

pub use error::FieldError;
pub use float_core;
pub use float_core::Simd;
pub use float_core::rng;
