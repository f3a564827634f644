//! Gradients from samples back to rays and cameras: against `f64` twins and central differences, component by component.

use crate::cameras::lenses::{SAMPLES, sample_camera};
use glam::{DMat3, DQuat, DVec2, DVec3};
use proptest::prelude::*;
use render_core::bounds::{intersect_box, intersect_box_backward};
use render_core::camera::{Camera, CameraBar, Lens, Pose, PoseBar};
use render_core::contract::Norm;
use render_core::ndc::Ndc;
use render_core::ray::{Ray, RayBar, SamplePositionsGrads, sample_positions, sample_positions_backward};
use render_core::space_map::SpaceMap;
use testkit::gradient::{PairTolerances, Tolerance, check_f32_pair, check_pair, cotangent};

/// The lens with its coefficients replaced, in the order of `Lens::parameters`.
fn with_lens(lens: Lens, v: &[f64]) -> Lens {
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

/// Pixel, focal lengths, principal point and lens coefficients of a camera in one list.
fn optics(camera: &Camera, pixel: [f64; 2]) -> Vec<f64> {
    let mut x = pixel.to_vec();
    x.extend([camera.fx, camera.fy, camera.cx, camera.cy]);
    x.extend(camera.lens.parameters().map(|(_, value)| value));
    x
}

/// The camera and the pixel of such a list.
fn from_optics(camera: &Camera, x: &[f64]) -> (Camera, DVec2) {
    let lens = with_lens(camera.lens, &x[6..]);
    (Camera { fx: x[2], fy: x[3], cx: x[4], cy: x[5], lens, ..*camera }, DVec2::new(x[0], x[1]))
}

/// Adds the gradient of such a list.
fn add_optics(pixel_bar: DVec2, bar: &CameraBar, x_bar: &mut [f64]) {
    let all = [pixel_bar.x, pixel_bar.y, bar.f.x, bar.f.y, bar.c.x, bar.c.y].into_iter().chain(bar.lens);
    for (to, from) in x_bar.iter_mut().zip(all) {
        *to += from;
    }
}

/// A camera moved by a small twist, in the world.
fn moved(camera: &Camera, xi: &[f64]) -> Camera {
    // V(omega) v = v up to terms of second order.
    let r = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::from_slice(xi)));
    let pose = Pose { r: r * camera.pose.r, c: r * camera.pose.c + DVec3::from_slice(&xi[3..]) };
    Camera { pose, ..*camera }
}

const PIXELS: [[f64; 2]; 5] = [[49.25, 34.5], [49.26, 34.5], [10.0, 60.0], [90.0, 5.0], [55.0, 31.0]];

fn six(ray: &Ray) -> [f64; 6] {
    [ray.o.x, ray.o.y, ray.o.z, ray.d.x, ray.d.y, ray.d.z]
}

fn bar_of(v: &[f64]) -> RayBar {
    RayBar { o: DVec3::from_slice(v), d: DVec3::from_slice(&v[3..]) }
}

#[test]
fn rays_go_back_to_twist_intrinsics_and_lens_in_all_models() {
    for (name, lens) in SAMPLES {
        let camera = sample_camera(lens);
        for (i, pixel) in PIXELS.into_iter().enumerate() {
            let mut x = vec![0.0; 6];
            x.extend(optics(&camera, pixel));
            let out = check_pair(
                &x,
                &cotangent(6, i as u64),
                |x, out| {
                    let (camera, pixel) = from_optics(&moved(&camera, x), &x[6..]);
                    out.copy_from_slice(&six(&camera.ray(pixel).unwrap()));
                },
                |x, out_bar, x_bar| {
                    let (camera, pixel) = from_optics(&camera, &x[6..]);
                    let (mut pose_bar, mut bar) = (PoseBar::default(), CameraBar::default());
                    let pixel_bar = camera.prepare().ray_backward(pixel, &bar_of(out_bar), &mut pose_bar, &mut bar);
                    for (to, from) in x_bar.iter_mut().zip(pose_bar.twist(&camera.pose)) {
                        *to += from;
                    }
                    add_optics(pixel_bar, &bar, &mut x_bar[6..]);
                },
                Tolerance::new(1e-7, 1e-7),
            );
            out.unwrap_or_else(|e| panic!("{name}, pixel {i}: {e}"));
        }
    }
}

