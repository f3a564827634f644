//! Radiance-field systems, composed from the math crates, and what is written once above them.
//!
//! * [`system`]: the contract of a reconstruction method.
//! * [`data`]: views at training resolution and the ray batches drawn from them.

pub mod data;
pub mod system;
