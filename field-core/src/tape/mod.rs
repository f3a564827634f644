//! Reverse-mode automatic differentiation over matrices `[features x samples]`, with tangents.
//!
//! A [`Tape`] records coarse operations as they are computed: a linear layer, an activation, an encoding, a whole network.
//! [`Tape::backward`] walks the record back. [`Tape::jvp`] records *tangents* (directional derivatives) as ordinary tape
//! operations, so that reverse mode through them gives exact second-order gradients: of a loss on normals
//! `d sigma / dx`, or on the Jacobian of a deformation.
//!
//! Everything lies feature-major (a row is one feature of all samples) in one [`Arena`], which a tape borrows for one tile
//! of samples and the next tape borrows again: after the first tile of a shape nothing is allocated. Parameters are not
//! copied: leaves look into the caller's flat parameter vector, and their gradients are added to a flat buffer of the same
//! length.
//!
//! # A radiance field
//! A tiny NeRF: encoded position to density and features, features and direction to colour; the loss is on colour, density
//! and the length of the density's gradient.
//!
//! ```
//! use field_core::tape::{Arena, Node, Tape, TapeError};
//!
//! /// `w x + b` with the parameters from `at` on: weights `[out][in]`, then biases `[out]`.
//! fn dense(tape: &mut Tape, at: &mut usize, x: Node, out: usize) -> Result<Node, TapeError> {
//!     let rows = tape.shape(x)?.rows;
//!     let w = tape.param(*at, out, rows)?;
//!     let b = tape.param(*at + out * rows, out, 1)?;
//!     *at += out * (rows + 1);
//!     tape.linear(w, Some(b), x)
//! }
//!
//! /// Octaves of sines and cosines.
//! fn encode(tape: &mut Tape, x: Node) -> Result<Node, TapeError> {
//!     let mut parts = vec![x];
//!     for octave in 0..4 {
//!         let scaled = tape.scale(x, f32::from(1_u16 << octave))?;
//!         parts.push(tape.sin(scaled)?);
//!         parts.push(tape.cos(scaled)?);
//!     }
//!     tape.concat(&parts)
//! }
//!
//! let params: Vec<f32> = (0..2500).map(|i| ((i * 7919 % 1000) as f32 / 1000.0 - 0.5) * 0.4).collect();
//! let mut grad = vec![0.0; params.len()];
//! let mut arena = Arena::new();
//! let samples = 5;
//! let (points, directions, truth) = (vec![0.3; 3 * samples], vec![0.577; 3 * samples], vec![0.5; 3 * samples]);
//!
//! for _tile in 0..2 {
//!     let mut tape = Tape::new(&mut arena, &params);
//!     let x = tape.input(3, samples, &points)?;
//!     let d = tape.constant(3, samples, &directions)?;
//!     let at = &mut 0;
//!
//!     let features = encode(&mut tape, x)?;
//!     let hidden = dense(&mut tape, at, features, 32)?;
//!     let hidden = tape.softplus(hidden, 0.0)?;
//!     let raw = dense(&mut tape, at, hidden, 1)?;
//!     let sigma = tape.softplus(raw, -1.0)?;
//!     let directions = encode(&mut tape, d)?;
//!     let colour = tape.concat(&[hidden, directions])?;
//!     let colour = dense(&mut tape, at, colour, 3)?;
//!     let rgb = tape.logistic(colour)?;
//!
//!     // d sigma / dx, three rows, as part of the same record.
//!     let normal = tape.jacobian(sigma, x)?;
//!
//!     let truth = tape.constant(3, samples, &truth)?;
//!     let error = tape.sub(rgb, truth)?;
//!     let error = tape.dot(error, error)?;
//!     let steepness = tape.dot(normal, normal)?;
//!     let steepness = tape.scale(steepness, 0.1)?;
//!     let loss = tape.add(error, steepness)?;
//!     let loss = tape.mean_samples(loss)?;
//!     tape.backward_from(loss, &mut grad)?;
//!     assert_eq!(tape.gradient(x)?.len(), 3 * samples);
//! }
//! assert!(grad.iter().any(|&g| g != 0.0) && grad.iter().all(|g| g.is_finite()));
//! # Ok::<(), TapeError>(())
//! ```
//!
//! # Function pairs
//! Whole pairs enter through [`CustomOp`]; the tape borrows the operation, which is why it is declared before the tape.
//! Ready-made: [`EncodingOp`] for the encodings of this crate, [`MlpOp`] for a fused network ([`layers`] records one layer
//! by layer). The same field with them:
//!
//! ```
//! use field_core::encoding::frequency::{Base, Frequency, Identity};
//! use field_core::mlp::{Activation, Mlp, MlpConfig, Packed};
//! use field_core::tape::{Arena, EncodingOp, MlpOp, Tape, TapeError};
//! use float_core::Simd;
//!
//! let simd = Simd::best();
//! let encoding = EncodingOp::new(Frequency::new(3, 4, Base::One, Identity::Include)?, simd);
//! let config = MlpConfig::new(27, vec![32, 32], 4).with_hidden_activation(Activation::SOFTPLUS);
//! let mlp = Mlp::new(&config).unwrap();
//! let params: Vec<f32> = (0..mlp.param_count()).map(|i| ((i * 7919 % 1000) as f32 / 1000.0 - 0.5) * 0.4).collect();
//! let mut packed = Packed::default();
//! mlp.pack(&params, &mut packed);
//! let network = MlpOp { mlp: &mlp, packed: &packed, simd };
//!
//! let mut arena = Arena::new();
//! let mut grad = vec![0.0; params.len()];
//! let mut tape = Tape::new(&mut arena, &params);
//! let x = tape.input(3, 2, &[0.1, 0.2, 0.3, 0.4, 0.5, 0.6])?;
//! let weights = tape.param(0, params.len(), 1)?;
//! let features = tape.custom(&encoding, &[x])?;
//! let raw = tape.custom(&network, &[features, weights])?;
//! let (sigma, rgb) = (tape.slice(raw, 0..1)?, tape.slice(raw, 1..4)?);
//! let (sigma, rgb) = (tape.trunc_exp(sigma)?, tape.logistic(rgb)?);
//! let normal = tape.jacobian(sigma, x)?;
//! tape.backward(&[(rgb, &[1.0; 6]), (normal, &[0.1; 6])], &mut grad)?;
//! assert_eq!(tape.gradient(x)?.len(), 6);
//! # Ok::<(), TapeError>(())
//! ```
//!
//! # Numerics
//! `exp`, `trunc_exp`, logistic and softplus use the vector exponential (relative error below 3e-7), which clamps its
//! argument to `[-87, 88]`: results are never infinite. Sums over samples run in `f64`. NaN is passed on, never hidden.
//! The same bits on one machine however often a tile is repeated; SIMD levels differ by fused rounding.

mod arena;
mod args;
mod backward;
mod custom;
mod elementwise;
mod encode;
mod error;
mod forward;
mod grids;
mod matrix;
mod network;
mod op;
mod product;
mod record;
mod recycled;
mod shape;
mod state;
mod tangent;
mod unary;
mod waves;

pub use arena::Arena;
pub use args::{BackwardArgs, Bar, Demand, MAX_INPUTS, View};
pub use custom::CustomOp;
pub use encode::{Encoder, EncodingOp};
pub use error::TapeError;
pub use grids::HashGridTable;
pub use network::{MlpOp, activate, layers};
pub use shape::{Node, Shape};
pub use state::Tape;
pub use waves::Windowed;
