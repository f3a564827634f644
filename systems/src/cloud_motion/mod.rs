//! Clouds of Gaussians that move: what becomes of each Gaussian at a time, from learned features of its place and the time.
//!
//! | part | file |
//! | --- | --- |
//! | settings | `settings` |
//! | where features are: a box of the frame of training | `unit_box` |
//! | neighbours move alike | `coherence` |
//! | what stands still is not asked: when it does, and the looks that find it | `rest`, `look` |
//! | networks that turn features into offsets of parameters | `decoder` |
//! | the motion of a cloud, forward and backward, and its optimisers | `deformation_field` |
//!
//! Features are those that fields of radiance have ([`crate::fields`]); which ones, and who published them, is said in
//! [`crate::papers::gaussians`]. Where a cloud is moved in a step: [`crate::views`].

mod coherence;
mod decoder;
mod deformation_field;
mod look;
mod rest;
#[cfg(test)]
mod rest_tests;
mod settings;
#[cfg(test)]
mod tests;
mod unit_box;

pub(crate) use deformation_field::DeformationField;
pub(crate) use settings::{MotionParts, MotionSettings};
pub(crate) use unit_box::UnitBox;
