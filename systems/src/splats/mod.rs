//! Systems of Gaussian splats.
//!
//! * [`frame`]: the frame a cloud is trained in, and the way back to the scene's.
//! * [`start`]: where a cloud begins: at reconstructed points, or anywhere in a box.

pub mod frame;
mod neighbours;
pub mod start;
