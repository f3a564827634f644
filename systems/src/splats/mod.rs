//! Clouds of Gaussians to be drawn: from a file, a training or a bake, without photos.
//!
//! * [`Cloud`]: a cloud that is drawn as it is, with cameras and paths around it.
//! * `upright`: which way is up, and where the first view is from.
//!
//! How clouds are trained: [`crate::views`].

mod cloud;
mod upright;

pub use cloud::Cloud;
