//! Tools for testing differentiable functions: proptest strategies, a gradient checker, golden vectors.
//!
//! | module | content |
//! | --- | --- |
//! | [`gradient`] | is a backward function the derivative of its forward function? An `f64` twin against central differences, an `f32` kernel against the twin, functions with corners |
//! | [`strategies`] | proptest strategies for rays, edges, densities, histograms, images, cameras, rotations, with the values that break code mixed in |
//! | [`property`] | number of cases of a property, and how to run a failed one again |
//! | [`reference`](mod@reference) | `f64` twins that several crates need |
//! | [`analytic`] | densities and colours along a ray whose pixel is known |
//! | [`golden`] | reader of golden vectors, [`golden::assert_close`], the folder of shared data |
//!
//! Nothing here depends on the crates it tests: everything is plain arrays, slices and closures, so a pair of another crate is
//! tested in the same way. `examples/own_pair.rs` does it from start to end. The checks return a [`gradient::Mismatch`], which names the
//! worst entry, both values and the bound; they are tested themselves, with wrong gradients.
//!
//! # Example
//! ```
//! use testkit::gradient::{PairTolerances, check_f32_pair};
//!
//! fn square(x: &[f32], y: &mut [f32]) { y[0] = x[0] * x[0]; }
//! fn square_backward(x: &[f32], y_bar: &[f32], x_bar: &mut [f32]) { x_bar[0] += 2.0 * x[0] * y_bar[0]; }
//! // The twin: slow, obvious, in f64. It is the specification.
//! fn twin(x: &[f64], y: &mut [f64]) { y[0] = x[0].powi(2); }
//! fn twin_backward(x: &[f64], y_bar: &[f64], x_bar: &mut [f64]) { x_bar[0] += 2.0 * x[0] * y_bar[0]; }
//!
//! check_f32_pair(&[3.0], &[1.0], (square, square_backward), (twin, twin_backward), PairTolerances::default()).unwrap();
//! ```
#![forbid(unsafe_code)]

pub mod analytic;
pub mod golden;
pub mod gradient;
pub mod property;
pub mod reference;
pub mod strategies;

pub use proptest;
pub use serde_json;
