//! Induced flow: the expected point and its projection against `f64` twins and differences, and motion whose flow is known.

use glam::{DMat3, DQuat, DVec2, DVec3};
use proptest::prelude::*;
use render_core::camera::{Camera, Pose};
use render_core::contract::Norm;
use render_core::induced_flow::{
    Coordinates, NeighbourBar, Neighbours, Rest, SMALLEST_SUM, expected_points, expected_points_backward,
    flow_of_point, flow_of_point_backward, induced_flow, induced_flow_backward,
};
use render_core::ndc::Ndc;
use render_core::space_map::SpaceMap;
use testkit::gradient::{PairTolerances, Tolerance, check_f32_pair, check_pair, cotangent};

fn camera() -> Camera {
    let pose = Pose { r: DMat3::from_rotation_y(0.1) * DMat3::from_rotation_x(-0.05), c: DVec3::new(0.2, -0.1, 0.3) };
    Camera::pinhole(64, 48, 60.0, 55.0, 31.0, 25.0, pose)
}

/// Maps of a world whose points have z between 3 and 10 and smaller x and y.
fn maps() -> [SpaceMap; 4] {
    [
        SpaceMap::Box { centre: DVec3::ZERO, radius: 12.0 },
        SpaceMap::Contracted { norm: Norm::L2, centre: DVec3::ZERO, radius: 2.0 },
        SpaceMap::Contracted { norm: Norm::Max, centre: DVec3::ZERO, radius: 2.0 },
        SpaceMap::Ndc { pose: Pose::IDENTITY, ndc: Ndc::of_camera(&camera(), 1.0) },
    ]
}

fn unit_of(map: &SpaceMap, x: DVec3) -> DVec3 {
    let (mut p, mut u) = ([0.0; 3], [0.0; 3]);
    map.internal(&x.to_array().map(|v| v as f32), &mut p);
    map.unit(&p, &mut u);
    DVec3::from(u.map(f64::from))
}

/// A camera moved by a small twist in the world, with other intrinsics: `omega`, `v`, `fx`, `fy`, `cx`, `cy`.
fn changed(camera: &Camera, x: &[f64]) -> Camera {
    let r = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::from_slice(x)));
    let pose = Pose { r: r * camera.pose.r, c: r * camera.pose.c + DVec3::from_slice(&x[3..]) };
    Camera { pose, fx: x[6], fy: x[7], cx: x[8], cy: x[9], ..*camera }
}

/// Offsets, positions `[3][n]` and weights of rays with at most one unit of weight, none of them bare.
fn any_rays() -> impl Strategy<Value = (Vec<u32>, Vec<f32>, Vec<f32>)> {
    prop::collection::vec(1_u32..6, 1..5).prop_flat_map(|lengths| {
        let mut offsets = vec![0];
        for n in &lengths {
            offsets.push(offsets[offsets.len() - 1] + n);
        }
        let n = lengths.iter().sum::<u32>() as usize;
        (Just(offsets), prop::collection::vec(-2.0_f32..2.0, 3 * n), prop::collection::vec(0.02_f32..0.2, n))
    })
}

/// The expected points from their definition.
fn expected_twin(offsets: &[u32], x: &[f64], w: &[f64], rest: Rest<'_>) -> Vec<f64> {
    let (n, rays) = (w.len(), offsets.len() - 1);
    let mut p = vec![0.0; 3 * rays];
    for r in 0..rays {
        let span = offsets[r] as usize..offsets[r + 1] as usize;
        let sum: f64 = w[span.clone()].iter().sum();
        for a in 0..3 {
            let total: f64 = span.clone().map(|i| w[i] * x[a * n + i]).sum();
            p[a * rays + r] = match rest {
                Rest::Dropped => total,
                Rest::Shared => total / sum.max(SMALLEST_SUM),
                Rest::AtEnd(end) => total + (1.0 - sum) * f64::from(end[a * rays + r]),
            };
        }
    }
    p
}

