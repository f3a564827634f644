//! Appearance of a cloud of Gaussians from a reference photo that is projected back into the scene, and from its tones as a whole.
//!
//! | part | file |
//! | --- | --- |
//! | settings | [`settings`] |
//! | pixels of the photo as points | [`back_projection`] |
//! | points on three planes about the scene, as either side of each sees them | [`planes`] |
//! | what networks make of planes and photo, and where Gaussians read it | [`triplane`] |
//!
//! What it shares with other kinds: [`crate::cloud_reference`].
//!
//! Source: Xu et al., "Wild-GS: Real-Time Novel View Synthesis from Unconstrained Photo Collections", 2024.

mod back_projection;
#[cfg(test)]
mod learning_tests;
mod planes;
mod settings;
#[cfg(test)]
mod tests;
mod triplane;

pub(crate) use settings::TriplaneSettings;
pub(crate) use triplane::Triplane;
