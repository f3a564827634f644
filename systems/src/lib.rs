//! Radiance-field systems, put together from the math crates, on the engine that they share (crate `engine`).
//!
//! * [`registry`]: the systems by name, for all apps; [`claims`]: what each does otherwise than its paper.
//! * [`papers`]: one file or folder for each system, with the paper's equations.
//! * [`plan`], [`layout`], [`space`]: what a scene needs, what kind of place it is, and the map from world coordinates to those
//!   of a field.
//! * [`rays`]: the driver over rays. Its parts: [`fields`], [`samplers`], [`terms`], `warps`, [`appearance`], [`occluders`];
//!   [`photo_model`] is the interface to the last two. [`networks`]: the driver for networks of the published sizes.
//! * [`gradients`]: gradients with respect to rays and cameras; `schedule`: where a training is in its schedule.
//! * [`views`]: the driver of systems of Gaussians; `cloud_motion`: clouds that move; `cloud_appearance`, `cloud_reference` with `cloud_maps`
//!   and `cloud_triplane`, `cloud_occluders`: clouds from photos of many people; `proxy`: a field that is trained before one.
//!   [`splats`]: clouds of Gaussians from files. [`bake`]: any field as a cloud of Gaussians, to look at and to export.

pub mod appearance;
pub mod bake;
pub(crate) mod buffers;
pub mod claims;
mod cloud_appearance;
mod cloud_layers;
mod cloud_maps;
mod cloud_motion;
mod cloud_occluders;
mod cloud_reference;
mod cloud_triplane;
mod codes;
#[cfg(test)]
mod engine_tests;
pub mod fields;
pub(crate) mod free_space;
pub mod gradients;
pub mod layout;
pub(crate) mod left_out;
pub(crate) mod limits;
pub mod networks;
pub mod occluders;
pub mod papers;
pub mod photo_model;
pub mod plan;
mod proxy;
pub mod rays;
pub mod registry;
pub mod samplers;
pub(crate) mod schedule;
pub(crate) mod settings;
pub mod space;
pub mod splats;
pub(crate) mod static_maps;
pub(crate) mod survey;
pub mod terms;
pub mod views;
pub(crate) mod warps;