proptest! {
    #![proptest_config(testkit::property::cases(64))]

    #[test]
    fn expected_points_match_their_definition((offsets, x, w) in any_rays(), seed in 0..1000_u64) {
        let (n, rays) = (w.len(), offsets.len() - 1);
        let end: Vec<f32> = (0..3 * rays).map(|i| 3.0 + 0.5 * i as f32).collect();
        let both: Vec<f32> = x.iter().chain(&w).copied().collect();
        let bar: Vec<f32> = cotangent(3 * rays, seed).into_iter().map(|v| v as f32).collect();
        for rest in [Rest::Dropped, Rest::Shared, Rest::AtEnd(&end)] {
            let out = check_f32_pair(
                &both,
                &bar,
                (
                    |both: &[f32], p: &mut [f32]| expected_points(&offsets, &both[..3 * n], &both[3 * n..], rest, p),
                    |both: &[f32], p_bar: &[f32], both_bar: &mut [f32]| {
                        let (x_bar, w_bar) = both_bar.split_at_mut(3 * n);
                        expected_points_backward(&offsets, &both[..3 * n], &both[3 * n..], rest, p_bar, x_bar, w_bar);
                    },
                ),
                (
                    |both: &[f64], p: &mut [f64]| p.copy_from_slice(&expected_twin(&offsets, &both[..3 * n], &both[3 * n..], rest)),
                    |both: &[f64], p_bar: &[f64], both_bar: &mut [f64]| {
                        // By the definition, ray by ray, of all it depends on.
                        let p = expected_twin(&offsets, &both[..3 * n], &both[3 * n..], rest);
                        for r in 0..rays {
                            let span = offsets[r] as usize..offsets[r + 1] as usize;
                            let sum: f64 = both[3 * n..][span.clone()].iter().sum();
                            for (a, i) in (0..3).flat_map(|a| span.clone().map(move |i| (a, i))) {
                                let bar = p_bar[a * rays + r];
                                let (scale, from) = match rest {
                                    Rest::Dropped => (1.0, 0.0),
                                    Rest::Shared => (1.0 / sum, p[a * rays + r]),
                                    Rest::AtEnd(end) => (1.0, f64::from(end[a * rays + r])),
                                };
                                both_bar[a * n + i] += scale * both[3 * n + i] * bar;
                                both_bar[3 * n + i] += scale * (both[a * n + i] - from) * bar;
                            }
                        }
                    },
                ),
                PairTolerances { twin: Tolerance::new(1e-6, 1e-7), ..PairTolerances::default() },
            );
            prop_assert!(out.is_ok(), "{rest:?}: {}", out.unwrap_err());
        }
    }

    #[test]
    fn flow_of_a_point_matches_central_differences(x in [-1.0..1.0_f64, -1.0..1.0, 3.0..10.0], seed in 0..1000_u64) {
        let camera = camera();
        let pixel = DVec2::new(20.5, 30.5);
        let spaces = maps();
        let mut all = vec![(Coordinates::World, DVec3::from(x))];
        all.extend(spaces.iter().map(|map| (Coordinates::Unit(map), unit_of(map, DVec3::from(x)))));
        for (coordinates, p) in all {
            let mut start = p.to_array().to_vec();
            start.extend([0.0; 6]);
            start.extend([camera.fx, camera.fy, camera.cx, camera.cy]);
            let out = check_pair(
                &start,
                &cotangent(2, seed),
                |x, flow| {
                    let camera = changed(&camera, &x[3..]).prepare();
                    let found = flow_of_point(DVec3::from_slice(x), coordinates, &camera, 1e-6, pixel).unwrap();
                    flow.copy_from_slice(&found.to_array());
                },
                |x, flow_bar, x_bar| {
                    let camera = changed(&camera, &x[3..]).prepare();
                    let mut bar = NeighbourBar::default();
                    let (p, flow_bar) = (DVec3::from_slice(x), DVec2::from_slice(flow_bar));
                    let p_bar = flow_of_point_backward(p, coordinates, &camera, 1e-6, flow_bar, &mut bar);
                    let optics = [bar.camera.f.x, bar.camera.f.y, bar.camera.c.x, bar.camera.c.y];
                    let twist = bar.pose.twist(&camera.camera().pose);
                    for (to, from) in x_bar.iter_mut().zip(p_bar.to_array().into_iter().chain(twist).chain(optics)) {
                        *to += from;
                    }
                },
                Tolerance::new(1e-6, 1e-6),
            );
            prop_assert!(out.is_ok(), "{coordinates:?}: {}", out.unwrap_err());
        }
    }

    #[test]
    fn batches_are_loops_of_points(xs in prop::collection::vec([-1.0..1.0_f32, -1.0..1.0, -4.0..10.0], 0..9), seed in 0..1000_u64) {
        let rays = xs.len();
        let p: Vec<f32> = (0..3).flat_map(|a| xs.iter().map(move |x| x[a])).collect();
        let other = Camera { pose: Pose { c: DVec3::new(-0.4, 0.0, 0.1), ..Pose::IDENTITY }, ..camera() };
        let cameras = [camera().prepare(), other.prepare()];
        let of_ray: Vec<u32> = (0..rays as u32).map(|r| r % 2).collect();
        let neighbours = Neighbours { cameras: &cameras, of_ray: &of_ray, z_min: 0.5 };
        let pixels: Vec<[f32; 2]> = (0..rays).map(|r| [r as f32 + 0.5, 10.5]).collect();
        let (mut flow, mut seen) = (vec![[f32::NAN; 2]; rays], vec![true; rays]);
        induced_flow(&p, Coordinates::World, neighbours, &pixels, &mut flow, &mut seen);
        let bars: Vec<[f32; 2]> = cotangent(2 * rays, seed).chunks(2).map(|b| [b[0] as f32, b[1] as f32]).collect();
        let (mut p_bar, mut camera_bars) = (vec![0.25; 3 * rays], [NeighbourBar::default(); 2]);
        induced_flow_backward(&p, Coordinates::World, neighbours, &bars, &mut p_bar, &mut camera_bars);
        let mut want_bars = [NeighbourBar::default(); 2];
        for (r, x) in xs.iter().enumerate() {
            let (x, of) = (DVec3::from(x.map(f64::from)), r % 2);
            let pixel = DVec2::from(pixels[r].map(f64::from));
            let want = flow_of_point(x, Coordinates::World, &cameras[of], 0.5, pixel);
            prop_assert_eq!(seen[r], want.is_some());
            prop_assert_eq!(flow[r], want.unwrap_or(DVec2::ZERO).to_array().map(|v| v as f32));
            let bar = DVec2::from(bars[r].map(f64::from));
            let want = flow_of_point_backward(x, Coordinates::World, &cameras[of], 0.5, bar, &mut want_bars[of]);
            for a in 0..3 {
                prop_assert_eq!(p_bar[a * rays + r], 0.25 + want[a] as f32);
            }
        }
        prop_assert_eq!(camera_bars, want_bars);
        // Cameras that are fixed change nothing else.
        let mut fixed = vec![0.25; 3 * rays];
        induced_flow_backward(&p, Coordinates::World, neighbours, &bars, &mut fixed, &mut []);
        prop_assert_eq!(fixed, p_bar);
    }
}

