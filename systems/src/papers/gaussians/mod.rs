//! Systems of Gaussians: a file each, on what all of them are made of (`recipe`) and where they begin (`start`).

pub(crate) mod degauss;
mod depth_files;
pub(crate) mod four_d_gaussians;
pub(crate) mod gs_w;
mod layers;
mod leaving_out;
mod photos;
mod recipe;
mod sky;
pub(crate) mod splat;
pub(crate) mod spotless;
mod start;
pub(crate) mod wild_gaussians;
pub(crate) mod wild_gs;
