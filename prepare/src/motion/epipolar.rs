//! How far a flow vector is from what a point that stays could make.

use super::fundamental::sampson;
use glam::{DMat3, DVec2, DVec3};
use render_core::camera::{Camera, Prepared};

/// Least cosine between a ray and the optical axis: beyond, a plane of pixels without distortion is no picture of the lens any more.
const LEAST_COSINE: f64 = 0.1;
/// Cameras closer than this share of their distance from the origin are at one place: `f64` knows no direction between them.
const SAME_PLACE: f64 = 1e-9;

/// Two cameras at different places.
pub(super) struct Epipolar {
    here: Prepared,
    there: Prepared,
    /// From the axes of the first camera to those of the second.
    turn: DMat3,
    /// `F`: a point of the first picture to its line in the second, both without distortion, pixels from the principal point.
    fundamental: DMat3,
}

/// A flow vector beside what cameras say, pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Deviation {
    /// Sampson distance: 0 for a point that stays, about 0.7 of the distance from the epipolar line for one that moves. What moves along the
    /// line shows nothing.
    pub(super) sampson: f64,
    /// How far the flow vector is from that of a point infinitely far away: what the way between the cameras made.
    pub(super) parallax: f64,
}

impl Epipolar {
    /// `None` for cameras at one place.
    pub(super) fn new(here: &Camera, there: &Camera) -> Option<Self> {
        let apart = here.pose.c - there.pose.c;
        let size = here.pose.c.length().max(there.pose.c.length());
        if apart.length() <= SAME_PLACE * size {
            return None;
        }
        let back = there.pose.r.transpose();
        let (turn, way) = (back * here.pose.r, (back * apart).try_normalize()?);
        let cross = DMat3::from_cols(
            DVec3::new(0.0, way.z, -way.y),
            DVec3::new(-way.z, 0.0, way.x),
            DVec3::new(way.y, -way.x, 0.0),
        );
        let inverse = |camera: &Camera| DMat3::from_diagonal(DVec3::new(1.0 / camera.fx, 1.0 / camera.fy, 1.0));
        let fundamental = inverse(there) * cross * turn * inverse(here);
        Some(Self { here: here.prepare(), there: there.prepare(), turn, fundamental })
    }

    /// What the cameras say of a flow vector at a pixel (centres at `+ 0.5`); `None` where a lens has no ray.
    pub(super) fn deviation(&self, pixel: DVec2, flow: DVec2) -> Option<Deviation> {
        let (from, to) = (ray(&self.here, pixel)?, ray(&self.there, pixel + flow)?);
        let (p, q) = (without_distortion(self.here.camera(), from), without_distortion(self.there.camera(), to));
        let sampson = sampson(self.fundamental, p, q);
        let far = self.there.project_from_camera(self.turn * from)?;
        Some(Deviation { sampson, parallax: (pixel + flow - far).length() })
    }
}

/// Direction of a pixel in camera axes, unless it is far aside.
fn ray(camera: &Prepared, pixel: DVec2) -> Option<DVec3> {
    camera.direction(pixel).filter(|direction| direction.z > LEAST_COSINE)
}

/// Where a lens without distortion would show a direction, from the principal point, homogeneous.
fn without_distortion(camera: &Camera, direction: DVec3) -> DVec3 {
    DVec3::new(camera.fx * direction.x / direction.z, camera.fy * direction.y / direction.z, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use render_core::camera::{Lens, Pose};

    fn cameras() -> [Camera; 2] {
        [DVec3::new(3.0, 0.5, 1.0), DVec3::new(2.8, 1.2, 1.3)].map(|eye| {
            let pose = Pose::look_at(eye, DVec3::new(0.1, -0.2, 0.0), DVec3::Z).unwrap();
            let camera = Camera::pinhole(640, 480, 500.0, 510.0, 310.0, 250.0, pose);
            Camera { lens: Lens::Perspective { k: [0.05, -0.01, 0.0, 0.0, 0.0, 0.0], p: [0.001, 0.0] }, ..camera }
        })
    }

    fn points() -> impl Iterator<Item = DVec3> {
        (0..40).map(f64::from).map(|k| DVec3::new((0.7 * k).sin(), (1.3 * k).cos(), (2.1 * k).sin()) * 0.6)
    }

    #[test]
    fn a_point_that_stays_is_on_its_line() {
        let [here, there] = cameras();
        let epipolar = Epipolar::new(&here, &there).unwrap();
        for x in points() {
            let (p, q) = (here.project(x).unwrap(), there.project(x).unwrap());
            let deviation = epipolar.deviation(p, q - p).unwrap();
            assert!(deviation.sampson < 1e-5 && deviation.parallax > 10.0, "{x}: {deviation:?}");
        }
    }

    #[test]
    fn a_way_across_the_line_shows_and_one_along_it_does_not() {
        let pose = |x: f64| Pose { c: DVec3::new(x, 0.0, 0.0), ..Pose::IDENTITY };
        let [here, there] = [0.0, 0.5].map(|x| Camera::pinhole(640, 480, 500.0, 500.0, 320.0, 240.0, pose(x)));
        let epipolar = Epipolar::new(&here, &there).unwrap();
        // Lines are rows. Of a way of 2 pixels across them, half is the other picture's: 2 / sqrt(2).
        let at = |flow: DVec2| epipolar.deviation(DVec2::new(200.5, 100.5), flow).unwrap();
        assert!((at(DVec2::new(-30.0, 2.0)).sampson - 2.0_f64.sqrt()).abs() < 1e-9);
        assert!(at(DVec2::new(-50.0, 0.0)).sampson < 1e-9);
        assert!((at(DVec2::new(-30.0, 0.0)).parallax - 30.0).abs() < 1e-9);
        // Both cameras at one place have no lines.
        assert!(Epipolar::new(&here, &here).is_none());
    }

    #[test]
    fn the_epipole_counts_as_staying() {
        let pose = |z: f64| Pose { c: DVec3::new(0.0, 0.0, z), ..Pose::IDENTITY };
        let [here, there] = [0.0, 0.5].map(|z| Camera::pinhole(64, 48, 50.0, 50.0, 32.5, 24.5, pose(z)));
        let epipolar = Epipolar::new(&here, &there).unwrap();
        let deviation = epipolar.deviation(DVec2::new(32.5, 24.5), DVec2::ZERO).unwrap();
        assert_eq!(deviation, Deviation { sampson: 0.0, parallax: 0.0 });
    }
}
