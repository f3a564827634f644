//! Radiance-field systems, composed from the math crates, on the engine that they share (crate `engine`).
//!
//! * [`plan`]: what a scene needs, and the systems for scenes that stand still; [`claims`]: what each does otherwise than its
//!   paper.
//! * [`layout`], [`space`]: what kind of place a scene is, and the map from world coordinates to those of a field.
//! * [`static_scene`]: the hash grid (`ngp`) and the published networks.
//! * [`method`]: the seam between a field and what a method for photographs from the wild adds to it; [`wild`]: those methods.
//! * `warps`: deformations of moving scenes; [`dynamic`]: the systems made of them.
//! * [`splats`]: systems of Gaussian splats. [`bake`]: any field as a cloud of Gaussians, to look at and to export.

pub mod bake;
pub(crate) mod buffers;
pub mod claims;
pub mod dynamic;
#[cfg(test)]
mod engine_tests;
pub mod fields;
pub(crate) mod free_space;
pub mod layout;
pub(crate) mod left_out;
pub mod method;
pub mod networks;
pub mod papers;
pub mod plan;
pub mod rays;
pub mod registry;
pub mod samplers;
pub(crate) mod settings;
pub mod space;
pub mod splats;
pub(crate) mod survey;
pub mod terms;
pub(crate) mod warps;
pub mod wild;

pub(crate) use warps as deform;
