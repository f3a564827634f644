//! Cameras, poses and lenses.

mod edges;
mod gradients;
mod lenses;
mod pattern;
mod poses;
mod round_trip;
