//! A ray, in world space.

use glam::DVec3;

/// A half line `o + t d`, `t >= 0`.
///
/// `o` is in world units and `d` has unit length, so `t` is a metric distance (not a z depth).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Origin, world units.
    pub o: DVec3,
    /// Unit direction.
    pub d: DVec3,
}

impl Ray {
    /// The point at distance `t`.
    #[must_use]
    pub fn at(&self, t: f64) -> DVec3 {
        self.o + self.d * t
    }
}
