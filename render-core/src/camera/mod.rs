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
mod polynomial;
mod prepared;
mod table;

use glam::{DVec2, DVec3};

pub use self::{
    colmap::ColmapModel,
    derivative::{CameraBar, PoseBar},
    lens::Lens,
    prepared::Prepared,
    table::RayTable,
};
pub use crate::pose::Pose;
use crate::{error::CameraError, ray::Ray};

/// One camera: image size, intrinsics in pixels, lens and pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Columns of the image.
    pub width: u32,
    /// Rows of the image.
    pub height: u32,
    /// Focal length along x, pixels.
    pub fx: f64,
    /// Focal length along y, pixels.
    pub fy: f64,
    /// Principal point, x; the image's left edge is 0.
    pub cx: f64,
    /// Principal point, y; the image's upper edge is 0.
    pub cy: f64,
    /// Lens model.
    pub lens: Lens,
    /// Camera-to-world pose.
    pub pose: Pose,
}

impl Camera {
    /// A camera without distortion.
    #[must_use]
    pub fn pinhole(width: u32, height: u32, fx: f64, fy: f64, cx: f64, cy: f64, pose: Pose) -> Self {
        Self { width, height, fx, fy, cx, cy, lens: Lens::PINHOLE, pose }
    }

    /// Whether this is a camera that can see: image size, focal lengths, principal point, lens parameters and centre are
    /// finite, and such as a camera can have (`fx` = 1e308 is not).
    ///
    /// # Errors
    /// [`CameraError`] naming the first parameter that is wrong.
    pub fn check(&self) -> Result<(), CameraError> {
        if self.width == 0 || self.height == 0 {
            return Err(CameraError::EmptyImage { width: self.width, height: self.height });
        }
        let intrinsics = [("fx", self.fx), ("fy", self.fy), ("cx", self.cx), ("cy", self.cy)];
        let c = self.pose.c;
        let centre = [("centre x", c.x), ("centre y", c.y), ("centre z", c.z)];
        for (parameter, value) in intrinsics.into_iter().chain(self.lens.parameters()).chain(centre) {
            if !value.is_finite() {
                return Err(CameraError::NonFinite { parameter });
            }
        }
        for (parameter, value) in [("fx", self.fx), ("fy", self.fy)] {
            if value <= 0.0 {
                return Err(CameraError::Focal { parameter, value });
            }
        }
        match self.lens {
            Lens::Fov { omega } if omega.abs() >= core::f64::consts::PI => Err(CameraError::Omega { value: omega }),
            _ => limits::check(self),
        }
    }

    /// The camera with the limits of its lens worked out: faster for more than a few points.
    #[must_use]
    pub fn prepare(&self) -> Prepared {
        Prepared::new(*self)
    }

    /// Pixel coordinates of a world point; `None` behind the camera and beyond the fold of the lens.
    ///
    /// The pixel may lie outside of the image.
    #[must_use]
    pub fn project(&self, x_world: DVec3) -> Option<DVec2> {
        self.prepare().project(x_world)
    }

    /// The ray through a pixel, `None` where the lens has none.
    #[must_use]
    pub fn ray(&self, pixel: DVec2) -> Option<Ray> {
        self.prepare().ray(pixel)
    }

    /// Unit direction of the ray through a pixel, in camera axes; `None` where the lens has none.
    #[must_use]
    pub fn direction_in_camera(&self, pixel: DVec2) -> Option<DVec3> {
        self.prepare().direction(pixel)
    }

    /// The same view at another image size: intrinsics are scaled, each axis by its own ratio.
    ///
    /// Exact with half-pixel centres: the edges of the image stay where they are.
    #[must_use]
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let sx = f64::from(width) / f64::from(self.width);
        let sy = f64::from(height) / f64::from(self.height);
        Self { width, height, fx: self.fx * sx, fy: self.fy * sy, cx: self.cx * sx, cy: self.cy * sy, ..*self }
    }

    /// True when both cameras have the same rays in camera axes: they can share a [`RayTable`].
    #[must_use]
    pub fn same_optics(&self, other: &Self) -> bool {
        Self { pose: self.pose, ..*other } == *self
    }

    /// Unit direction the camera looks along, in the world.
    #[must_use]
    pub fn optical_axis(&self) -> DVec3 {
        self.pose.r.z_axis
    }
}
