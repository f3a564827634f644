//! From the unit cube of a field back to the world: inverse, gradients, and where the world ends.

use glam::{DMat3, DVec3};
use proptest::prelude::*;
use render_core::camera::{Camera, Pose};
use render_core::contract::{Norm, inv_contract, inv_contract_within, inv_contract_within_backward};
use render_core::ndc::Ndc;
use render_core::space_map::{FAR_GAP, SpaceMap};
use testkit::gradient::{Tolerance, check_pair, cotangent};

fn pose() -> Pose {
    Pose { r: DMat3::from_rotation_y(0.2) * DMat3::from_rotation_x(-0.1), c: DVec3::new(0.3, -0.2, 0.5) }
}

fn maps() -> [SpaceMap; 4] {
    let camera = Camera::pinhole(64, 48, 60.0, 55.0, 30.0, 25.0, pose());
    let centre = DVec3::new(0.1, 0.2, -0.3);
    [
        SpaceMap::Box { centre, radius: 12.0 },
        SpaceMap::Contracted { norm: Norm::L2, centre, radius: 2.0 },
        SpaceMap::Contracted { norm: Norm::Max, centre, radius: 2.0 },
        SpaceMap::Ndc { pose: pose(), ndc: Ndc::of_camera(&camera, 1.0) },
    ]
}

/// A point before the camera, whose depth is its largest coordinate: no ties of the largest norm.
fn any_point() -> impl Strategy<Value = DVec3> {
    [-1.0..1.0_f64, -1.0..1.0, 3.0..10.0].prop_map(|x| pose().to_world(DVec3::from(x)))
}

proptest! {
    #![proptest_config(testkit::property::cases(128))]

    #[test]
    fn the_world_comes_back_from_the_unit_cube(x in any_point()) {
        for map in maps() {
            let x32 = x.to_array().map(|v| v as f32);
            let (mut p, mut u, mut back) = ([0.0; 3], [0.0; 3], [0.0; 3]);
            map.internal(&x32, &mut p);
            map.unit(&p, &mut u);
            map.world(&u, &mut back);
            for (b, x) in back.iter().zip(&x32) {
                // A rounding of the cube's f32 is as much larger in the world as the map squeezes it: up to a hundred times.
                prop_assert!((b - x).abs() < 1e-4, "{map:?}: {x32:?} {back:?}");
            }
        }
    }

    #[test]
    fn world_backward_matches_central_differences(x in any_point(), seed in 0..1000_u64) {
        for map in maps() {
            let (mut p, mut u) = ([0.0; 3], [0.0; 3]);
            map.internal(&x.to_array().map(|v| v as f32), &mut p);
            map.unit(&p, &mut u);
            let out = check_pair(
                &u.map(f64::from),
                &cotangent(3, seed),
                |u, x| x.copy_from_slice(&map.world_point(DVec3::from_slice(u)).to_array()),
                |u, x_bar, u_bar| {
                    let bar = map.world_point_backward(DVec3::from_slice(u), DVec3::from_slice(x_bar));
                    for (to, from) in u_bar.iter_mut().zip(bar.to_array()) {
                        *to += from;
                    }
                },
                Tolerance::new(1e-6, 1e-7),
            );
            prop_assert!(out.is_ok(), "{map:?}: {}", out.unwrap_err());
        }
    }

    #[test]
    fn inverse_contraction_backward_matches_central_differences(y in [-1.9..1.9_f64, -1.9..1.9, -1.9..1.9], seed in 0..1000_u64) {
        let largest = y.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let second = y.iter().map(|v| v.abs()).filter(|v| *v < largest).fold(0.0_f64, f64::max);
        for (norm, m) in [(Norm::L2, DVec3::from(y).length()), (Norm::Max, largest)] {
            // Away from the surface of the unit ball, from the end of the world, and from ties.
            if (m - 1.0).abs() < 1e-3 || (m - 1.95).abs() < 1e-3 || largest - second < 1e-3 {
                continue;
            }
            let out = check_pair(
                &y,
                &cotangent(3, seed),
                |y, x| x.copy_from_slice(&inv_contract_within(norm, y.try_into().unwrap(), 0.05_f64)),
                |y, x_bar, y_bar| {
                    let (y, x_bar) = (y.try_into().unwrap(), x_bar.try_into().unwrap());
                    inv_contract_within_backward(norm, y, 0.05_f64, x_bar, y_bar.try_into().unwrap());
                },
                Tolerance::new(1e-6, 1e-7),
            );
            prop_assert!(out.is_ok(), "{norm:?} {y:?}: {}", out.unwrap_err());
        }
    }

    #[test]
    fn inverse_ndc_backward_matches_central_differences(p in [-1.0..1.0_f64, -1.0..1.0, -1.0..1.2], seed in 0..1000_u64) {
        let camera = Camera::pinhole(64, 48, 60.0, 55.0, 30.0, 25.0, Pose::IDENTITY);
        let ndc = Ndc::of_camera(&camera, 0.7);
        if (p[2] - 0.9).abs() < 1e-3 {
            return Ok(());
        }
        let out = check_pair(
            &p,
            &cotangent(3, seed),
            |p, x| x.copy_from_slice(&ndc.inv_point(p.try_into().unwrap(), 0.1)),
            |p, x_bar, p_bar| {
                ndc.inv_point_backward(p.try_into().unwrap(), 0.1, x_bar.try_into().unwrap(), p_bar.try_into().unwrap());
            },
            Tolerance::new(1e-6, 1e-7),
        );
        prop_assert!(out.is_ok(), "{p:?}: {}", out.unwrap_err());
    }
}

#[test]
fn the_world_ends_before_infinity_and_has_no_derivative_there() {
    let [_, ball, cube, ndc] = maps();
    // A radius of 2, and twice the near plane.
    let far = 2.0 / FAR_GAP;
    for map in [ball, cube, ndc] {
        // The middle of the far side of the cube, and beyond it.
        let centre = if matches!(map, SpaceMap::Ndc { .. }) { pose().c } else { DVec3::new(0.1, 0.2, -0.3) };
        for end in [1.0, 1.5] {
            let u = DVec3::new(0.5, 0.5, end);
            let x = map.world_point(u);
            let distance = (x - centre).length();
            assert!((distance / far - 1.0).abs() < 0.02, "{map:?}: {distance}");
            let bar = map.world_point_backward(u, DVec3::ONE);
            assert!(bar.is_finite() && bar.z == 0.0, "{map:?}: {bar}");
        }
    }
    // The plain inverse goes on.
    let far = inv_contract(Norm::Max, [0.0, 0.0, 2.0 - 1e-6_f64]);
    assert!((far[2] * 1e-6 - 1.0).abs() < 1e-6, "{far:?}");
}

#[test]
fn the_way_back_of_nothing_is_nothing() {
    for map in maps() {
        map.world(&[], &mut []);
        map.world_backward(&[], &[], &mut []);
    }
}
