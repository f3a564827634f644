//! A camera as it is written down: image size, intrinsics, lens and pose.

use glam::DVec3;

use super::lens::Lens;
use crate::pose::Pose;

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

    /// The same view at another image size: intrinsics are scaled, each axis by its own ratio.
    ///
    /// Exact with half-pixel centres: the edges of the image stay where they are.
    #[must_use]
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let sx = f64::from(width) / f64::from(self.width);
        let sy = f64::from(height) / f64::from(self.height);
        Self { width, height, fx: self.fx * sx, fy: self.fy * sy, cx: self.cx * sx, cy: self.cy * sy, ..*self }
    }

    /// True when both cameras have the same rays in camera axes: they can share a [`RayTable`](super::RayTable).
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
