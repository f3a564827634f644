//! Slow, obvious `f64` versions of what several crates need a twin of: for tests, and for the errors that `nerf-bench` prints
//! beside its times. Plain slices, one sample at a time, written from the definitions.
//!
//! * [`network`]: a multilayer perceptron, forward and backward.
//! * [`lattice`]: one level of a feature grid, blended trilinearly, forward and backward.
//! * [`planes`]: features on planes, blended bilinearly and combined, with all derivatives.
//! * [`splats`]: Gaussians to ellipses to pixels, and back.
//!
//! The quadrature has its own, `render_core::quadrature::reference`.

pub mod lattice;
pub mod network;
pub mod planes;
pub mod splats;
