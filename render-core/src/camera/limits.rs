//! Numbers that no camera can have, and the check for them.
//!
//! Far beyond anything built, and small enough that products of a few of them stay finite in `f32`: a focal length of
//! 1e308 pixels is a slip of the pen or an attack, and would give rays that are not numbers.

use super::{lens::Lens, parameters::Camera};
use crate::error::CameraError;

/// Image sides that a focal length may have, least and most: angles of view of 179.99 degrees and of 0.2 seconds of arc.
const FOCAL_SIDES: [f64; 2] = [1e-4, 1e6];
/// Image sides that the principal point may lie away from the picture's upper left corner: a small part cut out of a large
/// picture has it far outside.
const CENTRE_SIDES: f64 = 1e6;
/// Largest lens coefficient. Long lenses have large ones, which belong to high powers of small angles.
const COEFFICIENT: f64 = 1e12;
/// Largest coordinate of a camera's centre, world units.
const FARTHEST: f64 = 1e12;

impl Camera {
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
            _ => within_limits(self),
        }
    }
}

/// Whether the numbers of a camera, all finite, are such as a camera can have.
fn within_limits(camera: &Camera) -> Result<(), CameraError> {
    let side = f64::from(camera.width.max(camera.height));
    let within = |parameter, value: f64, [least, most]: [f64; 2]| match (least..=most).contains(&value) {
        true => Ok(()),
        false => Err(CameraError::OutOfRange { parameter, value, least, most }),
    };
    for (parameter, value) in [("fx", camera.fx), ("fy", camera.fy)] {
        within(parameter, value, FOCAL_SIDES.map(|sides| sides * side))?;
    }
    for (parameter, value) in [("cx", camera.cx), ("cy", camera.cy)] {
        within(parameter, value, [-CENTRE_SIDES * side, CENTRE_SIDES * side])?;
    }
    for (parameter, value) in camera.lens.parameters() {
        within(parameter, value, [-COEFFICIENT, COEFFICIENT])?;
    }
    let centre = camera.pose.c;
    for (parameter, value) in [("centre x", centre.x), ("centre y", centre.y), ("centre z", centre.z)] {
        within(parameter, value, [-FARTHEST, FARTHEST])?;
    }
    Ok(())
}
