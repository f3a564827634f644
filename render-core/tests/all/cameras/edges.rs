//! Folds, poles, points behind the camera, NaN and extremes.

use super::lenses::{SAMPLES, sample_camera};
use glam::{DVec2, DVec3};
use render_core::camera::{Camera, ColmapModel, Lens, Pose, RayTable};
use render_core::error::CameraError;

fn wide(lens: Lens) -> Camera {
    Camera { lens, ..Camera::pinhole(300, 200, 100.0, 100.0, 150.0, 100.0, Pose::IDENTITY) }
}

#[test]
fn pixels_past_the_fold_have_no_ray_and_points_past_it_no_pixel() {
    // r - 0.3 r^3 turns at r = 1 / sqrt(0.9), where it is 0.7027.
    let camera = wide(Lens::Perspective { k: [-0.3, 0.0, 0.0, 0.0, 0.0, 0.0], p: [0.0; 2] });
    let fold = 1.0 / 0.9_f64.sqrt();
    assert!((camera.prepare().fold_radius() - fold).abs() < 1e-12);
    let edge = fold * (1.0 - 0.3 * fold * fold);
    for angle in [0.0_f64, 0.7, 2.0, 4.0] {
        let at = |r: f64| DVec2::new(150.0 + 100.0 * r * angle.cos(), 100.0 + 100.0 * r * angle.sin());
        assert!(camera.ray(at(edge * 0.999)).is_some());
        assert_eq!(camera.ray(at(edge * 1.001)), None);
        let point = |r: f64| DVec3::new(r * angle.cos(), r * angle.sin(), 1.0);
        assert!(camera.project(point(fold * 0.999)).is_some());
        assert_eq!(camera.project(point(fold * 1.001)), None);
    }
    // The corners of the image (r_d = 1.8) are past it: the table says so.
    let table = RayTable::new(&camera);
    assert_eq!(table.direction(0, 0), None);
    assert!(table.direction(150, 100).is_some());
    assert!(table.valid() > 10_000 && table.valid() < 60_000, "{}", table.valid());
}

#[test]
fn a_pole_of_the_rational_model_is_a_fold() {
    // The denominator 1 - 0.5 r^2 is 0 at r = sqrt(2).
    let prepared = wide(Lens::Perspective { k: [0.0, 0.0, 0.0, -0.5, 0.0, 0.0], p: [0.0; 2] }).prepare();
    assert!(prepared.fold_radius() <= 2.0_f64.sqrt() && prepared.fold_radius() > 1.4);
    assert_eq!(prepared.project_from_camera(DVec3::new(1.5, 0.0, 1.0)), None);
    assert!(prepared.direction(DVec2::new(1e5, 100.0)).is_some(), "everything out to infinity is seen within it");
}

#[test]
fn tangential_terms_do_not_hide_a_fold() {
    // Strong p: the map folds left of the centre although its radial part is the identity.
    let prepared = wide(Lens::Perspective { k: [0.0; 6], p: [0.0, 0.3] }).prepare();
    for i in 0..300 {
        let pixel = DVec2::new(f64::from(i), 100.0);
        if let Some(d) = prepared.direction(pixel) {
            assert!((prepared.project_from_camera(d).unwrap() - pixel).length() < 1e-6);
        }
    }
    // x + 0.9 x^2 turns at x = -0.556, where it is -0.278.
    assert!(prepared.direction(DVec2::new(150.0 - 27.0, 100.0)).is_some());
    assert_eq!(prepared.direction(DVec2::new(150.0 - 29.0, 100.0)), None);
    assert_eq!(prepared.project_from_camera(DVec3::new(-0.6, 0.0, 1.0)), None);
    assert!((prepared.fold_radius() - 1.0 / 1.8).abs() < 1e-12);
}

#[test]
fn weak_tangential_terms_do_not_move_a_fold_to_a_later_one() {
    // 1 + 3 k1 r^2 + 5 k2 r^4 + 7 k3 r^6 has roots at 0.97, 3.31 and 6.27: only the first is a fold to stop at.
    let k = [-0.39179486567795946, 0.025250242935355643, -0.00035300368875816433, 0.0, 0.0, 0.0];
    let at = |p: [f64; 2]| wide(Lens::Perspective { k, p }).prepare();
    let stretch = |r: f64| 1.0 + r * r * (3.0 * k[0] + r * r * (5.0 * k[1] + r * r * 7.0 * k[2]));
    let radial = at([0.0; 2]).fold_radius();
    assert!(stretch(radial - 1e-9) > 0.0 && stretch(radial + 1e-9) < 0.0 && radial < 1.0, "{radial}");

    let p2 = -0.0029670965051608587;
    for p in [[0.0, p2], [p2, 0.0], [0.0, 1e-12]] {
        let prepared = at(p);
        let fold = prepared.fold_radius();
        let bend = 6.0 * p[0].hypot(p[1]);
        assert!((stretch(fold) - bend * fold).abs() < 1e-9, "{p:?}: {fold}");
        assert!(fold <= radial && fold > radial - 0.02, "{p:?}: {fold}, {radial} without p");
        assert_eq!(prepared.project_from_camera(DVec3::new(1.4763273617908201, 0.0, 1.0)), None);
        for angle in [0.0_f64, 1.0, 2.5, 4.0, 5.5] {
            let point = |r: f64| DVec3::new(r * angle.cos(), r * angle.sin(), 1.0);
            assert_eq!(prepared.project_from_camera(point(fold * 1.001)), None);
            // Newton's last steps are slow here: it must not stop short and lose the point.
            for near in [0.9, 0.99, 0.999] {
                let inside = point(fold * near);
                let pixel = prepared.project_from_camera(inside).unwrap();
                let back = prepared.direction(pixel).unwrap();
                assert!(back.cross(inside.normalize()).length() < 1e-8, "{p:?}, {angle}, {near}: {back}");
            }
        }
    }
}