/// Flow of a ray with all its weight on the middle one of three samples, whose places in the neighbour's frame are given.
fn flow_of_ray(places: [DVec3; 3], map: Option<&SpaceMap>, neighbour: &Camera, pixel: DVec2) -> DVec2 {
    let place = |x: DVec3| map.map_or(x, |map| unit_of(map, x));
    let x: Vec<f32> = (0..3).flat_map(|a| places.map(|x| place(x)[a] as f32)).collect();
    let mut p = [0.0; 3];
    expected_points(&[0, 3], &x, &[0.0, 1.0, 0.0], Rest::Shared, &mut p);
    let cameras = [neighbour.prepare()];
    let neighbours = Neighbours { cameras: &cameras, of_ray: &[0], z_min: 1e-6 };
    let coordinates = map.map_or(Coordinates::World, Coordinates::Unit);
    let (mut flow, mut seen) = ([[0.0; 2]], [false]);
    let pixel = pixel.to_array().map(|v| v as f32);
    induced_flow(&p, coordinates, neighbours, &[pixel], &mut flow, &mut seen);
    assert!(seen[0]);
    DVec2::from(flow[0].map(f64::from))
}

#[test]
fn rigid_motion_induces_the_flow_that_geometry_says() {
    let here = Camera { pose: Pose::IDENTITY, ..camera() };
    let spaces = maps();
    let all: Vec<Option<&SpaceMap>> = std::iter::once(None).chain(spaces.iter().map(Some)).collect();
    for pixel in [DVec2::new(12.5, 40.5), DVec2::new(33.5, 20.5)] {
        let ray = here.ray(pixel).unwrap();
        let at = |z: f64| ray.o + ray.d / ray.d.z * z;
        let samples = [at(4.0), at(5.0), at(7.0)];
        for &map in &all {
            let check = |places: [DVec3; 3], neighbour: &Camera, want: DVec2| {
                let got = flow_of_ray(places, map, neighbour, pixel);
                assert!((got - want).length() < 2e-3, "{map:?} {pixel}: {got} {want}");
            };
            // Nothing moves: no flow, because the ray went through the same place of the pixel.
            check(samples, &here, DVec2::ZERO);
            // Things move to the right and up, by f / z a unit.
            let step = DVec3::new(0.3, -0.2, 0.0);
            check(samples.map(|x| x + step), &here, DVec2::new(60.0 * 0.3 / 5.0, -55.0 * 0.2 / 5.0));
            // The camera does, and what stands still moves the other way.
            let moved = Camera { pose: Pose { c: step, ..Pose::IDENTITY }, ..here };
            check(samples, &moved, DVec2::new(-60.0 * 0.3 / 5.0, 55.0 * 0.2 / 5.0));
            // Both turn and move together: a rigid motion of everything is none.
            let turn = DMat3::from_rotation_y(0.05) * DMat3::from_rotation_z(0.1);
            let carried = Camera { pose: Pose { r: turn, c: step }, ..here };
            check(samples.map(|x| turn * x + step), &carried, DVec2::ZERO);
            // Things turn around the optical axis by the angle, and so do pixels around the principal point.
            let spun = samples.map(|x| DMat3::from_rotation_z(0.1) * x);
            let from_axis = DVec2::new((pixel.x - 31.0) / 60.0, (pixel.y - 25.0) / 55.0);
            let turned = DVec2::from_angle(0.1).rotate(from_axis);
            check(spun, &here, (turned - from_axis) * DVec2::new(60.0, 55.0));
        }
    }
}

