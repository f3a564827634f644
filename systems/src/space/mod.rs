//! From the scene's frame to the unit the fields work in, and back.
//!
//! *Internal* coordinates put what matters into the cube `[-1, 1]^3`. Rays stay straight in them, so that sampling and
//! occupancy grids work there; the field's grid then sees `[0, 1]^3`:
//!
//! | kind | internal | grid |
//! | --- | --- | --- |
//! | `box` | `(x - centre) / radius` | `(p + 1) / 2` |
//! | `contracted` | the same; space goes on beyond the cube | `(contract(p) + 2) / 4`, max-norm |
//! | `ndc` | projective: lateral position over depth, and disparity, of a reference camera | `(p + 1) / 2` |

mod config;
mod map;
mod ray;
#[cfg(test)]
mod tests;

pub use config::{SpaceConfig, SpaceKind};
pub use map::Space;
pub use ray::InternalRay;