#[test]
fn rays_go_back_to_the_entries_of_the_pose() {
    let camera = sample_camera(SAMPLES[3].1);
    let pose = |x: &[f64]| Pose { r: DMat3::from_cols_slice(&x[..9]), c: DVec3::from_slice(&x[9..]) };
    let mut x = camera.pose.r.to_cols_array().to_vec();
    x.extend(camera.pose.c.to_array());
    for (i, pixel) in PIXELS.into_iter().enumerate() {
        let pixel = DVec2::from(pixel);
        check_pair(
            &x,
            &cotangent(6, i as u64),
            |x, out| out.copy_from_slice(&six(&Camera { pose: pose(x), ..camera }.ray(pixel).unwrap())),
            |x, out_bar, x_bar| {
                let camera = Camera { pose: pose(x), ..camera }.prepare();
                let (mut pose_bar, mut bar) = (PoseBar::ZERO, CameraBar::default());
                camera.ray_backward(pixel, &bar_of(out_bar), &mut pose_bar, &mut bar);
                let all = pose_bar.r.to_cols_array().into_iter().chain(pose_bar.c.to_array());
                for (to, from) in x_bar.iter_mut().zip(all) {
                    *to += from;
                }
            },
            Tolerance::TWIN,
        )
        .unwrap();
    }
}

#[test]
fn pixels_without_a_ray_give_no_gradient() {
    // Past the fold of a strong barrel.
    let camera = sample_camera(SAMPLES[1].1).prepare();
    let far = DVec2::new(1e4, 1e4);
    assert!(camera.ray(far).is_none());
    let (mut pose_bar, mut bar) = (PoseBar::ZERO, CameraBar::default());
    let ray_bar = RayBar { o: DVec3::ONE, d: DVec3::ONE };
    assert_eq!(camera.ray_backward(far, &ray_bar, &mut pose_bar, &mut bar), DVec2::ZERO);
    assert_eq!((pose_bar, bar), (PoseBar::ZERO, CameraBar::default()));
}

#[test]
fn many_rays_are_summed_in_one_order() {
    let camera = sample_camera(SAMPLES[5].1).prepare();
    let n = 700;
    let pixels: Vec<DVec2> =
        (0..n).map(|i| DVec2::new((i * 37 % 96) as f64 + 0.5, (i * 11 % 72) as f64 + 0.5)).collect();
    let bars: Vec<RayBar> = (0..n).map(|i| bar_of(&cotangent(6, i as u64))).collect();
    let sum = || {
        let (mut pose_bar, mut bar) = (PoseBar::ZERO, CameraBar::default());
        camera.rays_backward(&pixels, &bars, &mut pose_bar, &mut bar);
        (pose_bar, bar)
    };
    // Written down again: parts of 256 rays, one after the other.
    let mut want = (PoseBar::ZERO, CameraBar::default());
    for (pixels, bars) in pixels.chunks(256).zip(bars.chunks(256)) {
        let mut part = (PoseBar::ZERO, CameraBar::default());
        for (pixel, bar) in pixels.iter().zip(bars) {
            camera.ray_backward(*pixel, bar, &mut part.0, &mut part.1);
        }
        want.0 += part.0;
        want.1 += part.1;
    }
    assert_eq!(sum(), want);
    #[cfg(feature = "rayon")]
    for threads in [1, 2, 5] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert_eq!(pool.install(sum), want, "{threads} threads");
    }
    let (mut pose_bar, mut bar) = want;
    camera.rays_backward(&[], &[], &mut pose_bar, &mut bar);
    assert_eq!((pose_bar, bar), want);
}

