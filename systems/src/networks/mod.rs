//! The driver of networks as published, which sample each ray twice: at the coarse level everywhere, then at the fine level where
//! the coarse one found something.
//!
//! * [`TwoLevel`] is the system; a [`Recipe`] says where to sample, what the position encoding sees, the density's activation,
//!   losses and rates.
//! * `settings`: what all recipes can be set to. `network`, `head`, `parts`: the networks on the tape; `composite`,
//!   `composite_two`: the quadrature on the tape. `displacement`: a network in front that moves points of a time (`when`) to where they
//!   are in the canonical scene; `canonical` is what it says of points.
//! * `step`: a training step, whose `chunk`s go through both levels in `pass`. `render`, `fit`, `survey`: pictures, codes of
//!   photos that were not trained on, training views for the photo model. `system` is what the engine asks for.
//!
//! The gradients of a step stop at the samples' positions. `ray_gradient` goes on to the rays, where they are asked for:
//! `along`, `gaussian_bar`, `ray_bars`.

mod along;
mod canonical;
mod chunk;
mod composite;
mod composite_two;
pub(crate) mod cones;
mod displacement;
#[cfg(test)]
mod displacement_tests;
mod fit;
mod gaussian_bar;
mod head;
mod network;
pub(crate) mod parts;
mod pass;
mod ray_bars;
mod ray_gradient;
#[cfg(test)]
mod ray_gradient_tests;
mod recipe;
mod render;
mod samples;
mod settings;
mod step;
mod survey;
mod system;
mod trained;
mod two_level;
mod when;

pub use along::Along;
pub(crate) use along::placed;
pub use cones::Footprint;
pub use displacement::{DisplacementShape, Origin};
pub(crate) use gaussian_bar::GaussianBar;
pub use network::NetworkShape;
pub use recipe::Recipe;
pub(crate) use samples::ray_random;
pub use samples::{Level, Tile};
pub use settings::{NetworkConfig, PlaceConfig, RaysConfig, TwoLevelConfig};
pub(crate) use trained::Trained;
pub use two_level::TwoLevel;
