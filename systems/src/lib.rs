//! Radiance-field systems, composed from the math crates, on the engine that they share (crate `engine`).
//!
//! * [`plan`]: what a scene needs, and the systems for scenes that stand still; [`claims`]: what each does otherwise than its
//!   paper.
//! * [`layout`], [`space`]: what kind of place a scene is, and the map from world coordinates to those of a field.
//! * [`static_scene`]: the hash grid (`ngp`) and the published networks.
//! * [`method`]: the seam between a field and the models of photographs from the wild; [`appearance`] and [`occluders`]: these
//!   models; [`papers`]: the systems made of them.
//! * `warps`: deformations of moving scenes; [`dynamic`]: the systems made of them.
//! * [`splats`]: systems of Gaussian splats. [`bake`]: any field as a cloud of Gaussians, to look at and to export.

pub mod appearance;
pub mod bake;
pub(crate) mod buffers;
pub mod claims;
mod codes;
pub mod dynamic;
#[cfg(test)]
mod engine_tests;
pub mod fields;
pub(crate) mod free_space;
pub mod layout;
pub(crate) mod left_out;
pub(crate) mod limits;
pub mod method;
pub mod networks;
pub mod occluders;
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

pub use papers::wild;
pub(crate) use warps as deform;