/// Rays, offsets and distances, and the list `[rays][6], [n]` of them.
fn some_rays() -> (Vec<u32>, Vec<f32>) {
    let offsets = vec![0, 3, 3, 4, 9];
    let rays = cotangent(4 * 6, 5).into_iter().map(|x| x as f32);
    let t = (0..9).map(|i| 0.25 + 0.5 * i as f32);
    (offsets, rays.chain(t).collect())
}

fn rays_of<T: Copy + Into<f64>>(x: &[T]) -> Vec<Ray> {
    let v: Vec<f64> = x.iter().map(|&x| x.into()).collect();
    v.chunks_exact(6).map(|v| Ray { o: DVec3::from_slice(v), d: DVec3::from_slice(&v[3..]) }).collect()
}

#[test]
fn sample_positions_match_their_twin() {
    let (offsets, x) = some_rays();
    let rays = 6 * (offsets.len() - 1);
    let n = x.len() - rays;
    let samples = |r: usize| offsets[r] as usize..offsets[r + 1] as usize;
    let out_bar: Vec<f32> = cotangent(3 * n, 3).into_iter().map(|x| x as f32).collect();
    check_f32_pair(
        &x,
        &out_bar,
        (
            |x: &[f32], out: &mut [f32]| sample_positions(&rays_of(&x[..rays]), &offsets, &x[rays..], out),
            |x: &[f32], out_bar: &[f32], x_bar: &mut [f32]| {
                let (rays_x, t) = x.split_at(rays);
                let (to_rays, to_t) = x_bar.split_at_mut(rays);
                let mut bars = vec![RayBar::default(); offsets.len() - 1];
                let grads = SamplePositionsGrads { rays: &mut bars, t: Some(to_t) };
                sample_positions_backward(&rays_of(rays_x), &offsets, t, out_bar, grads);
                for (to, bar) in to_rays.chunks_exact_mut(6).zip(bars) {
                    for (to, from) in to.iter_mut().zip(bar.o.to_array().into_iter().chain(bar.d.to_array())) {
                        *to += from as f32;
                    }
                }
            },
        ),
        (
            |x: &[f64], out: &mut [f64]| {
                for r in 0..offsets.len() - 1 {
                    for i in samples(r) {
                        for a in 0..3 {
                            out[a * n + i] = x[6 * r + a] + x[rays + i] * x[6 * r + 3 + a];
                        }
                    }
                }
            },
            |x: &[f64], out_bar: &[f64], x_bar: &mut [f64]| {
                for r in 0..offsets.len() - 1 {
                    for i in samples(r) {
                        for a in 0..3 {
                            let bar = out_bar[a * n + i];
                            x_bar[6 * r + a] += bar;
                            x_bar[6 * r + 3 + a] += x[rays + i] * bar;
                            x_bar[rays + i] += x[6 * r + 3 + a] * bar;
                        }
                    }
                }
            },
        ),
        PairTolerances::default(),
    )
    .unwrap();
}

#[test]
fn ray_gradients_have_the_same_bits_however_a_batch_is_cut() {
    let (offsets, x) = some_rays();
    let rays = rays_of(&x[..24]);
    let (t, n) = (&x[24..], 9);
    let x_bar: Vec<f32> = cotangent(3 * n, 8).into_iter().map(|x| x as f32 * 0.1).collect();
    let mut whole = vec![RayBar::default(); 4];
    let grads = SamplePositionsGrads { rays: &mut whole, t: None };
    sample_positions_backward(&rays, &offsets, t, &x_bar, grads);
    let mut parts = vec![RayBar::default(); 4];
    for (r, bar) in parts.chunks_mut(1).enumerate() {
        let at = offsets[r] as usize..offsets[r + 1] as usize;
        let own: Vec<f32> = (0..3).flat_map(|a| x_bar[a * n + at.start..a * n + at.end].to_vec()).collect();
        let grads = SamplePositionsGrads { rays: bar, t: None };
        sample_positions_backward(&rays[r..=r], &[0, at.len() as u32], &t[at], &own, grads);
    }
    assert_eq!(whole, parts);
    sample_positions(&[], &[], &[], &mut []);
    sample_positions(&[], &[0], &[], &mut []);
}

