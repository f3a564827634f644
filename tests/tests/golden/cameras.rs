//! Cameras, NDC and contraction against independent values and gradients: `golden/cameras.json`.

use field_core::deform::rigid;
use field_core::lie::{se3_exp, se3_exp_derivative, so3_exp, so3_exp_derivative};
use field_core::tape::{Arena, Tape};
use glam::{DMat2, DMat3, DQuat, DVec2, DVec3};
use render_core::camera::{Camera, CameraBar, Lens, Pose};
use render_core::contract::{Norm, contract, contract_covariance, contract_jacobian, inv_contract};
use render_core::induced_flow::{
    Coordinates, NeighbourBar, Neighbours, Rest, expected_points, expected_points_backward, flow_of_point,
    flow_of_point_backward, induced_flow,
};
use render_core::ndc::{Ndc, NdcRay};
use render_core::pose::Axes;
use render_core::space_map::SpaceMap;
use std::path::Path;
use testkit::golden::{Golden, Kind, Record, Tensor, assert_close};

fn golden() -> Golden {
    Golden::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/cameras.json")).unwrap()
}

fn vec2s(t: &Tensor) -> Vec<DVec2> {
    t.data.chunks_exact(2).map(DVec2::from_slice).collect()
}

fn vec3s(t: &Tensor) -> Vec<DVec3> {
    t.data.chunks_exact(3).map(DVec3::from_slice).collect()
}

fn vec3(t: &Tensor) -> DVec3 {
    DVec3::from_slice(&t.data)
}

fn lens(record: &Record) -> Lens {
    let d = &record.input("distortion").data;
    match record.op.as_str() {
        "project_opencv" | "undistort_opencv" => Lens::opencv5(d.as_slice().try_into().unwrap()),
        _ => Lens::Fisheye { k: d.as_slice().try_into().unwrap() },
    }
}

fn camera(record: &Record, lens: Lens, pose: Pose) -> Camera {
    let [fx, fy, cx, cy] = record.input("intrinsics").data.as_slice().try_into().unwrap();
    Camera { width: 640, height: 480, fx, fy, cx, cy, lens, pose }
}

/// Places of the gradient of a lens in the golden order.
fn golden_order(lens: Lens, bar: &CameraBar) -> Vec<f64> {
    match lens {
        // k1 k2 p1 p2 k3 out of k1..k6 p1 p2
        Lens::Perspective { .. } => [0, 1, 6, 7, 2].map(|i| bar.lens[i]).to_vec(),
        _ => bar.lens[..4].to_vec(),
    }
}

/// Left Jacobian of SO(3): a change `dw` of the rotation vector `w` turns the result by `left_jacobian(w) dw`.
fn left_jacobian(w: DVec3) -> DMat3 {
    let cross = DMat3::from_cols(w.cross(DVec3::X), w.cross(DVec3::Y), w.cross(DVec3::Z));
    let angle2 = w.length_squared();
    let (b, c) = if angle2 < 1e-8 {
        (0.5 - angle2 / 24.0, 1.0 / 6.0 - angle2 / 120.0)
    } else {
        let angle = angle2.sqrt();
        ((1.0 - angle.cos()) / angle2, (angle - angle.sin()) / (angle2 * angle))
    };
    DMat3::IDENTITY + cross * b + cross * cross * c
}

