//! Radiance-field systems, composed from the math crates, and what is written once above them.
//!
//! * [`system`]: the contract of a reconstruction method.
//! * [`data`]: views at training resolution and the ray batches drawn from them.
//! * [`options`]: what a run is told and what was decided from it.
//! * [`train`]: the loop of steps, evaluation and checkpoints; [`log`] its `metrics.csv`, [`checkpoint`] its state.
//! * [`render`], [`picture`], [`eval`]: pictures and how good they are.

pub mod checkpoint;
pub mod data;
pub mod error;
pub mod eval;
pub mod log;
pub mod memory;
pub mod options;
pub mod output;
pub mod picture;
pub mod render;
pub mod system;
pub mod train;

pub use error::RunError;
