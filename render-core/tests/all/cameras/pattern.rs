//! A known pattern, rendered through every camera model by casting rays, is where it belongs.

use super::lenses::{SAMPLES, sample_camera};
use glam::{DVec2, DVec3};
use render_core::camera::{Camera, Lens, Pose, RayTable};
use render_core::pose::Axes;

/// A soft dot on a plane: brightness `exp(-|x - centre|^2 / 2 sigma^2)`.
struct Dot {
    centre: DVec3,
    normal: DVec3,
    sigma: f64,
}

impl Dot {
    fn seen_along(&self, o: DVec3, d: DVec3) -> f64 {
        let t = (self.centre - o).dot(self.normal) / d.dot(self.normal);
        let off = (o + d * t - self.centre).length_squared();
        if t > 0.0 { (-0.5 * off / (self.sigma * self.sigma)).exp() } else { 0.0 }
    }

    /// Render the whole picture and take the centre of brightness: it knows nothing of `project`.
    fn found_in(&self, camera: &Camera) -> DVec2 {
        let table = RayTable::new(camera);
        let (mut sum, mut at) = (0.0, DVec2::ZERO);
        for j in 0..camera.height {
            for i in 0..camera.width {
                let Some(ray) = table.ray(&camera.pose, i, j) else { continue };
                let brightness = self.seen_along(ray.o, ray.d);
                sum += brightness;
                at += DVec2::new(f64::from(i) + 0.5, f64::from(j) + 0.5) * brightness;
            }
        }
        assert!(sum > 1.0, "the dot is not in the picture");
        at / sum
    }
}

/// A dot before the camera, on a plane that faces it, about 1 pixel wide.
fn dot(camera: &Camera, x: f64, y: f64) -> Dot {
    let z = 4.0;
    Dot {
        centre: camera.pose.to_world(DVec3::new(x * z, y * z, z)),
        normal: camera.optical_axis(),
        sigma: 1.1 * z / camera.fx,
    }
}

#[test]
fn dots_are_found_where_project_says() {
    for (name, lens) in SAMPLES {
        let camera = sample_camera(lens);
        for (x, y) in [(0.0, 0.0), (0.45, 0.0), (0.0, 0.35), (-0.4, -0.3), (0.3, -0.25), (-0.35, 0.3)] {
            let dot = dot(&camera, x, y);
            let want = camera.project(dot.centre).unwrap();
            let got = dot.found_in(&camera);
            assert!((got - want).length() < 0.05, "{name} ({x}, {y}): found at {got}, projected to {want}");
        }
    }
}

#[test]
fn right_is_right_and_down_is_down_in_every_model() {
    for (name, lens) in SAMPLES {
        let camera = sample_camera(lens);
        let at = |x: f64, y: f64| dot(&camera, x, y).found_in(&camera);
        let centre = at(0.0, 0.0);
        // The axis of the lens is at the principal point: half a pixel would show.
        assert!((centre - DVec2::new(camera.cx, camera.cy)).length() < 0.05, "{name}: axis at {centre}");
        let (right, down) = (at(0.25, 0.0) - centre, at(0.0, 0.25) - centre);
        assert!(right.x > 8.0 && right.y.abs() < 2.0, "{name}: right is {right}");
        assert!(down.y > 8.0 && down.x.abs() < 2.0, "{name}: down is {down}");
    }
}

#[test]
fn the_pixel_of_a_pinhole_is_the_textbook_one() {
    // A 5 x 3 image, f = 2: the centre of pixel (i, j) sees ((i + 0.5 - 2.5) / 2, (j + 0.5 - 1.5) / 2, 1).
    let camera = Camera::pinhole(5, 3, 2.0, 2.0, 2.5, 1.5, Pose::IDENTITY);
    let table = RayTable::new(&camera);
    assert_eq!(table.direction(2, 1), Some([0.0, 0.0, 1.0]));
    let want = DVec3::new(1.0, -0.5, 1.0).normalize().as_vec3();
    assert_eq!(table.direction(4, 0), Some(want.to_array()));
    assert_eq!(camera.project(DVec3::new(1.0, -0.5, 1.0)), Some(DVec2::new(4.5, 0.5)));
    // A corner of the image is the corner of a pixel, not a centre.
    assert_eq!(camera.project(DVec3::new(-1.25, -0.75, 1.0)), Some(DVec2::ZERO));
}

#[test]
fn a_blender_camera_sees_up_above_and_right_to_the_right() {
    // The identity in GL axes looks along -z with +y up.
    let rows = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
    let (pose, _) = Pose::from_matrix(&rows, Axes::Gl).unwrap();
    let camera = Camera::pinhole(100, 80, 50.0, 50.0, 50.0, 40.0, pose);
    assert_eq!(camera.optical_axis(), DVec3::NEG_Z);
    let pixel = camera.project(DVec3::new(1.0, 0.5, -5.0)).unwrap();
    assert!((pixel - DVec2::new(60.0, 35.0)).length() < 1e-12, "{pixel}");
    assert_eq!(camera.project(DVec3::new(1.0, 0.5, 5.0)), None);
}

#[test]
fn a_strong_lens_changes_the_picture() {
    // Guards the test above it: with the lens left out, dots would be pixels away.
    let barrel = sample_camera(SAMPLES[1].1);
    let straight = Camera { lens: Lens::PINHOLE, ..barrel };
    let dot = dot(&barrel, 0.45, 0.3);
    assert!((dot.found_in(&barrel) - straight.project(dot.centre).unwrap()).length() > 1.0);
}
