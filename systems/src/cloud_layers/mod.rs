//! Two clouds in one picture: what moves, before what stands still.
//!
//! The clouds are drawn one by one and put together by masks that the one in front brings with it: [`composite`]. What the picture costs,
//! and which part of that says where Gaussians are needed: [`costs`]. Both, step by step: [`pass`].
//!
//! Wang, Lohmeyer, Meboldt, Tang, "DeGauss: Dynamic-static decomposition with Gaussian splatting for distractor-free 3D reconstruction", 2025.

mod compare;
mod composite;
mod costs;
mod first_stage;
mod mask_costs;
mod pass;
mod seen;
mod settings;
#[cfg(test)]
mod tests;

pub(crate) use pass::TwoLayers;
pub(crate) use settings::LayerSettings;

/// Rows of a Gaussian in front: the logits of how much it shows of its own cloud, of the one behind, and of how bright that is.
pub(crate) const MASK_ROWS: usize = 3;
