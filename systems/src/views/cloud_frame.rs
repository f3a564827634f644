//! The frame that a cloud is trained in, and the way back to the scene's: cameras about the origin, their extent the unit.
//!
//! Learning rates and thresholds of splats are in units of the extent `E`, and positions are `f32`: in this frame `E = 1`, and a
//! scene that lies at a million units keeps its digits.

use glam::DVec3;
use render_core::camera::Pose;
use serde::{Deserialize, Serialize};
use splat_core::Gaussians;

/// The extent is so much more than the largest distance of a camera from the middle of all.
const EXTENT_MARGIN: f64 = 1.1;
/// Cameras stand at one place when their extent is below this part of their distance from the origin, which rounding is
/// relative to.
const ONE_PLACE: f64 = 1e-9;

/// World to internal: `(x - centre) / scale`. Axes stay as they are.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CloudFrame {
    /// World units.
    pub centre: [f64; 3],
    /// World units of one internal unit, positive.
    pub scale: f64,
}

impl CloudFrame {
    /// The scene's own.
    pub const WORLD: Self = Self { centre: [0.0; 3], scale: 1.0 };

    /// Centre: the mean of the cameras' centres, or of the points where there is no camera. Scale: the extent
    /// `E = 1.1 max |o_i - mean o|`, or 1 where cameras stand at one place, which the note beside it says.
    ///
    /// What is not finite does not count.
    ///
    /// # Source
    /// Kerbl et al., "3D Gaussian splatting for real-time radiance field rendering", 2023, released code.
    #[must_use]
    pub fn around(cameras: &[DVec3], points: &[DVec3]) -> (Self, Option<String>) {
        let cameras: Vec<DVec3> = cameras.iter().copied().filter(|x| x.is_finite()).collect();
        let Some(centre) = mean(&cameras).or_else(|| mean(points)) else {
            return (Self::WORLD, Some("no cameras and no points: the unit of length is the scene's".into()));
        };
        let extent = EXTENT_MARGIN * cameras.iter().map(|o| o.distance(centre)).fold(0.0, f64::max);
        let furthest = cameras.iter().map(|o| o.length()).fold(0.0, f64::max);
        let (scale, note) = if extent > ONE_PLACE * furthest && extent.is_finite() {
            (extent, None)
        } else {
            let note = match cameras.len() {
                0 => "no cameras: the scene's extent is taken to be 1 world unit".into(),
                1 => "one camera: the scene's extent is taken to be 1 world unit".into(),
                n => format!("{n} cameras at one place: the scene's extent is taken to be 1 world unit"),
            };
            (1.0, Some(note))
        };
        (Self { centre: centre.to_array(), scale }, note)
    }

    /// A point of the scene's frame.
    #[must_use]
    pub fn to_internal(&self, x: DVec3) -> DVec3 {
        (x - DVec3::from(self.centre)) / self.scale
    }

    /// An internal point in the scene's frame.
    #[must_use]
    pub fn to_world(&self, x: DVec3) -> DVec3 {
        x * self.scale + DVec3::from(self.centre)
    }

    /// A pose of the scene's frame.
    #[must_use]
    pub fn pose_to_internal(&self, pose: &Pose) -> Pose {
        Pose { c: self.to_internal(pose.c), ..*pose }
    }

    /// A cloud of the scene's frame: positions and sizes; rotations, opacities and colours are the same in both.
    ///
    /// # Panics
    /// If `mean` holds more than three numbers for each Gaussian.
    pub fn cloud_to_internal(&self, cloud: &mut Gaussians) {
        let centre = self.centre;
        map(cloud, -self.scale.ln(), |axis, x| (x - centre[axis]) / self.scale);
    }

    /// An internal cloud in the scene's frame, as it is exported. Positions are `f32`: a scene at a million units is exported to
    /// a sixteenth of one.
    ///
    /// # Panics
    /// As [`CloudFrame::cloud_to_internal`].
    pub fn cloud_to_world(&self, cloud: &mut Gaussians) {
        let centre = self.centre;
        map(cloud, self.scale.ln(), |axis, x| x * self.scale + centre[axis]);
    }
}

