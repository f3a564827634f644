//! Numbers that no camera can have.
//!
//! Far beyond anything built, and small enough that products of a few of them stay finite in `f32`: a focal length of
//! 1e308 pixels is a slip of the pen or an attack, and would give rays that are not numbers.

use super::Camera;
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

/// Whether the numbers of a camera, all finite, are such as a camera can have.
pub(super) fn check(camera: &Camera) -> Result<(), CameraError> {
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
