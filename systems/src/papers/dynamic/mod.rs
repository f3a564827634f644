//! Systems for scenes that move. Each file reads like its paper: the equations of its [deformation](crate::warps), on the tape.
//!
//! | name | the time | where a point was | beyond space |
//! | --- | --- | --- | --- |
//! | `two-parts` | a hash grid of space and time, before a still part | - | - |
//! | `t-nerf` | octaves | - | - |
//! | `d-nerf` | octaves | displacement | - |
//! | `d-nerf`, `field=mlp` | octaves | displacement, less that at `t = 0`, on the published networks | - |
//! | `nerfies` | free codes | rigid motion | - |
//! | `hypernerf` | free codes | rigid motion | ambient coordinates |
//! | `endo-nerf` | as `d-nerf`, led by tool masks and measured depth | | |
//! | `tineuvox` | octaves, through a network | displacement | time and place, beside voxels |
//! | `nsff`, `dynamic-nerf` | planes of place and time | scene flow to the frames beside, before a still part | - |
//!
//! Photos of `nerfies` and `hypernerf` have codes of `appearance` where their exposures differ.

mod appearance;
pub(crate) mod d_nerf;
pub(crate) mod d_nerf_published;
pub(crate) mod dynamic_nerf;
pub(crate) mod endo_nerf;
mod flow_terms;
#[cfg(test)]
mod gradient_tests;
pub(crate) mod hyper_nerf;
pub(crate) mod k_planes;
mod mask_terms;
#[cfg(test)]
mod motion_tests;
pub(crate) mod nerfies;
pub(crate) mod nsff;
#[cfg(test)]
mod origin_tests;
mod render_terms;
pub(crate) mod t_nerf;
pub(crate) mod tineuvox;
pub(crate) mod two_parts;
