//! Clouds of Gaussians to be drawn: from a file, a training or a bake, without photos.
//!
//! * [`Cloud`]: a cloud that is drawn as it is, with cameras and paths around it.
//! * `system`: the same as a [`System`](engine::system::System), so that its pictures can be measured.
//! * `upright`: which way is up, and where the first view is from.
//!
//! How clouds are trained: [`crate::views`].

mod cloud;
mod system;
mod upright;

pub use cloud::Cloud;