#[test]
fn nothing_behind_a_perspective_camera_is_seen() {
    for (name, lens) in SAMPLES {
        let camera = Camera { pose: Pose::IDENTITY, ..sample_camera(lens) };
        if matches!(lens, Lens::Fisheye { .. } | Lens::ThinPrismFisheye { .. }) {
            continue;
        }
        for x in [DVec3::new(0.1, 0.1, -1.0), DVec3::new(1.0, 0.0, 0.0), DVec3::ZERO, DVec3::new(1.0, 0.0, 1e-9)] {
            assert_eq!(camera.project(x), None, "{name} {x}");
        }
    }
}

#[test]
fn poisoned_input_gives_none_and_never_panics() {
    let bad = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
    for (name, lens) in SAMPLES {
        let camera = sample_camera(lens);
        for b in bad {
            assert_eq!(camera.ray(DVec2::new(b, 3.0)), None, "{name} {b}");
            assert_eq!(camera.ray(DVec2::new(3.0, b)), None, "{name} {b}");
            for x in [DVec3::new(b, 0.0, 1.0), DVec3::new(0.0, b, 1.0), DVec3::new(0.0, 0.0, b)] {
                assert_eq!(camera.project(x), None, "{name} {x}");
            }
        }
        for huge in [1e30, 1e300, f64::MAX] {
            for pixel in [DVec2::new(huge, -huge), DVec2::splat(huge)] {
                assert!(camera.ray(pixel).is_none_or(|ray| ray.d.is_finite()), "{name} {pixel}");
            }
            for x in [DVec3::splat(huge), DVec3::new(huge, 1.0, huge)] {
                assert!(camera.project(x).is_none_or(|p| p.is_finite()), "{name} {x}");
            }
        }
        // Lenses no one made: any coefficients may be read from a file.
        for k in [-1e30, -1.0, 1e30, f64::MAX] {
            let odd = [
                Lens::Perspective { k: [k; 6], p: [k; 2] },
                Lens::Fisheye { k: [k; 4] },
                Lens::ThinPrismFisheye { k: [k; 4], p: [k; 2], s: [k; 2] },
            ];
            for lens in odd {
                let camera = Camera { lens, ..camera };
                let ray = camera.ray(DVec2::new(10.0, 10.0));
                assert!(ray.is_none_or(|ray| ray.d.is_finite() && (ray.d.length() - 1.0).abs() < 1e-9));
                let pixel = camera.project(camera.pose.to_world(DVec3::new(0.1, 0.2, 1.0)));
                assert!(pixel.is_none_or(|p| p.is_finite()));
            }
        }
    }
}

#[test]
fn empty_images_have_empty_tables() {
    let camera = Camera::pinhole(0, 0, 1.0, 1.0, 0.0, 0.0, Pose::IDENTITY);
    let table = RayTable::new(&camera);
    assert!(table.directions().is_empty());
    assert_eq!((table.size(), table.valid(), table.direction(0, 0)), ((0, 0), 0, None));
    assert_eq!(camera.check(), Err(CameraError::EmptyImage { width: 0, height: 0 }));
}

