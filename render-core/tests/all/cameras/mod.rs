//! Cameras, poses and lenses.

mod edges;
mod gradients;
pub(crate) mod lenses;
mod pattern;
mod poses;
mod round_trip;