/// Positions by `position(axis, x)`, logarithms of sizes by a sum; rounded once.
fn map(cloud: &mut Gaussians, log_scale: f64, position: impl Fn(usize, f64) -> f64) {
    let n = cloud.len();
    for (i, x) in cloud.mean.iter_mut().enumerate() {
        *x = position(i / n, f64::from(*x)) as f32;
    }
    for s in &mut cloud.log_scale {
        *s = (f64::from(*s) + log_scale) as f32;
    }
}

/// Of what is finite; `None` without any.
fn mean(points: &[DVec3]) -> Option<DVec3> {
    let finite = || points.iter().filter(|x| x.is_finite());
    // Shares are added, not the points: their sum could overflow.
    let share = 1.0 / finite().count() as f64;
    finite().map(|x| *x * share).reduce(|a, b| a + b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;

    fn close(a: DVec3, b: DVec3, bound: f64) -> bool {
        (a - b).length() <= bound
    }

    #[test]
    fn the_extent_is_one_inside() {
        let cameras = [DVec3::new(3.0, 0.0, 0.0), DVec3::new(-1.0, 0.0, 0.0), DVec3::new(1.0, 5.0, -3.0)];
        let (frame, note) = CloudFrame::around(&cameras, &[]);
        assert_eq!(note, None);
        let inside: Vec<DVec3> = cameras.iter().map(|c| frame.to_internal(*c)).collect();
        assert!(close(inside.iter().sum::<DVec3>(), DVec3::ZERO, 1e-12), "about the origin");
        let furthest = inside.iter().map(|c| c.length()).fold(0.0, f64::max);
        assert!((1.1 * furthest - 1.0).abs() < 1e-12, "{furthest}");
        for camera in cameras {
            assert!(close(frame.to_world(frame.to_internal(camera)), camera, 1e-12));
        }
        let pose = Pose { r: DMat3::from_rotation_x(0.3), c: cameras[2] };
        let moved = frame.pose_to_internal(&pose);
        assert!(moved.r == pose.r && moved.c == inside[2]);
    }

    #[test]
    fn cameras_at_one_place_have_extent_one_and_say_so() {
        let far = DVec3::new(1e6, -1e6, 3.0);
        for (cameras, word) in [(vec![far], "one camera"), (vec![far; 4], "4 cameras at one place")] {
            let (frame, note) = CloudFrame::around(&cameras, &[DVec3::ZERO]);
            assert!(frame.scale == 1.0 && close(frame.centre.into(), far, 1e-9));
            assert!(note.unwrap().contains(word));
        }
        let points = [DVec3::new(2.0, 0.0, 0.0), DVec3::NAN, DVec3::new(4.0, 2.0, 0.0)];
        let (frame, note) = CloudFrame::around(&[], &points);
        assert_eq!(frame, CloudFrame { centre: [3.0, 1.0, 0.0], scale: 1.0 });
        assert!(note.unwrap().contains("no cameras"));
        assert_eq!(CloudFrame::around(&[DVec3::NAN], &[]).0, CloudFrame::WORLD);
    }

    #[test]
    fn clouds_go_to_the_scene_and_back() {
        let frame = CloudFrame { centre: [10.0, -20.0, 5.0], scale: 4.0 };
        let mut cloud = Gaussians::new(2, 1).unwrap();
        cloud.mean = vec![0.5, -1.0, 0.25, 0.0, 2.0, 1.0];
        cloud.log_scale = vec![-1.0, -2.0, -3.0, 0.0, 0.5, 1.0];
        let (inside, wxyz) = (cloud.clone(), cloud.wxyz.clone());
        frame.cloud_to_world(&mut cloud);
        assert_eq!(cloud.mean, [12.0, 6.0, -19.0, -20.0, 13.0, 9.0]);
        for (out, inside) in cloud.log_scale.iter().zip(&inside.log_scale) {
            assert!((out.exp() - 4.0 * inside.exp()).abs() < 1e-6 * out.exp(), "four times as large");
        }
        assert_eq!(cloud.wxyz, wxyz);
        frame.cloud_to_internal(&mut cloud);
        assert_eq!(cloud.mean, inside.mean);
        assert!(cloud.log_scale.iter().zip(&inside.log_scale).all(|(a, b)| (a - b).abs() < 1e-6));
        let mut none = Gaussians::new(0, 0).unwrap();
        frame.cloud_to_world(&mut none);
        assert!(none.is_empty());
    }
}
