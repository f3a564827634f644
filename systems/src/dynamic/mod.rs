//! Systems for scenes that move: a video in, any viewpoint at any time out.
//!
//! What each is made of stands in its own file (`papers::dynamic`).

mod plan;
mod rays;

pub use plan::{CLAIMS, SYSTEMS, build, load};