#[test]
fn projection_and_its_gradients_match() {
    let golden = golden();
    for record in golden.op("project_opencv").chain(golden.op("project_fisheye")) {
        let (w, t) = (vec3(record.input("rvec")), vec3(record.input("tvec")));
        let rotation = DMat3::from_quat(DQuat::from_scaled_axis(w));
        let lens = lens(record);
        let camera = camera(record, lens, Pose::from_w2c(rotation, t)).prepare();
        let points = vec3s(record.input("points"));

        let pixels: Vec<DVec2> = points.iter().map(|&x| camera.project(x).expect("in view")).collect();
        let flat: Vec<f64> = pixels.iter().flat_map(|p| p.to_array()).collect();
        assert_close(&record.label(), &flat, &record.output("pixel").data, 1e-14, 1e-9);

        let mut camera_bar = CameraBar::default();
        let (mut points_bar, mut t_bar, mut turn_bar) = (Vec::new(), DVec3::ZERO, DVec3::ZERO);
        for (&x, &pixel_bar) in points.iter().zip(&vec2s(record.cotangent("pixel"))) {
            let x_camera = rotation * x + t;
            let mut x_camera_bar = DVec3::ZERO;
            camera.project_backward(x_camera, pixel_bar, &mut x_camera_bar, &mut camera_bar);
            points_bar.extend((rotation.transpose() * x_camera_bar).to_array());
            t_bar += x_camera_bar;
            turn_bar += (rotation * x).cross(x_camera_bar);
        }
        let (rtol, atol) = (1e-10, 1e-12);
        let check = |name: &str, got: &[f64]| {
            assert_close(&format!("{} {name}_bar", record.label()), got, &record.grad(name).data, rtol, atol);
        };
        let CameraBar { f, c, .. } = camera_bar;
        check("intrinsics", &[f.x, f.y, c.x, c.y]);
        check("distortion", &golden_order(lens, &camera_bar));
        check("points", &points_bar);
        check("tvec", &t_bar.to_array());
        check("rvec", &(left_jacobian(w).transpose() * turn_bar).to_array());
    }
}

#[test]
fn undistortion_and_its_jacobian_match() {
    let golden = golden();
    for record in golden.op("undistort_opencv").chain(golden.op("undistort_fisheye")) {
        let camera = camera(record, lens(record), Pose::IDENTITY);
        let prepared = camera.prepare();
        let (mut got, mut jacobians) = (Vec::new(), Vec::new());
        for pixel in vec2s(record.input("pixel")) {
            let (d, [du, dv]) = prepared.direction_jacobian(pixel).expect("a ray");
            let tangent = d.truncate() / d.z;
            // d(tangent) / d(distorted normalised) from d(unit direction) / d(pixel).
            let column = |dd: DVec3, f: f64| (dd.truncate() - tangent * dd.z) / d.z * f;
            let jacobian = DMat2::from_cols(column(du, camera.fx), column(dv, camera.fy));
            got.extend(tangent.to_array());
            jacobians.extend(jacobian.transpose().to_cols_array());
            assert_eq!(prepared.direction(pixel), Some(d));
        }
        assert_close(&record.label(), &got, &record.output("normalised").data, 1e-12, 1e-13);
        let want = &record.output("jacobian_wrt_distorted").data;
        assert_close(&format!("{} jacobian", record.label()), &jacobians, want, 1e-10, 1e-12);
    }
}

#[test]
fn rays_match() {
    let golden = golden();
    for (op, axes) in [("rays_opencv", Axes::Cv), ("rays_opengl", Axes::Gl)] {
        for record in golden.op(op) {
            let rows: Vec<[f64; 4]> = record.input("c2w").data.chunks_exact(4).map(|r| r.try_into().unwrap()).collect();
            // The golden rotations are rounded to f32: taken as they are, not the nearest true rotation.
            let column = |j: usize| DVec3::new(rows[0][j], rows[1][j], rows[2][j]);
            let r = DMat3::from_cols(column(0), column(1), column(2));
            let flip = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
            let r = if axes == Axes::Gl { r * flip } else { r };
            let camera = camera(record, Lens::PINHOLE, Pose { r, c: column(3) });
            // What readers do: the same to f32 rounding.
            let (read, _) = Pose::from_matrix(&[rows[0], rows[1], rows[2]], axes).unwrap();
            assert!(read.r.abs_diff_eq(r, 1e-6) && read.c == column(3));

            let (mut o, mut d, mut unit) = (Vec::new(), Vec::new(), Vec::new());
            for pixel in vec2s(record.input("pixel")) {
                let ray = camera.ray(pixel).unwrap();
                let in_camera = camera.direction_in_camera(pixel).unwrap();
                o.extend(ray.o.to_array());
                unit.extend(ray.d.to_array());
                d.extend((r * (in_camera / in_camera.z)).to_array());
            }
            assert_close(&record.label(), &o, &record.output("origin").data, 1e-12, 1e-13);
            assert_close(&record.label(), &d, &record.output("direction").data, 1e-12, 1e-13);
            assert_close(&record.label(), &unit, &record.output("direction_unit").data, 1e-12, 1e-13);
        }
    }
}

