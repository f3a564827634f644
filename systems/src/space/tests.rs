//! Rays, cones and points there and back, in all three kinds of space.

use super::Space;
use float_core::Simd;
use glam::{DMat3, DVec2, DVec3};
use render_core::camera::{Camera, Pose};
use render_core::ray::Ray;

fn camera(c: DVec3) -> Camera {
    Camera::pinhole(64, 48, 60.0, 60.0, 32.0, 24.0, Pose { r: DMat3::IDENTITY, c })
}

#[test]
fn internal_rays_pass_through_the_points_they_should() {
    let cameras = [camera(DVec3::ZERO), camera(DVec3::new(0.3, -0.2, 0.1))];
    let reference = Pose { r: DMat3::IDENTITY, c: DVec3::ZERO };
    let spaces = [
        Space::boxed(DVec3::new(0.0, 0.0, 5.0), 6.0, 0.01),
        Space::contracted(DVec3::new(0.0, 0.0, 5.0), 2.0, 16.0, 0.01),
        Space::ndc(reference, 1.0, &cameras).unwrap(),
    ];
    for space in spaces {
        for camera in &cameras {
            let ray = camera.ray(DVec2::new(11.0, 37.5)).unwrap();
            let internal = space.internal_ray(&ray);
            assert!(internal.end > internal.start);
            for k in 1..10 {
                let t = internal.start + (internal.end - internal.start) * k as f32 / 12.0;
                let world = space.world_distance(&ray, t);
                assert!((space.internal_distance(&ray, world) - t).abs() < 1e-4 * t.max(1.0), "{:?}", space.kind());
                let x = ray.o + world * ray.d;
                let p = space.internal_point(x).unwrap();
                let on_ray = internal.at(t);
                for a in 0..3 {
                    assert!((p[a] - on_ray[a]).abs() < 1e-4, "{:?} {p:?} {on_ray:?}", space.kind());
                }
                assert!((space.world_point(p) - x).length() < 1e-3 * x.length(), "{:?}", space.kind());
            }
        }
    }
}

#[test]
fn grid_positions_stay_in_the_unit_cube_and_come_back() {
    let space = Space::contracted(DVec3::ZERO, 1.0, 64.0, 0.1);
    let x = [0.3, -7.0, 63.0, 0.1, 2.0, -64.0, 1.0, -0.5, 5.0];
    let mut u = [0.0; 9];
    space.grid_positions(Simd::best(), &x, &mut u);
    for i in 0..3 {
        let p = [u[i], u[3 + i], u[6 + i]];
        assert!(p.iter().all(|u| (0.0..=1.0).contains(u)));
        let back = space.internal_of_grid(p);
        for a in 0..3 {
            let want = x[3 * a + i];
            assert!((back[a] - want).abs() < 1e-3 * want.abs().max(1.0), "{back:?}");
        }
    }
}

#[test]
fn cones_are_as_wide_as_the_pixels_around_them() {
    let pose = Pose { r: DMat3::IDENTITY, c: DVec3::ZERO };
    let cameras = [camera(DVec3::ZERO), camera(DVec3::new(0.3, -0.2, 0.1))];
    let to_disc = 2.0 / 12.0_f64.sqrt();
    for camera in &cameras {
        let pixel = DVec2::new(11.5, 37.5);
        let ray = camera.ray(pixel).unwrap();
        let radius = camera.prepare().cone_radius(pixel).unwrap();
        // A scene in other units gives the same.
        for space in
            [Space::boxed(DVec3::new(0.0, 0.0, 5.0), 6.0, 0.01), Space::contracted(DVec3::ZERO, 2.0, 16.0, 0.01)]
        {
            assert_eq!(space.internal_cone(&ray, radius).radius, radius as f32);
        }
        let space = Space::ndc(pose, 1.0, &cameras).unwrap();
        let cone = space.internal_cone(&ray, radius);
        // Far away, the neighbours are one pixel aside.
        let far = |pixel| space.internal_point(camera.ray(pixel).unwrap().at(1e5)).unwrap();
        let [at, right, below] = [DVec2::ZERO, DVec2::X, DVec2::Y].map(|step| far(pixel + step));
        let pitch = 0.5 * ((right[0] - at[0]) + (at[1] - below[1]));
        assert!((f64::from(cone.radius / pitch) - to_disc).abs() < 1e-3, "{} {pitch}", cone.radius);
    }
}

#[test]
fn rays_that_miss_have_nothing_to_sample() {
    let space = Space::boxed(DVec3::ZERO, 1.0, 0.0);
    let ray = space.internal_ray(&Ray { o: DVec3::new(0.0, 5.0, 0.0), d: DVec3::Z });
    assert!(ray.end <= ray.start);
}
