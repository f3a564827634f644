//! NDC: forward, inverse, rays and derivatives, with any principal point and two focal lengths.

use glam::DVec3;
use proptest::prelude::*;
use render_core::camera::{Camera, Pose};
use render_core::ndc::{Ndc, NdcRay};
use testkit::gradient::{PairTolerances, Tolerance, check_f32_pair, check_pair, cotangent};

fn any_ndc() -> impl Strategy<Value = (Camera, f64)> {
    (20.0..200.0_f64, 20.0..200.0_f64, 20.0..44.0_f64, 10.0..38.0_f64, 0.1..3.0_f64)
        .prop_map(|(fx, fy, cx, cy, near)| (Camera::pinhole(64, 48, fx, fy, cx, cy, Pose::IDENTITY), near))
}

/// Origin anywhere, direction forward.
fn any_forward_ray() -> impl Strategy<Value = ([f64; 3], [f64; 3])> {
    ([-2.0..2.0_f64, -2.0..2.0, -4.0..4.0], [-1.0..1.0_f64, -1.0..1.0, -2.0..-0.2])
}

proptest! {
    #![proptest_config(testkit::property::cases(128))]

    #[test]
    fn inv_point_inverts_point((camera, near) in any_ndc(), x in -5.0..5.0_f64, y in -5.0..5.0_f64, depth in 1.0..500.0_f64) {
        let ndc = Ndc::of_camera(&camera, near);
        let x = [x, y, -depth * near];
        let back = ndc.inv_point(ndc.point(x), 1e-9);
        for (b, x) in back.iter().zip(&x) {
            prop_assert!((b - x).abs() < 1e-11 * depth * (1.0 + x.abs()), "{back:?}");
        }
    }

    #[test]
    fn the_frustum_is_the_cube((camera, near) in any_ndc(), u in 0.0..1.0_f64, v in 0.0..1.0_f64, depth in 1.0..500.0_f64) {
        // The pixel of a point, from the left and upper edge, is X from -1 and Y from 1.
        let ndc = Ndc::of_camera(&camera, near);
        let d = camera.direction_in_camera(glam::DVec2::new(64.0 * u, 48.0 * v)).unwrap();
        let x = d / d.z * depth * near;
        let p = ndc.point([x.x, -x.y, -x.z]);
        let want = [2.0 * u - 1.0, 1.0 - 2.0 * v, 1.0 - 2.0 / depth];
        for (p, w) in p.iter().zip(&want) {
            prop_assert!((p - w).abs() < 1e-11, "{p:?} {want:?}");
        }
    }

    #[test]
    fn points_of_the_ray_are_on_the_ndc_ray((camera, near) in any_ndc(), (o, d) in any_forward_ray(), t in 0.0..1e3_f64) {
        let ndc = Ndc::of_camera(&camera, near);
        let ray = ndc.ray(o, d).unwrap();
        prop_assert_eq!((ray.o[2], ray.d[2]), (-1.0, 2.0));
        let x: [f64; 3] = std::array::from_fn(|a| o[a] + t * d[a]);
        if x[2] >= -0.05 * near {
            return Ok(());
        }
        let s = ndc.s_at(o[2], d[2], t);
        let p = ndc.point(x);
        for a in 0..3 {
            prop_assert!((ray.o[a] + s * ray.d[a] - p[a]).abs() < 1e-9 * (1.0 + p[a].abs()) / -x[2].max(-1.0), "{ray:?} {p:?}");
        }
        prop_assert!((ndc.t_at(o[2], d[2], s) - t).abs() < 1e-9 * (1.0 + t * t / near));
    }

    #[test]
    fn ray_backward_matches_central_differences((camera, near) in any_ndc(), (o, d) in any_forward_ray(), seed in 0..1000_u64) {
        let (double, single) = (Ndc::<f64>::of_camera(&camera, near), Ndc::<f32>::of_camera(&camera, near));
        macro_rules! pair {
            ($ndc:expr, $ty:ty) => {(
                |x: &[$ty], out: &mut [$ty]| {
                    let ray = $ndc.ray(x[..3].try_into().unwrap(), x[3..].try_into().unwrap()).unwrap();
                    out[..3].copy_from_slice(&ray.o);
                    out[3..].copy_from_slice(&ray.d);
                },
                |x: &[$ty], out_bar: &[$ty], x_bar: &mut [$ty]| {
                    let bar = NdcRay { o: out_bar[..3].try_into().unwrap(), d: out_bar[3..].try_into().unwrap() };
                    let (o, d) = (x[..3].try_into().unwrap(), x[3..].try_into().unwrap());
                    let (o_bar, d_bar) = x_bar.split_at_mut(3);
                    $ndc.ray_backward(o, d, &bar, o_bar.try_into().unwrap(), d_bar.try_into().unwrap());
                },
            )};
        }
        let x: Vec<f32> = o.iter().chain(&d).map(|&v| v as f32).collect();
        let out_bar: Vec<f32> = cotangent(6, seed).into_iter().map(|v| v as f32).collect();
        let out = check_f32_pair(&x, &out_bar, pair!(single, f32), pair!(double, f64), PairTolerances::default());
        prop_assert!(out.is_ok(), "{}", out.unwrap_err());
    }

    #[test]
    fn point_backward_matches_central_differences((camera, near) in any_ndc(), x in [-3.0..3.0_f64, -3.0..3.0, -20.0..-1.0], seed in 0..1000_u64) {
        let ndc = Ndc::of_camera(&camera, near);
        let out = check_pair(
            &x,
            &cotangent(3, seed),
            |x, p| p.copy_from_slice(&ndc.point(x.try_into().unwrap())),
            |x, p_bar, x_bar| {
                ndc.point_backward(x.try_into().unwrap(), p_bar.try_into().unwrap(), x_bar.try_into().unwrap());
            },
            Tolerance::TWIN,
        );
        prop_assert!(out.is_ok(), "{}", out.unwrap_err());
    }
}

