//! The gradient of a photo's loss with respect to its camera, against differences of the definition in `f64`.

use super::gradient_tests::{FRAME, Point, Shared, Twin, noise, system as system_of};
use super::pass::ViewSpaceGradient;
use crate::gradients::CameraGradients;
use crate::plan::made;
use testkit::reference::splats as reference;

/// The camera with number `k` moved by `by`: a twist of the world-to-camera transform from the left, in units of the frame, or
/// intrinsics.
fn moved(camera: &reference::Camera, k: usize, by: f64) -> reference::Camera {
    let mut out = *camera;
    match k {
        0..3 => {
            let (sin, cos) = by.sin_cos();
            let (i, j) = ((k + 1) % 3, (k + 2) % 3);
            let (r, t) = (camera.r, camera.t);
            out.r[i] = [0, 1, 2].map(|column| cos * r[i][column] - sin * r[j][column]);
            out.r[j] = [0, 1, 2].map(|column| sin * r[i][column] + cos * r[j][column]);
            (out.t[i], out.t[j]) = (cos * t[i] - sin * t[j], sin * t[i] + cos * t[j]);
        }
        3..6 => out.t[k - 3] += by,
        6..8 => out.f[k - 6] += by,
        _ => out.c[k - 8] += by,
    }
    out
}

#[test]
fn the_gradient_with_respect_to_the_camera_is_that_of_differences() {
    let (_, data) = made::scene(noise(), Vec::new());
    for index in 0..data.len() {
        let mut system = system_of(&data, &Shared::default(), ViewSpaceGradient::Plain);
        let at = Point::of(&system);
        let got = system.camera_gradient(&data, index, 0).unwrap();
        let twin = Twin::new(&data, index);
        let want = twin.loss(&at);
        assert!((got.loss - want).abs() < 1e-5 * want, "loss {} for {want}", got.loss);
        let camera = &got.camera;
        let flat = [&camera.xi[..], &camera.f, &camera.c].concat();
        let want: Vec<f64> = (0..flat.len())
            .map(|k| {
                // Radians, units of the scene, pixels.
                let h = if k < 6 { 1e-6 } else { 1e-4 };
                let scale = if (3..6).contains(&k) { FRAME.scale } else { 1.0 };
                let along = |h: f64| twin.from(moved(&twin.camera, k, h / scale)).loss(&at);
                (along(h) - along(-h)) / (2.0 * h)
            })
            .collect();
        for kind in [0..3, 3..6, 6..8, 8..10] {
            let largest = want[kind.clone()].iter().fold(0.0_f64, |most, x| most.max(x.abs()));
            assert!(largest > 1e-6, "{kind:?}: {want:?}");
            for (got, want) in flat[kind.clone()].iter().zip(&want[kind.clone()]) {
                assert!((got - want).abs() < 2e-3 * largest, "view {index}, {kind:?}: {got} for {want} of {largest}");
            }
        }
    }
}

#[test]
fn smaller_photos_say_how_the_camera_at_full_size_should_change() {
    let (_, data) = made::scene(noise(), Vec::new());
    let mut system = system_of(&data, &Shared::default(), ViewSpaceGradient::Plain);
    (system.parts.pictures.coarse, system.parts.pictures.coarse_steps) = (1, 1000);
    let small = system.camera_gradient(&data, 1, 0).unwrap();
    let half = data.at_level(1);
    let mut other = system_of(&half, &Shared::default(), ViewSpaceGradient::Plain);
    let own = other.camera_gradient(&half, 1, 0).unwrap();
    assert_eq!((small.loss, small.camera.xi), (own.loss, own.camera.xi));
    // The focal length of a picture of half the size is half as long.
    assert_eq!(small.camera.f.map(|f| 2.0 * f), own.camera.f);
    assert_eq!(small.camera.c.map(|c| 2.0 * c), own.camera.c);
    assert!(system.camera_gradient(&data, data.len(), 0).is_err(), "there is no such photo");
}

#[test]
fn asking_for_the_camera_changes_no_bit_of_the_training() {
    let (_, data) = made::scene(noise(), Vec::new());
    let trained = |ask: bool| {
        let mut system = system_of(&data, &Shared::default(), ViewSpaceGradient::Plain);
        for cloud in &mut system.parts.clouds {
            (cloud.training.rates.lr_mean, cloud.training.rates.lr_dc) = (1e-3, 1e-2);
        }
        for step in 0..4 {
            system.train_step(&data, step).unwrap();
            if ask {
                system.camera_gradient(&data, (step as usize + 1) % data.len(), step).unwrap();
            }
        }
        system.parts.clouds.into_iter().map(|cloud| cloud.parameters).collect::<Vec<_>>()
    };
    assert_eq!(trained(true), trained(false));
}
