//! Projection against the definitions, and pixel -> ray -> pixel.

use super::lenses::{SAMPLES, any_camera, naive_project, sample_camera};
use glam::{DVec2, DVec3};
use proptest::prelude::*;
use render_core::camera::{Camera, Lens, Pose, RayTable};

proptest! {
    #![proptest_config(testkit::property::cases(256))]

    #[test]
    fn a_ray_projects_to_its_pixel(camera in any_camera(), u in -0.2..1.2_f64, v in -0.2..1.2_f64, t in 1e-3..1e4_f64) {
        let pixel = DVec2::new(u * f64::from(camera.width), v * f64::from(camera.height));
        if let Some(ray) = camera.ray(pixel) {
            prop_assert!((ray.d.length() - 1.0).abs() < 1e-14);
            prop_assert_eq!(ray.o, camera.pose.c);
            // The projection loses what the addition of a far away centre and a short way loses.
            let loss = camera.fx.max(camera.fy) * (1.0 + ray.o.length() / t) * 1e-12;
            let back = camera.project(ray.at(t));
            prop_assert!(back.is_some(), "{camera:?} {pixel}: no pixel");
            let error = (back.unwrap() - pixel).length();
            prop_assert!(error < 1e-6 + loss, "{camera:?} {pixel}: off by {error}");
        }
    }

    #[test]
    fn a_visible_point_is_on_the_ray_of_its_pixel(camera in any_camera(), a in -1.5..1.5_f64, b in -1.5..1.5_f64) {
        // Up to the fold itself the map has no inverse with derivatives: stay a little inside.
        let x = DVec3::new(a, b, 1.0);
        let prepared = Camera { pose: Pose::IDENTITY, ..camera }.prepare();
        let r = match camera.lens {
            Lens::Perspective { .. } | Lens::Fov { .. } => x.truncate().length(),
            _ => x.truncate().length().atan(),
        };
        if let (Some(pixel), true) = (prepared.project_from_camera(x), r < 0.99 * prepared.fold_radius()) {
            let want = naive_project(&camera, x);
            prop_assert!((pixel - want).length() < 1e-9 * (1.0 + want.length()), "{pixel} {want}");
            let d = prepared.direction(pixel);
            prop_assert!(d.is_some(), "{camera:?}: {pixel} has no ray, {x} is there");
            let angle = d.unwrap().cross(x.normalize()).length();
            prop_assert!(angle < 1e-8, "{camera:?}: {x} comes back {angle} rad off");
        }
    }

    #[test]
    fn resizing_scales_pixels(camera in any_camera(), width in 1..200_u32, height in 1..200_u32, u in 0.0..1.0_f64, v in 0.0..1.0_f64) {
        let small = camera.resized(width, height);
        let at = |c: &Camera| c.direction_in_camera(DVec2::new(u * f64::from(c.width), v * f64::from(c.height)));
        if let (Some(a), Some(b)) = (at(&camera), at(&small)) {
            prop_assert!((a - b).length() < 1e-9);
        }
    }
}

#[test]
fn every_lens_sees_its_whole_sample_image() {
    for (name, lens) in SAMPLES {
        let camera = sample_camera(lens);
        let table = RayTable::new(&camera);
        assert_eq!(table.valid(), 96 * 72, "{name}");
        let prepared = camera.prepare();
        for j in 0..72 {
            for i in 0..96 {
                let pixel = DVec2::new(f64::from(i) + 0.5, f64::from(j) + 0.5);
                let ray = prepared.ray(pixel).unwrap();
                let error = (prepared.project(ray.at(7.0)).unwrap() - pixel).length();
                assert!(error < 1e-9, "{name} {pixel}: {error} px");
                // f32 directions are good to 1e-7 of the focal length.
                let from_table = table.ray(&camera.pose, i, j).unwrap();
                assert!((from_table.d - ray.d).length() < 2e-7, "{name} {pixel}");
            }
        }
    }
}

#[test]
fn a_sharp_fisheye_sees_behind_itself() {
    let camera = Camera {
        lens: Lens::Fisheye { k: [0.0; 4] },
        ..Camera::pinhole(200, 200, 40.0, 40.0, 100.0, 100.0, Pose::IDENTITY)
    };
    // 2.4 rad off the axis: behind the image plane.
    let ray = camera.ray(DVec2::new(100.0 + 40.0 * 2.4, 100.0)).unwrap();
    assert!((ray.d - DVec3::new(2.4_f64.sin(), 0.0, 2.4_f64.cos())).length() < 1e-14);
    assert!((camera.project(ray.at(2.0)).unwrap().x - 196.0).abs() < 1e-9);
    assert_eq!(camera.ray(DVec2::new(100.0 + 40.0 * 3.2, 100.0)), None, "there is no angle above pi");
}