#[test]
fn colmap_models_are_the_definitions() {
    let names = "SIMPLE_PINHOLE PINHOLE SIMPLE_RADIAL RADIAL OPENCV OPENCV_FISHEYE FULL_OPENCV FOV \
                 SIMPLE_RADIAL_FISHEYE RADIAL_FISHEYE THIN_PRISM_FISHEYE";
    for (id, name) in names.split_whitespace().enumerate() {
        let model = ColmapModel::from_name(name).unwrap();
        assert_eq!((model.id(), model.name(), ColmapModel::from_id(id as u32)), (id as u32, name, Some(model)));
        // Numbers 1, 2, 3, ... in file order land where the definition has them.
        let parameters: Vec<f64> = (1..=model.parameter_names().len()).map(|v| v as f64).collect();
        let parameters = if model == ColmapModel::Fov { vec![1.0, 2.0, 3.0, 4.0, 0.5] } else { parameters };
        let camera = model.camera(64, 48, &parameters, Pose::IDENTITY).unwrap();
        let by_name = |name: &str| {
            let names = model.parameter_names();
            names.iter().position(|&n| n == name).map(|i| parameters[i])
        };
        assert_eq!(Some(camera.fx), by_name("fx").or(by_name("f")));
        assert_eq!(Some(camera.fy), by_name("fy").or(by_name("f")));
        assert_eq!((Some(camera.cx), Some(camera.cy)), (by_name("cx"), by_name("cy")));
        for (parameter, value) in camera.lens.parameters() {
            let simple = if parameter == "k1" { by_name("k") } else { None };
            assert_eq!(value, by_name(parameter).or(simple).unwrap_or(0.0), "{name} {parameter}");
        }
        let (described, again) = ColmapModel::describe(&camera);
        let back = described.camera(64, 48, &again, Pose::IDENTITY).unwrap();
        assert_eq!(back, camera, "{name} as {}", described.name());

        let short = model.camera(64, 48, &parameters[1..], Pose::IDENTITY).unwrap_err();
        let want = format!("camera model {name} takes {} parameters, {} given", parameters.len(), parameters.len() - 1);
        assert_eq!(short.to_string(), want);
    }
    assert_eq!(ColmapModel::from_name("SIMPLE_DIVISION"), None);
    assert_eq!(ColmapModel::from_id(11), None);
}

#[test]
fn cameras_that_cannot_see_are_refused_by_name() {
    let good = sample_camera(SAMPLES[3].1);
    assert_eq!(good.check(), Ok(()));
    let error = |camera: Camera| camera.check().unwrap_err().to_string();
    assert_eq!(error(Camera { fx: 0.0, ..good }), "focal length fx = 0, expected more than 0");
    assert_eq!(error(Camera { fy: -3.5, ..good }), "focal length fy = -3.5, expected more than 0");
    assert_eq!(error(Camera { cy: f64::NAN, ..good }), "camera parameter cy is NaN or infinite");
    let lens = Lens::Fisheye { k: [0.0, f64::INFINITY, 0.0, 0.0] };
    assert_eq!(error(Camera { lens, ..good }), "camera parameter k2 is NaN or infinite");
    let lens = Lens::Fov { omega: 4.0 };
    assert_eq!(error(Camera { lens, ..good }), "omega = 4 of the FOV model, expected an angle in (-pi, pi)");
}

#[test]
fn cameras_with_numbers_that_no_camera_has_are_refused_with_the_range() {
    let good = Camera::pinhole(64, 48, 50.0, 50.0, 32.0, 24.0, Pose::IDENTITY);
    let error = |camera: Camera| camera.check().unwrap_err().to_string();
    assert_eq!(error(Camera { cx: 1e308, ..good }), "camera parameter cx = 1e308, expected -6.4e7 to 6.4e7");
    assert_eq!(error(Camera { fy: 1e-9, ..good }), "camera parameter fy = 1e-9, expected 6.4e-3 to 6.4e7");
    assert_eq!(error(Camera { fx: 1e9, ..good }), "camera parameter fx = 1e9, expected 6.4e-3 to 6.4e7");
    let lens = Lens::Fisheye { k: [0.0, 0.0, -1e200, 0.0] };
    assert_eq!(error(Camera { lens, ..good }), "camera parameter k3 = -1e200, expected -1e12 to 1e12");
    let pose = Pose { c: DVec3::new(0.0, 3e40, 0.0), ..Pose::IDENTITY };
    assert_eq!(error(Camera { pose, ..good }), "camera parameter centre y = 3e40, expected -1e12 to 1e12");
    let pose = Pose { c: DVec3::new(0.0, 0.0, f64::NAN), ..Pose::IDENTITY };
    assert_eq!(error(Camera { pose, ..good }), "camera parameter centre z is NaN or infinite");
    // A long lens far off the middle, a fisheye, a camera on a map in millimetres: all good.
    let pose = Pose { c: DVec3::new(4e9, -5e9, 1e6), ..Pose::IDENTITY };
    for camera in [Camera { fx: 6e4, fy: 6e4, cx: -3e4, pose, ..good }, Camera { fx: 0.1, fy: 0.1, ..good }] {
        assert_eq!(camera.check(), Ok(()));
    }
}

#[test]
fn cone_radius_of_a_pinhole_is_the_pixel_pitch() {
    let camera = Camera::pinhole(64, 48, 50.0, 50.0, 32.0, 24.0, Pose::IDENTITY);
    let prepared = camera.prepare();
    let want = 2.0 / 12.0_f64.sqrt() / 50.0;
    assert!((prepared.cone_radius(DVec2::new(32.0, 24.0)).unwrap() - want).abs() < 1e-12);
    // Unit directions: less by the cosine at the edge. The last column uses the pixel beyond it.
    let edge = DVec2::new(63.5, 24.0);
    let cos = camera.direction_in_camera(edge).unwrap().z;
    assert!((prepared.cone_radius(edge).unwrap() - want * cos).abs() < 1e-12);
}