const CENTRE: DVec3 = DVec3::new(0.5, -1.0, 2.0);
const RADIUS: f64 = 1.5;

fn maps() -> Vec<(&'static str, SpaceMap)> {
    let pose = Pose::look_at(DVec3::new(0.2, 0.1, -4.0), CENTRE, DVec3::new(0.1, -1.0, 0.0)).unwrap();
    let ndc = Ndc { scale: [1.3, 1.7], shift: [0.05, -0.1], near: 0.8 };
    vec![
        ("box", SpaceMap::Box { centre: CENTRE, radius: RADIUS }),
        ("contracted, L2", SpaceMap::Contracted { norm: Norm::L2, centre: CENTRE, radius: RADIUS }),
        ("contracted, max", SpaceMap::Contracted { norm: Norm::Max, centre: CENTRE, radius: RADIUS }),
        ("NDC", SpaceMap::Ndc { pose, ndc }),
    ]
}

/// World positions in front of the reference camera, away from the corners of the contractions.
fn any_positions() -> impl Strategy<Value = Vec<f32>> {
    let far_from_corners = |x: &[f32; 3]| {
        let p: Vec<f64> = (0..3).map(|a| (f64::from(x[a]) - CENTRE[a]) / RADIUS).collect();
        let mut sizes: Vec<f64> = p.iter().map(|x| x.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        let l2 = p.iter().map(|x| x * x).sum::<f64>().sqrt();
        (sizes[2] - 1.0).abs() > 0.01 && (l2 - 1.0).abs() > 0.01 && sizes[2] - sizes[1] > 0.01
    };
    let point = [-4.0_f32..4.0, -4.0_f32..3.0, -1.0_f32..9.0].prop_filter("a corner", far_from_corners);
    prop::collection::vec(point, 0..6)
        .prop_map(|points| (0..3).flat_map(|a| points.iter().map(move |p| p[a]).collect::<Vec<_>>()).collect())
}

/// A function of one point and its gradient, for each point of a list `[3][n]`.
fn each_point(x: &[f64], out: &mut [f64], f: impl Fn(DVec3) -> DVec3) {
    let n = x.len() / 3;
    for i in 0..n {
        let y = f(DVec3::new(x[i], x[n + i], x[2 * n + i]));
        (out[i], out[n + i], out[2 * n + i]) = (y.x, y.y, y.z);
    }
}

fn each_bar(x: &[f64], out_bar: &[f64], x_bar: &mut [f64], f: impl Fn(DVec3, DVec3) -> DVec3) {
    let n = x.len() / 3;
    for i in 0..n {
        let at = |x: &[f64]| DVec3::new(x[i], x[n + i], x[2 * n + i]);
        let bar = f(at(x), at(out_bar));
        x_bar[i] += bar.x;
        x_bar[n + i] += bar.y;
        x_bar[2 * n + i] += bar.z;
    }
}

/// Internal coordinates by their definition.
fn twin_internal(map: SpaceMap, x: DVec3) -> DVec3 {
    match map {
        SpaceMap::Ndc { pose, ndc } => {
            let v = pose.r.transpose() * (x - pose.c);
            // CV axes: z forward, y down.
            let lateral = |a: usize, v: f64, depth: f64| ndc.scale[a] * v / depth + ndc.shift[a];
            DVec3::new(lateral(0, v.x, v.z), lateral(1, -v.y, v.z), 1.0 - 2.0 * ndc.near / v.z)
        }
        _ => (x - CENTRE) / RADIUS,
    }
}

fn twin_internal_bar(map: SpaceMap, x: DVec3, bar: DVec3) -> DVec3 {
    match map {
        SpaceMap::Ndc { pose, ndc } => {
            let v = pose.r.transpose() * (x - pose.c);
            let (a, b) = (ndc.scale[0] / v.z, -ndc.scale[1] / v.z);
            let z = -(a * v.x * bar.x + b * v.y * bar.y) / v.z + 2.0 * ndc.near / (v.z * v.z) * bar.z;
            pose.r * DVec3::new(a * bar.x, b * bar.y, z)
        }
        _ => bar / RADIUS,
    }
}

/// `y = f(m) p` with `f(m) = (2 - 1 / m) / m` outside, and `f`'s derivative.
fn contraction(norm: Norm, p: DVec3) -> (f64, f64, DVec3) {
    let (m, gradient) = match norm {
        Norm::L2 => (p.length(), p / p.length()),
        Norm::Max => {
            let k = (0..3).fold(0, |k, a| if p[a].abs() > p[k].abs() { a } else { k });
            let mut unit = DVec3::ZERO;
            unit[k] = p[k].signum();
            (p[k].abs(), unit)
        }
    };
    if m <= 1.0 { (1.0, 0.0, gradient) } else { ((2.0 - 1.0 / m) / m, -2.0 / (m * m) + 2.0 / (m * m * m), gradient) }
}

fn twin_unit(map: SpaceMap, p: DVec3) -> DVec3 {
    match map {
        SpaceMap::Contracted { norm, .. } => (p * contraction(norm, p).0 + 2.0) / 4.0,
        _ => (p + 1.0) / 2.0,
    }
}

fn twin_unit_bar(map: SpaceMap, p: DVec3, bar: DVec3) -> DVec3 {
    match map {
        SpaceMap::Contracted { norm, .. } => {
            let (f, slope, gradient) = contraction(norm, p);
            (bar * f + gradient * (slope * p.dot(bar))) / 4.0
        }
        _ => bar / 2.0,
    }
}

proptest! {
    #![proptest_config(testkit::property::cases(32))]

    #[test]
    fn positions_go_through_every_map_and_back(x in any_positions()) {
        let out_bar: Vec<f32> = cotangent(x.len(), 2).into_iter().map(|x| x as f32).collect();
        let tolerances = PairTolerances { twin: Tolerance::new(1e-6, 1e-7), ..PairTolerances::default() };
        for (name, map) in maps() {
            let internal = check_f32_pair(
                &x, &out_bar,
                (
                    |x: &[f32], out: &mut [f32]| map.internal(x, out),
                    |x: &[f32], bar: &[f32], x_bar: &mut [f32]| map.internal_backward(x, bar, x_bar),
                ),
                (
                    |x: &[f64], out: &mut [f64]| each_point(x, out, |x| twin_internal(map, x)),
                    |x: &[f64], bar: &[f64], x_bar: &mut [f64]| each_bar(x, bar, x_bar, |x, bar| twin_internal_bar(map, x, bar)),
                ),
                tolerances,
            );
            prop_assert!(internal.is_ok(), "{}: {:?}", name, internal);
            let mut p = vec![0.0; x.len()];
            map.internal(&x, &mut p);
            let unit = check_f32_pair(
                &p, &out_bar,
                (
                    |p: &[f32], out: &mut [f32]| map.unit(p, out),
                    |p: &[f32], bar: &[f32], p_bar: &mut [f32]| map.unit_backward(p, bar, p_bar),
                ),
                (
                    |p: &[f64], out: &mut [f64]| each_point(p, out, |p| twin_unit(map, p)),
                    |p: &[f64], bar: &[f64], p_bar: &mut [f64]| each_bar(p, bar, p_bar, |p, bar| twin_unit_bar(map, p, bar)),
                ),
                tolerances,
            );
            prop_assert!(unit.is_ok(), "{}: {:?}", name, unit);
        }
    }
}

#[test]
fn rays_go_through_every_map_and_back() {
    for (name, map) in maps() {
        for (i, d) in [[0.1, -0.2, 1.0], [-0.3, 0.4, 0.8], [0.0, 0.0, 1.0]].into_iter().enumerate() {
            let ray = Ray { o: DVec3::new(0.3, -0.4, -3.0), d: DVec3::from(d).normalize() };
            let read = |x: &[f64]| Ray { o: DVec3::from_slice(x), d: DVec3::from_slice(&x[3..]) };
            let internal = map.internal_ray(&ray).unwrap();
            assert!(internal.d.is_normalized());
            // The internal ray holds the internal points.
            for t in [2.0, 5.0] {
                let p = twin_internal(map, ray.at(t));
                let off = (p - internal.o).reject_from(internal.d).length();
                assert!(off < 1e-12 * p.length().max(1.0), "{name}: {off:e}");
            }
            check_pair(
                &six(&ray),
                &cotangent(6, i as u64),
                |x, out| out.copy_from_slice(&six(&map.internal_ray(&read(x)).unwrap())),
                |x, out_bar, x_bar| {
                    let mut bar = bar_of(x_bar);
                    map.internal_ray_backward(&read(x), &bar_of(out_bar), &mut bar);
                    x_bar.copy_from_slice(&six(&Ray { o: bar.o, d: bar.d }));
                },
                Tolerance::TWIN,
            )
            .unwrap_or_else(|e| panic!("{name}, ray {i}: {e}"));
        }
    }
}

#[test]
fn a_loss_on_the_unit_cube_reaches_the_camera() {
    // Everything in a row: twist, intrinsics and lens to a pixel's ray, its samples, and the field's coordinates.
    let t = [0.5_f32, 1.25, 3.0];
    for (name, map) in maps() {
        for (lens_name, lens) in SAMPLES {
            let SpaceMap::Ndc { pose, .. } = maps()[3].1 else { unreachable!() };
            let camera = Camera {
                pose: moved(&Camera { pose, ..sample_camera(lens) }, &[0.02, -0.01, 0.03, 0.1, 0.0, 0.05]).pose,
                ..sample_camera(lens)
            };
            let mut x = vec![0.0; 6];
            x.extend(optics(&camera, [40.5, 30.5]));
            let weight = cotangent(9, 4);
            let loss = |x: &[f64]| {
                let (camera, pixel) = from_optics(&moved(&camera, x), &x[6..]);
                let ray = map.internal_ray(&camera.ray(pixel).unwrap()).unwrap();
                let u = t.map(|t| twin_unit(map, ray.at(t.into())));
                (0..3).flat_map(|a| u.map(|u| u[a])).zip(&weight).map(|(u, w)| u * w).sum::<f64>()
            };
            // The way back, with the functions of this crate.
            let (_, pixel) = from_optics(&camera, &x[6..]);
            let ray = camera.ray(pixel).unwrap();
            let internal = map.internal_ray(&ray).unwrap();
            let (mut p, mut p_bar) = ([0.0; 9], [0.0; 9]);
            sample_positions(&[internal], &[0, 3], &t, &mut p);
            let u_bar: Vec<f32> = weight.iter().map(|&w| w as f32).collect();
            map.unit_backward(&p, &u_bar, &mut p_bar);
            let mut internal_bar = [RayBar::default()];
            let grads = SamplePositionsGrads { rays: &mut internal_bar, t: None };
            sample_positions_backward(&[internal], &[0, 3], &t, &p_bar, grads);
            let (mut ray_bar, mut pose_bar, mut bar) = (RayBar::default(), PoseBar::ZERO, CameraBar::default());
            map.internal_ray_backward(&ray, &internal_bar[0], &mut ray_bar);
            let pixel_bar = camera.prepare().ray_backward(pixel, &ray_bar, &mut pose_bar, &mut bar);
            let mut got = pose_bar.twist(&camera.pose).to_vec();
            got.resize(x.len(), 0.0);
            add_optics(pixel_bar, &bar, &mut got[6..]);
            let want: Vec<f64> = (0..x.len())
                .map(|k| {
                    let h = 1e-6 * x[k].abs().max(1.0);
                    let at = |h: f64| {
                        let mut x = x.clone();
                        x[k] += h;
                        loss(&x)
                    };
                    (at(h) - at(-h)) / (2.0 * h)
                })
                .collect();
            let largest = want.iter().fold(0.0_f64, |m, w| m.max(w.abs()));
            for (k, (got, want)) in got.iter().zip(&want).enumerate() {
                let error = (got - want).abs();
                assert!(error <= 1e-5 * want.abs() + 1e-6 * largest, "{name}, {lens_name}, {k}: {got} {want}");
            }
        }
    }
}

#[test]
fn distances_to_a_box_go_back_to_the_ray() {
    let (min, max) = ([-1.0, -2.0, -0.5], [1.5, 1.0, 2.0]);
    for (i, x) in [
        [-3.0, 0.2, 0.1, 0.9, -0.1, 0.15],
        [0.1, 5.0, 0.3, 0.05, -1.0, 0.1],
        [0.2, 0.3, 0.4, -0.3, 0.2, 0.9],
        [2.0, -3.0, 3.1, -0.5, 0.8, -0.7],
    ]
    .into_iter()
    .enumerate()
    {
        let (near, far) = (0.25, 9.0);
        let ends = |x: &[f64]| {
            let (o, d) = (DVec3::from_slice(x), DVec3::from_slice(&x[3..]));
            intersect_box(o.to_array(), d.to_array(), min, max, near, far)
        };
        let t = ends(&x).unwrap_or_else(|| panic!("ray {i} misses"));
        // The third ray starts inside: its near end does not depend on it.
        assert_eq!(t[0] == near, i == 2);
        check_pair(
            &x,
            &cotangent(2, i as u64),
            |x, out| out.copy_from_slice(&ends(x).unwrap()),
            |x, out_bar, x_bar| {
                let (mut o_bar, mut d_bar) = ([0.0; 3], [0.0; 3]);
                let (o, d) = (DVec3::from_slice(x).to_array(), DVec3::from_slice(&x[3..]).to_array());
                let bar = [out_bar[0], out_bar[1]];
                intersect_box_backward(o, d, min, max, near, far, bar, &mut o_bar, &mut d_bar);
                for (to, from) in x_bar.iter_mut().zip(o_bar.into_iter().chain(d_bar)) {
                    *to += from;
                }
            },
            Tolerance::TWIN,
        )
        .unwrap_or_else(|e| panic!("ray {i}: {e}"));
    }
    let (mut o_bar, mut d_bar) = ([0.0; 3], [0.0; 3]);
    intersect_box_backward([9.0; 3], [0.0, 0.0, 1.0], min, max, 0.0, 1.0, [1.0; 2], &mut o_bar, &mut d_bar);
    assert_eq!((o_bar, d_bar), ([0.0; 3], [0.0; 3]));
}

#[test]
fn distances_in_ndc_go_back_to_the_ray() {
    let ndc = Ndc { scale: [1.0; 2], shift: [0.0; 2], near: 0.8 };
    for (i, x) in [[0.3, -0.9, 0.4], [-0.2, -1.0, 0.95], [0.0, -0.4, 0.0]].into_iter().enumerate() {
        check_pair(
            &x,
            &cotangent(1, i as u64),
            |x, out| out[0] = ndc.t_at(x[0], x[1], x[2]),
            |x, out_bar, x_bar| {
                let [a, b, c] = x_bar else { unreachable!() };
                ndc.t_at_backward(x[0], x[1], x[2], out_bar[0], a, b, c);
            },
            Tolerance::TWIN,
        )
        .unwrap();
        let t = [x[0], x[1], ndc.t_at(x[0], x[1], x[2])];
        check_pair(
            &t,
            &cotangent(1, i as u64),
            |x, out| out[0] = ndc.s_at(x[0], x[1], x[2]),
            |x, out_bar, x_bar| {
                let [a, b, c] = x_bar else { unreachable!() };
                ndc.s_at_backward(x[0], x[1], x[2], out_bar[0], a, b, c);
            },
            Tolerance::TWIN,
        )
        .unwrap();
    }
}
