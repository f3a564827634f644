//! Radiance-field systems, composed from the math crates, and what is written once above them.
//!
//! * [`system`]: the contract of a reconstruction method.
//! * [`data`]: views at training resolution and the ray batches drawn from them.
//! * [`options`]: what a run is told and what was decided from it.

pub mod data;
pub mod options;
pub mod system;
