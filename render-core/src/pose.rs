//! Camera poses: where a camera stands and how it is turned.

use glam::{DMat3, DVec3};

/// Camera-to-world pose with CV camera axes (x right, y down, z forward): `x_world = r x_camera + c`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Rotation, camera to world.
    pub r: DMat3,
    /// Camera centre in the world.
    pub c: DVec3,
}

impl Pose {
    /// At the origin, looking along world `+z` with `+y` down.
    pub const IDENTITY: Self = Self { r: DMat3::IDENTITY, c: DVec3::ZERO };

    /// A point from camera to world coordinates.
    #[must_use]
    pub fn to_world(&self, x_camera: DVec3) -> DVec3 {
        self.r * x_camera + self.c
    }

    /// A point from world to camera coordinates.
    #[must_use]
    pub fn to_camera(&self, x_world: DVec3) -> DVec3 {
        self.r.transpose() * (x_world - self.c)
    }
}