#[test]
fn rays_beside_the_image_plane_have_none() {
    let ndc = Ndc::centred(64, 48, 60.0, 1.0_f64);
    for d in [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, -1e-7], [0.0; 3], [f64::NAN, 0.0, -1.0]] {
        assert_eq!(ndc.ray([0.0, 0.0, 0.5], d), None, "{d:?}");
        let bar = NdcRay { o: [1.0; 3], d: [1.0; 3] };
        let (mut o_bar, mut d_bar) = ([0.5; 3], [0.5; 3]);
        ndc.ray_backward([0.0, 0.0, 0.5], d, &bar, &mut o_bar, &mut d_bar);
        assert_eq!((o_bar, d_bar), ([0.5; 3], [0.5; 3]));
    }
    assert!(ndc.ray([0.0, 0.0, 0.5], [1.0, 0.0, -2e-3]).is_some());
}

#[test]
fn the_depth_behind_the_last_representable_disparity_is_capped() {
    let ndc = Ndc::centred(64, 48, 60.0, 1.0_f32);
    for z in [0.9995, 1.0, 5.0] {
        let x = ndc.inv_point([0.1, -0.1, z], 1e-3);
        assert!((x[2] + 2000.0).abs() < 0.2 && x.iter().all(|v| v.is_finite()), "{x:?}");
    }
}

#[test]
fn the_reference_ray_starts_at_its_pixel() {
    let camera = Camera::pinhole(64, 48, 60.0, 60.0, 32.0, 24.0, Pose::IDENTITY);
    let ray = camera.ray(glam::DVec2::new(48.0, 12.0)).unwrap();
    let d = DVec3::new(ray.d.x, -ray.d.y, -ray.d.z);
    let ndc = Ndc::of_camera(&camera, 1.0).ray([0.0; 3], d.to_array()).unwrap();
    // Through the camera's own centre: X and Y don't change along the ray.
    let want = NdcRay { o: [0.5, 0.5, -1.0], d: [0.0, 0.0, 2.0] };
    for (got, want) in ndc.o.iter().chain(&ndc.d).zip(want.o.iter().chain(&want.d)) {
        assert!((got - want).abs() < 1e-14, "{ndc:?}");
    }
}
