//! Cameras both ways: world points to pixels, pixels to rays.
//!
//! Pixel coordinates are continuous: pixel `(i, j)` (column, row) has its centre at `(i + 0.5, j + 0.5)`, and the
//! principal point is given in these coordinates. Camera axes are CV: x right, y down, z forward.
//!
//! ```
//! use glam::DVec2;
//! use render_core::camera::{Camera, Pose};
//!
//! let camera = Camera::pinhole(640, 480, 500.0, 500.0, 320.0, 240.0, Pose::IDENTITY);
//! let pixel = DVec2::new(100.5, 50.5);
//! let ray = camera.ray(pixel).unwrap();
//! let back = camera.project(ray.at(3.0)).unwrap();
//! assert!((back - pixel).length() < 1e-9);
//! ```

mod colmap;
mod derivative;
mod distortion;
mod fov;
mod lens;
mod limits;
mod parameters;
mod polynomial;
mod prepared;
mod table;

pub use self::{
    colmap::ColmapModel,
    derivative::{CameraBar, PoseBar},
    lens::Lens,
    parameters::Camera,
    prepared::Prepared,
    table::RayTable,
};
pub use crate::pose::Pose;