#[test]
fn ndc_rays_and_their_gradients_match() {
    let golden = golden();
    for record in golden.op("ndc_rays") {
        let (w, h) = (record.param("width").usize() as u32, record.param("height").usize() as u32);
        let (focal, near) = (record.param("focal").f64(), record.param("near").f64());
        let (ndc, ndc32) = (Ndc::centred(w, h, focal, near), Ndc::centred(w, h, focal as f32, near as f32));
        let [origins, directions] = ["origin", "direction"].map(|name| vec3s(record.input(name)));
        let [o_bars, d_bars] = ["origin_ndc", "direction_ndc"].map(|name| vec3s(record.cotangent(name)));
        let (mut got, mut got32, mut grads) =
            (<[Vec<f64>; 2]>::default(), <[Vec<f64>; 2]>::default(), <[Vec<f64>; 2]>::default());
        for i in 0..origins.len() {
            let (o, d) = (origins[i].to_array(), directions[i].to_array());
            let ray = ndc.ray(o, d).expect("forward");
            got[0].extend(ray.o);
            got[1].extend(ray.d);
            let ray32 = ndc32.ray(o.map(|x| x as f32), d.map(|x| x as f32)).expect("forward");
            got32[0].extend(ray32.o.map(f64::from));
            got32[1].extend(ray32.d.map(f64::from));
            let bar = NdcRay { o: o_bars[i].to_array(), d: d_bars[i].to_array() };
            let (mut o_bar, mut d_bar) = ([0.0; 3], [0.0; 3]);
            ndc.ray_backward(o, d, &bar, &mut o_bar, &mut d_bar);
            grads[0].extend(o_bar);
            grads[1].extend(d_bar);
        }
        for (i, (out, input)) in [("origin_ndc", "origin"), ("direction_ndc", "direction")].into_iter().enumerate() {
            let want = &record.output(out).data;
            assert_close(&format!("{} {out}", record.label()), &got[i], want, 1e-12, 1e-13);
            assert_close(&format!("{} {out} f32", record.label()), &got32[i], want, 2e-6, 1e-6);
            let label = format!("{} {input}_bar", record.label());
            assert_close(&label, &grads[i], &record.grad(input).data, 1e-10, 1e-12);
        }
    }
}

fn rows3(t: &Tensor) -> [[f64; 3]; 3] {
    core::array::from_fn(|i| t.row(i).try_into().unwrap())
}

#[test]
fn contraction_matches() {
    let golden = golden();
    for (op, norm) in [("contract_l2", Norm::L2), ("contract_linf", Norm::Max)] {
        for record in golden.op(op) {
            let x: [f64; 3] = record.input("x").data.as_slice().try_into().unwrap();
            let cov = rows3(record.input("cov"));
            let (rtol, rtol32) = match record.kind {
                Kind::Random => (1e-12, 2e-6),
                _ => (1e-10, 1e-4),
            };
            let label = record.label();
            let want = |name: &str| &record.output(name).data;
            let z = contract(norm, x);
            assert_close(&label, &z, want("z"), rtol, 1e-13);
            assert_close(&label, contract_jacobian(norm, x).as_flattened(), want("jacobian"), rtol, 1e-13);
            assert_close(&label, contract_covariance(norm, x, &cov).as_flattened(), want("cov_out"), rtol, 1e-13);

            let x32 = x.map(|v| v as f32);
            let f64s = |v: &[f32]| v.iter().map(|&v| f64::from(v)).collect::<Vec<_>>();
            assert_close(&label, &f64s(&contract(norm, x32)), want("z"), rtol32, 1e-6);
            let j32 = contract_jacobian(norm, x32);
            assert_close(&label, &f64s(j32.as_flattened()), want("jacobian"), rtol32, 1e-6);
            let cov32 = contract_covariance(norm, x32, &cov.map(|row| row.map(|v| v as f32)));
            assert_close(&label, &f64s(cov32.as_flattened()), want("cov_out"), rtol32, 1e-6);

            // The inverse loses as many digits as the contraction squeezes.
            let far = x.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            if far < 1e6 {
                assert_close(&format!("{label} inverse"), &inv_contract(norm, z), &x, 1e-14 * (1.0 + far), 1e-15);
            }
        }
    }
}

fn flat<const J: usize, const K: usize>(d: &[[[f64; K]; J]; 3]) -> Vec<f64> {
    d.iter().flatten().flatten().copied().collect()
}

