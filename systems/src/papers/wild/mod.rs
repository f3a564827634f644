//! Systems for photographs from the wild: occluders before the scene, photos of different appearance.
//!
//! Each system is an appearance model ([`crate::appearance`]) and an occluder model ([`crate::occluders`]) on the hash grid
//! (`--field ngp`) or the published networks (`--field mlp`). A paper's file plans the settings of its two models and holds its
//! equations: `nerf_w`, `ha_nerf`, `sf_nerf`, `robust_nerf`, `hugs`; `auto` chooses the models by the photos.
//!
//! | name | appearance | occluders |
//! | --- | --- | --- |
//! | `plain` | - | - |
//! | `nerf-a`, `nerf-u`, `nerf-w` | free codes, -, free codes | -, transient field, transient field |
//! | `ha-nerf-a`, `ha-nerf-t`, `ha-nerf` | encoder, -, encoder | -, visibility map, visibility map |
//! | `sf-nerf` | free codes | filter network in image space |
//! | `robust-nerf` | - | robust loss, and masks found at ever longer intervals |
//! | `hugs` | - | masks found after a short training |
//! | `auto` | as the photos need | as the photos need |
//!
//! Any appearance model (`--set appearance=none|codes|encoder`) goes with any occluder model
//! (`--set occluders=none|robust|transient|visibility|filter|masks`); `combined` joins them. `--set` knows the settings of the
//! models that are there.

pub(crate) mod auto;
mod build;
mod choice;
pub(crate) mod combined;
pub mod ha_nerf;
pub mod hugs;
pub mod nerf_w;
mod planning;
pub mod robust_nerf;
pub mod sf_nerf;
#[cfg(test)]
mod tests;

pub(crate) use build::build;
pub use choice::{AppearanceKind, Choice, FieldKind, OccluderKind};
