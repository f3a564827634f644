//! Derivatives of projection and undistortion against central differences.

use super::lenses::{SAMPLES, sample_camera};
use glam::{DVec2, DVec3};
use render_core::camera::{Camera, CameraBar, Lens, Pose};
use testkit::gradient::{Tolerance, check_pair, cotangent};

/// The lens with its coefficients replaced, in the order of `Lens::parameters`.
fn with_parameters(lens: Lens, v: &[f64]) -> Lens {
    match lens {
        Lens::Perspective { .. } => Lens::Perspective { k: v[..6].try_into().unwrap(), p: v[6..8].try_into().unwrap() },
        Lens::Fisheye { .. } => Lens::Fisheye { k: v[..4].try_into().unwrap() },
        Lens::Fov { .. } => Lens::Fov { omega: v[0] },
        Lens::ThinPrismFisheye { .. } => Lens::ThinPrismFisheye {
            k: v[..4].try_into().unwrap(),
            p: v[4..6].try_into().unwrap(),
            s: v[6..8].try_into().unwrap(),
        },
    }
}

fn with_all(camera: &Camera, v: &[f64]) -> Camera {
    Camera { fx: v[0], fy: v[1], cx: v[2], cy: v[3], lens: with_parameters(camera.lens, &v[4..]), ..*camera }
}

#[test]
fn project_backward_matches_central_differences() {
    let points = [[0.3, -0.4, 1.2], [0.01, 0.02, 3.0], [-0.5, 0.1, 0.9], [1e-4, 0.0, 1.0]];
    for (name, lens) in SAMPLES {
        let camera = Camera { pose: Pose::IDENTITY, ..sample_camera(lens) };
        for (i, point) in points.into_iter().enumerate() {
            let mut x = point.to_vec();
            x.extend([camera.fx, camera.fy, camera.cx, camera.cy]);
            x.extend(camera.lens.parameters().map(|(_, value)| value));
            let out = check_pair(
                &x,
                &cotangent(2, i as u64),
                |x, out| {
                    let pixel = with_all(&camera, &x[3..]).prepare().project_from_camera(DVec3::from_slice(&x[..3]));
                    out.copy_from_slice(&pixel.unwrap().to_array());
                },
                |x, out_bar, x_bar| {
                    let (mut point_bar, mut bar) = (DVec3::from_slice(&x_bar[..3]), CameraBar::default());
                    bar.f = DVec2::new(x_bar[3], x_bar[4]);
                    bar.c = DVec2::new(x_bar[5], x_bar[6]);
                    bar.lens[..x.len() - 7].copy_from_slice(&x_bar[7..]);
                    let camera = with_all(&camera, &x[3..]).prepare();
                    let pixel_bar = DVec2::from_slice(out_bar);
                    camera.project_backward(DVec3::from_slice(&x[..3]), pixel_bar, &mut point_bar, &mut bar);
                    x_bar[..3].copy_from_slice(&point_bar.to_array());
                    x_bar[3..7].copy_from_slice(&[bar.f.x, bar.f.y, bar.c.x, bar.c.y]);
                    let lens = x_bar.len() - 7;
                    x_bar[7..].copy_from_slice(&bar.lens[..lens]);
                },
                Tolerance::TWIN,
            );
            out.unwrap_or_else(|e| panic!("{name}, point {i}: {e}"));
        }
    }
}

#[test]
fn direction_jacobian_matches_central_differences() {
    for (name, lens) in SAMPLES {
        let camera = sample_camera(lens).prepare();
        for (i, pixel) in
            [[49.25, 34.5], [49.26, 34.5], [10.0, 60.0], [90.0, 5.0], [55.0, 31.0]].into_iter().enumerate()
        {
            let out = check_pair(
                &pixel,
                &cotangent(3, i as u64),
                |x, out| out.copy_from_slice(&camera.direction(DVec2::from_slice(x)).unwrap().to_array()),
                |x, out_bar, x_bar| {
                    let (_, columns) = camera.direction_jacobian(DVec2::from_slice(x)).unwrap();
                    for (x_bar, column) in x_bar.iter_mut().zip(columns) {
                        *x_bar += column.dot(DVec3::from_slice(out_bar));
                    }
                },
                Tolerance::new(1e-7, 1e-9),
            );
            out.unwrap_or_else(|e| panic!("{name}, pixel {i}: {e}"));
        }
    }
}

#[test]
fn a_fisheye_is_differentiable_on_its_axis_and_behind_itself() {
    let camera = Camera { pose: Pose::IDENTITY, ..sample_camera(Lens::Fisheye { k: [0.0; 4] }) }.prepare();
    let (_, axis) = camera.projection_jacobian(DVec3::new(0.0, 0.0, 2.0)).unwrap();
    let want = [DVec2::new(61.0 / 2.0, 0.0), DVec2::new(0.0, 58.5 / 2.0), DVec2::ZERO];
    for (got, want) in axis.into_iter().zip(want) {
        assert!((got - want).length() < 1e-12, "{got} {want}");
    }
    let x = DVec3::new(0.8, -0.3, -0.5);
    let (_, columns) = camera.projection_jacobian(x).unwrap();
    for (axis, column) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().zip(columns) {
        let at = |h: f64| camera.project_from_camera(x + axis * h).unwrap();
        let want = (at(1e-6) - at(-1e-6)) / 2e-6;
        assert!((column - want).length() < 1e-6, "{column} {want}");
    }
}

#[test]
fn points_without_a_pixel_have_no_gradient() {
    let camera = sample_camera(Lens::PINHOLE).prepare();
    let (mut x_bar, mut bar) = (DVec3::ONE, CameraBar::default());
    camera.project_backward(DVec3::new(0.0, 0.0, -1.0), DVec2::ONE, &mut x_bar, &mut bar);
    assert_eq!((x_bar, bar), (DVec3::ONE, CameraBar::default()));
}