#[test]
fn exponential_maps_and_their_derivatives_match() {
    let golden = golden();
    for record in golden.op("so3_exp") {
        let w = record.input("w").data.as_slice().try_into().unwrap();
        let (r, d) = (so3_exp(w), so3_exp_derivative(w));
        assert_close(&record.label(), r.as_flattened(), &record.output("R").data, 1e-13, 1e-13);
        assert_close(&format!("{} dR_dw", record.label()), &flat(&d), &record.output("dR_dw").data, 1e-11, 1e-11);
    }
    for record in golden.op("se3_exp") {
        let xi = record.input("xi").data.as_slice().try_into().unwrap();
        let (t, d) = (se3_exp(xi), se3_exp_derivative(xi));
        assert_close(&record.label(), t.as_flattened(), &record.output("T").data[..12], 1e-13, 1e-13);
        assert_close(&format!("{} dT_dxi", record.label()), &flat(&d), &record.output("dT_dxi").data, 1e-11, 1e-11);
    }
}

#[test]
fn rigid_deformations_of_the_tape_match_the_exponential() {
    for record in golden().op("se3_exp").filter(|r| r.f32_inputs_exact) {
        // Four samples: the origin shows the translation, the unit vectors the columns of the rotation.
        let xi = record.input("xi").f32();
        let rows = |values: &[f32]| values.iter().flat_map(|&v| [v; 4]).collect::<Vec<f32>>();
        let points = [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        let mut arena = Arena::new();
        let mut tape = Tape::new(&mut arena, &[]);
        let x = tape.input(3, 4, &points).unwrap();
        let twist = tape.input(6, 4, &rows(&xi)).unwrap();
        let (omega, v) = (tape.slice(twist, 0..3).unwrap(), tape.slice(twist, 3..6).unwrap());
        let out = rigid(&mut tape, x, omega, v).unwrap();
        let j = tape.jacobian(out, twist).unwrap();
        let (out, j) = (tape.value(out).unwrap().data, tape.value(j).unwrap().data);
        // Row i, column c of T: samples 1..4 less the translation.
        let entry = |x: &[f32], row: usize, c: usize| {
            let at = |s: usize| f64::from(x[row * 4 + s]);
            if c == 3 { at(0) } else { at(c + 1) - at(0) }
        };
        let cells = (0..3).flat_map(|i| (0..4).map(move |c| (i, c)));
        let got: Vec<f64> = cells.clone().map(|(i, c)| entry(out, i, c)).collect();
        assert_close(&record.label(), &got, &record.output("T").data[..12], 1e-6, 1e-6);
        let got: Vec<f64> = cells.flat_map(|(i, c)| (0..6).map(move |k| entry(j, i * 6 + k, c))).collect();
        assert_close(&format!("{} dT_dxi", record.label()), &got, &record.output("dT_dxi").data, 1e-5, 1e-5);
    }
}

/// The neighbour's camera of a record of induced flow. Its rotation is rounded to `f32`, taken as it is.
fn neighbour(record: &Record) -> Camera {
    let c2w = &record.input("c2w").data;
    let column = |j: usize| DVec3::new(c2w[j], c2w[4 + j], c2w[8 + j]);
    let pose = Pose { r: DMat3::from_cols(column(0), -column(1), -column(2)), c: column(3) };
    let (width, height) = (record.param("width").usize() as u32, record.param("height").usize() as u32);
    let focal = record.param("focal").f64();
    Camera::pinhole(width, height, focal, focal, f64::from(width) / 2.0, f64::from(height) / 2.0, pose)
}

#[test]
fn induced_flow_and_its_gradients_match() {
    let golden = golden();
    for record in golden.op("induced_flow").chain(golden.op("induced_flow_ndc")) {
        let camera = neighbour(record);
        let map = (record.op == "induced_flow_ndc").then(|| {
            // The golden world has the GL axes of the camera that NDC refers to.
            let pose = Pose { r: DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)), c: DVec3::ZERO };
            let (focal, near) = (record.param("focal").f64(), record.param("near").f64());
            SpaceMap::Ndc { pose, ndc: Ndc::centred(camera.width, camera.height, focal, near) }
        });
        let coordinates = map.as_ref().map_or(Coordinates::World, Coordinates::Unit);
        // NDC to the unit cube, and how fast that goes.
        let unit = |x: DVec3| if map.is_some() { x * 0.5 + 0.5 } else { x };
        let per_unit = if map.is_some() { 0.5 } else { 1.0 };
        let weights = &record.input("weights").data;
        let samples: Vec<DVec3> =
            vec3s(record.input("points")).iter().zip(vec3s(record.input("scene_flow"))).map(|(&x, s)| x + s).collect();
        let sum = samples.iter().zip(weights).map(|(&x, &w)| x * w).sum::<DVec3>();
        let prepared = camera.prepare();
        let pixel = vec2s(record.input("pixel"))[0];
        let flow = flow_of_point(unit(sum), coordinates, &prepared, 1e-6, pixel).expect("in view");
        let label = record.label();
        assert_close(&label, &flow.to_array(), &record.output("flow").data, 1e-14, 1e-9);
        let there = (flow + pixel).to_array();
        assert_close(&label, &there, &record.output("pixel_neighbour").data, 1e-14, 1e-9);

        let flow_bar = vec2s(record.cotangent("flow"))[0];
        let total_bar = flow_bar + vec2s(record.cotangent("pixel_neighbour"))[0];
        let mut bar = NeighbourBar::default();
        let mut p_bar = flow_of_point_backward(unit(sum), coordinates, &prepared, 1e-6, total_bar, &mut bar);
        if let Some(map) = &map {
            assert_close(
                &label,
                &map.world_point(unit(sum)).to_array(),
                &record.output("point_world").data,
                1e-12,
                1e-13,
            );
            p_bar += map.world_point_backward(unit(sum), vec3(record.cotangent("point_world")));
        }
        p_bar *= per_unit;
        let points_bar: Vec<f64> = weights.iter().flat_map(|&w| (p_bar * w).to_array()).collect();
        let weights_bar: Vec<f64> = samples.iter().map(|x| x.dot(p_bar)).collect();
        let rows = |i: usize| [bar.pose.r.x_axis[i], -bar.pose.r.y_axis[i], -bar.pose.r.z_axis[i], bar.pose.c[i]];
        let check = |name: &str, got: &[f64]| {
            assert_close(&format!("{label} {name}_bar"), got, &record.grad(name).data, 1e-10, 1e-12);
        };
        check("points", &points_bar);
        check("scene_flow", &points_bar);
        check("weights", &weights_bar);
        check("pixel", &(-flow_bar).to_array());
        check("c2w", &[rows(0), rows(1), rows(2)].concat());

        // The f32 of a batch of one ray.
        let flat = |of: &[DVec3]| (0..3).flat_map(|a| of.iter().map(move |x| x[a] as f32)).collect::<Vec<f32>>();
        let places = flat(&samples.iter().map(|&x| unit(x)).collect::<Vec<_>>());
        let (offsets, w) = ([0, weights.len() as u32], record.input("weights").f32());
        let mut p = [0.0; 3];
        // The cube's origin is a corner of NDC: what the weights leave is at its middle.
        let middle = [0.5; 3];
        let rest = if map.is_some() { Rest::AtEnd(&middle) } else { Rest::Dropped };
        expected_points(&offsets, &places, &w, rest, &mut p);
        let cameras = [prepared];
        let neighbours = Neighbours { cameras: &cameras, of_ray: &[0], z_min: 1e-6 };
        let (mut flow, mut seen) = ([[0.0; 2]], [false]);
        let pixel = pixel.to_array().map(|v| v as f32);
        induced_flow(&p, coordinates, neighbours, &[pixel], &mut flow, &mut seen);
        assert!(seen[0]);
        assert_close(&label, &flow[0].map(f64::from), &record.output("flow").data, 0.0, 1e-3);
        let (mut x_bar, mut w_bar) = (vec![0.0; places.len()], vec![0.0; w.len()]);
        let unit_bar = (p_bar / per_unit).to_array().map(|v| v as f32);
        expected_points_backward(&offsets, &places, &w, rest, &unit_bar, &mut x_bar, &mut w_bar);
        let w_bar: Vec<f64> = w_bar.iter().map(|&v| f64::from(v)).collect();
        assert_close(&label, &w_bar, &record.grad("weights").data, 5e-5, 1e-5);
    }
}
