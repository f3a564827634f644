//! Systems for scenes that move: a video in, any viewpoint at any time out.
//!
//! Each file reads like its paper: which parts of a [deformation](crate::deform) it takes, and its losses.
//!
//! | name | a moment | where a point was | beyond space |
//! | --- | --- | --- | --- |
//! | `ngp` | - | - | - |
//! | `t-nerf` | time | - | - |
//! | `d-nerf` | time | displacement, none at `t = 0` | - |
//! | `nerfies` | free codes | rigid motion | - |
//! | `hypernerf` | free codes | rigid motion | ambient coordinates |
//! | `endo-nerf` | as `d-nerf`, led by tool masks and measured depth | | |
//! | `tineuvox` | time, through a network | displacement | time and place, beside voxels |

mod config;
mod d_nerf;
mod endo_nerf;
mod hyper_nerf;
mod nerfies;
mod plan;
mod t_nerf;
mod tineuvox;

pub use config::{DynamicConfig, MomentKind, OriginKind, SeesKind, WarpKind};
pub use plan::{CLAIMS, SYSTEMS, build, load};