#[test]
fn what_a_neighbour_has_behind_it_has_no_flow_and_no_gradient() {
    let cameras = [Camera { pose: Pose::IDENTITY, ..camera() }.prepare()];
    // In front, behind, in the image plane, closer than `z_min`, nowhere, at infinity.
    let z = [5.0, -5.0, 0.0, 0.05, f32::NAN, f32::INFINITY];
    let p: Vec<f32> = [[0.1; 6], [0.2; 6], z].concat();
    let neighbours = Neighbours { cameras: &cameras, of_ray: &[0; 6], z_min: 0.1 };
    let (mut flow, mut seen) = ([[7.0; 2]; 6], [true; 6]);
    induced_flow(&p, Coordinates::World, neighbours, &[[0.5, 0.5]; 6], &mut flow, &mut seen);
    assert_eq!(seen, [true, false, false, false, false, false]);
    assert!(flow[1..].iter().all(|flow| *flow == [0.0; 2]), "{flow:?}");
    let (mut p_bar, mut camera_bars) = ([0.0; 18], [NeighbourBar::default()]);
    let bars = [[0.0; 2], [1.0; 2], [1.0; 2], [1.0; 2], [f32::NAN; 2], [1.0; 2]];
    induced_flow_backward(&p, Coordinates::World, neighbours, &bars, &mut p_bar, &mut camera_bars);
    assert_eq!((p_bar, camera_bars), ([0.0; 18], [NeighbourBar::default()]));
}

#[test]
fn rays_without_weight_see_nothing_or_their_end() {
    let (offsets, x, w) = ([0, 2, 2], [1.0, f32::INFINITY, 1.0, 1.0, 1.0, 1.0], [0.0; 2]);
    let end = [5.0, 6.0, 5.0, 6.0, 5.0, 6.0];
    for rest in [Rest::Dropped, Rest::Shared, Rest::AtEnd(&end)] {
        let (mut p, mut x_bar, mut w_bar) = ([0.0; 6], [0.0; 6], [0.0; 2]);
        expected_points(&offsets, &x, &w, rest, &mut p);
        match rest {
            Rest::AtEnd(_) => assert_eq!(p, end),
            _ => assert!(p.iter().all(|p| p.is_nan()), "{p:?}"),
        }
        expected_points_backward(&offsets, &x, &w, rest, &[1.0; 6], &mut x_bar, &mut w_bar);
        assert_eq!((x_bar, w_bar), ([0.0; 6], [0.0; 2]));
    }
}

#[test]
fn empty_batches_are_legal_and_extremes_finite() {
    for offsets in [&[][..], &[0]] {
        expected_points(offsets, &[], &[], Rest::Shared, &mut []);
        expected_points_backward(offsets, &[], &[], Rest::AtEnd(&[]), &[], &mut [], &mut []);
    }
    let none = Neighbours { cameras: &[], of_ray: &[], z_min: 0.1 };
    induced_flow(&[], Coordinates::World, none, &[], &mut [], &mut []);
    induced_flow_backward(&[], Coordinates::World, none, &[], &mut [], &mut []);
    // Far corners of every map, weights that are hardly there: finite or not seen.
    let cameras = [camera().prepare()];
    for map in maps() {
        for corner in [[0.0_f32, 0.0, 0.0], [1.0, 1.0, 1.0], [0.5, 0.5, 1.0], [0.5, 0.5, 0.5], [1e-30, 3.0, -2.0]] {
            let mut p = [0.0; 3];
            expected_points(&[0, 1], &corner, &[1e-20], Rest::Shared, &mut p);
            assert!(p.iter().all(|p| p.is_finite()));
            let neighbours = Neighbours { cameras: &cameras, of_ray: &[0], z_min: 1e-6 };
            let (mut flow, mut seen, mut p_bar) = ([[0.0; 2]], [false], [0.0; 3]);
            induced_flow(&corner, Coordinates::Unit(&map), neighbours, &[[0.5, 0.5]], &mut flow, &mut seen);
            induced_flow_backward(&corner, Coordinates::Unit(&map), neighbours, &[[1.0; 2]], &mut p_bar, &mut []);
            assert!(flow[0].iter().chain(&p_bar).all(|x| x.is_finite()), "{map:?} {corner:?}: {flow:?} {p_bar:?}");
        }
    }
}
