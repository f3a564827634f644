//! Systems of Gaussians: a file each, on what all of them are made of (`recipe`) and where they begin (`start`).

pub(crate) mod four_d_gaussians;
pub(crate) mod gs_w;
mod photos;
mod recipe;
pub(crate) mod splat;
mod start;
pub(crate) mod wild_gaussians;
