//! A system of rays: the driver that trains and renders a field, whatever it is made of.
//!
//! | part | room |
//! | --- | --- |
//! | what is learnt about places, and the networks behind it | [`crate::fields`] |
//! | where samples lie along a ray | [`crate::samplers`] |
//! | what whole rays cost | [`crate::terms`] |
//! | what moves | the room `warps`; where a part of the field is for that alone: `movers`, `residuals`, `photo_tiles`, `mover_masks`; how it goes on in the frames beside: `scene_flow` |
//! | appearance of photos, and what hides the scene in them | [`crate::photo_model`] |
//!
//! A step:
//!
//! 1. rays of random training pixels; samples where the sampler finds something (`chunk.rs`);
//! 2. features -> density network -> density and geometry; with the view direction's spherical harmonics -> colour network ->
//!    colour; composited to pixels; the loss, and all of it backwards (`tile.rs`);
//! 3. the gradients of the chunks, added in their order, and a step of each part's optimiser (`step.rs`).

mod account;
#[cfg(test)]
mod budget_tests;
#[cfg(test)]
mod canonical_tests;
mod chunk;
mod config;
mod context;
mod counts;
mod deform_losses;
#[cfg(test)]
mod deform_losses_tests;
mod driver;
mod fit;
#[cfg(test)]
mod gradient_tests;
mod head;
mod idle_cells;
mod learn;
mod marched;
mod missed;
#[cfg(test)]
mod missed_tests;
mod mover_masks;
mod movers;
#[cfg(test)]
mod movers_tests;
mod moving_config;
mod moving_places;
#[cfg(test)]
mod moving_tests;
mod photo_tiles;
mod point_flow;
mod points;
mod prepass;
#[cfg(test)]
mod proposal_tests;
mod ray_bars;
mod ray_gradient;
#[cfg(test)]
mod ray_gradient_tests;
mod render;
mod render_scratch;
mod residuals;
mod scene_flow;
mod second_render;
#[cfg(test)]
mod second_render_tests;
mod state;
mod step;
mod survey;
mod system;
mod tile;
#[cfg(test)]
mod time_bins_tests;
mod work;

pub use config::{BatchConfig, RateConfig, RayConfig, SamplerConfig};
pub use driver::RaySystem;
pub use head::{HeadConfig, MixtureKind};
pub use moving_config::MovingConfig;
pub(crate) use moving_config::MovingSettings;
pub(crate) use scene_flow::{
    BEYOND, FlowConfig, FlowRays, FlowSettings, FlowTerm, HERE, NEXT, PASSES, PREVIOUS, SeenBars,
};
