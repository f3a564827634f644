//! Splats against values and gradients made elsewhere: covariances, projections, colours, whole pictures.
//!
//! Scales and opacities are linear in the file, logarithms and logits here; `alpha` there is what is not left of the light.

use float_core::Simd;
use splat_core::{Gaussians, ProjectedGradient as Bars, Projection, Raster, RasterSettings, View};
use std::path::Path;
use testkit::golden::{Golden, Kind, Record, assert_close};

/// Gaussians that no pixel can tell from ones without an end, and pixels that never finish.
const IDEAL: RasterSettings =
    RasterSettings::DEFAULT.with_alpha_min(1e-30).with_alpha_max(0.999).with_transmittance_min(0.0);
const THRESHOLD: RasterSettings = RasterSettings::DEFAULT.with_alpha_max(0.999);

fn golden() -> Golden {
    Golden::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/splats.json")).unwrap()
}

/// World to camera, `[4, 4]` row by row; `fx fy cx cy`.
fn view(pose: &[f64], lens: &[f64], size: [usize; 2]) -> View {
    let row = |i: usize, k: usize| pose[4 * i + k] as f32;
    View {
        r: core::array::from_fn(|i| core::array::from_fn(|k| row(i, k))),
        t: core::array::from_fn(|i| row(i, 3)),
        f: [lens[0] as f32, lens[1] as f32],
        c: [lens[2] as f32, lens[3] as f32],
        size,
    }
}

/// `[n][components]` to `[components][n]`.
fn turn(rows: &[f64], n: usize, to: &mut [f32], f: impl Fn(f64) -> f64) {
    let components = rows.len().checked_div(n).unwrap_or(0);
    for (at, x) in rows.iter().enumerate() {
        to[at % components * n + at / components] = f(*x) as f32;
    }
}

/// `[components][n]` to `[n][components]`.
fn turn_back(rows: &[f32], n: usize) -> Vec<f64> {
    let components = rows.len().checked_div(n).unwrap_or(0);
    (0..rows.len()).map(|at| f64::from(rows[at % components * n + at / components])).collect()
}

/// One Gaussian, half opaque.
fn single(mean: [f64; 3], wxyz: &[f64], scale: &[f64]) -> Gaussians {
    let mut g = Gaussians::new(1, 0).unwrap();
    turn(&mean, 1, &mut g.mean, |x| x);
    turn(wxyz, 1, &mut g.wxyz, |x| x);
    turn(scale, 1, &mut g.log_scale, f64::ln);
    g
}

#[test]
fn covariances_are_seen_from_three_sides() {
    // At the same distance as the focal length, straight ahead: the picture's covariance is two rows and columns of the world's.
    for record in golden().op("covariance") {
        // Shorter than 1e-8 a quaternion has no direction here.
        if record.name == "tiny_quat" {
            continue;
        }
        let want = &record.output("cov").data;
        let largest = want.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        for simd in Simd::available() {
            for first in 0..3 {
                let axes = [first, (first + 1) % 3, (first + 2) % 3];
                let mut view = view(&[0.0; 16], &[1024.0, 1024.0, 32.0, 32.0], [64, 64]);
                for (row, axis) in axes.into_iter().enumerate() {
                    view.r[row][axis] = 1.0;
                }
                view.t[2] = 1024.0;
                let g = single([0.0; 3], &record.input("quat").data, &record.input("scale").data);
                let mut p = Projection::default();
                p.project(simd, &g, &view, &IDEAL, 0).unwrap();
                let [a, b, c] = p.gaussians[0].conic.map(f64::from);
                let det = a * c - b * b;
                let blur = f64::from(IDEAL.blur);
                let got = [c / det - blur, -b / det, a / det - blur];
                let at = |i: usize, k: usize| want[3 * axes[i] + axes[k]];
                // The way there and back through the inverse costs the ratio of its eigenvalues.
                let condition = (largest + blur) / blur;
                assert_close(&record.label(), &got, &[at(0, 0), at(0, 1), at(1, 1)], 1e-6, 2e-7 * condition * largest);
            }
        }
    }
}

#[test]
fn projections_match() {
    let (mut compared, levels) = (0, Simd::available().count());
    for record in golden().op("ewa_projection") {
        // Slopes are always clamped here; where they are inside, it does not matter.
        if record.name == "wide_clamped_clamp0" {
            continue;
        }
        let label = record.label();
        let mean = &record.input("mean").data;
        let g = single([mean[0], mean[1], mean[2]], &record.input("quat").data, &record.input("scale").data);
        let size = ["width", "height"].map(|side| record.param(side).usize());
        let view = view(&record.input("view").data, &record.input("intrinsics").data, size);
        // Depth 0.02 of 4 units on the way has lost five digits of seven.
        let (rtol, grad_rtol) = if record.name.starts_with("near") { (1e-4, 1e-3) } else { (2e-6, 2e-5) };
        for simd in Simd::available() {
            let mut p = Projection::default();
            p.project(simd, &g, &view, &IDEAL, 0).unwrap();
            if record.name == "wide_clamped_clamp1" {
                // Thirty deviations beside the picture.
                assert!(p.gaussians.is_empty());
                continue;
            }
            compared += 1;
            let f = p.gaussians[0];
            assert_close(&label, &f.uv.map(f64::from), &record.output("mean2d").data, rtol, 1e-6);
            assert_close(&label, &[f64::from(f.z)], &record.output("depth").data, rtol, 1e-7);
            assert_close(&label, &f.conic.map(f64::from), &record.output("conic").data, rtol, 0.0);

            // A gradient with respect to the covariance V is one of -V G V with respect to its inverse.
            let cov = &record.output("cov2d").data;
            let cov_bar = &record.cotangent("cov2d").data;
            let product = |a: &[f64], b: &[f64]| -> [f64; 4] {
                [0, 1, 2, 3].map(|at| (0..2).map(|k| a[at / 2 * 2 + k] * b[2 * k + at % 2]).sum())
            };
            let inner = product(&product(cov, cov_bar), cov);
            let own = &record.cotangent("conic").data;
            let conic = [own[0] - inner[0], own[1] - inner[1] - inner[2], own[2] - inner[3]];
            let uv = &record.cotangent("mean2d").data;
            let bar = Bars::<4> {
                uv: [uv[0] as f32, uv[1] as f32],
                conic: conic.map(|x| x as f32),
                opacity: 0.0,
                features: [0.0, 0.0, 0.0, record.cotangent("depth").scalar() as f32],
            };
            let mut grad = g.clone();
            p.backward(simd, &g, &view, &IDEAL, 0, &[bar], Some(3), &mut grad).unwrap();
            let scale = &record.input("scale").data;
            let log_scale: Vec<f64> = record.grad("scale").data.iter().zip(scale).map(|(g, s)| g * s).collect();
            for (name, got, want) in [
                ("mean", &grad.mean, &record.grad("mean").data),
                ("scale", &grad.log_scale, &log_scale),
                ("quat", &grad.wxyz, &record.grad("quat").data),
            ] {
                assert_close(&format!("{label} d{name}"), got, want, grad_rtol, 1e-5);
            }
        }
    }
    assert_eq!(compared, 12 * levels);
}

#[test]
fn colours_match() {
    for record in golden().op("sh_colour") {
        let label = record.label();
        let degree = record.param("degree").usize();
        let (mean, pose) = (&record.input("mean").data, &record.input("view").data);
        let o: [f64; 3] = core::array::from_fn(|k| -(0..3).map(|i| pose[4 * i + k] * pose[4 * i + 3]).sum::<f64>());
        // Only the camera's place counts: let it look at the Gaussian.
        let unit = |x: [f64; 3]| x.map(|c| c / x.iter().map(|x| x * x).sum::<f64>().sqrt());
        let cross = |a: [f64; 3], b: [f64; 3]| {
            [0, 1, 2].map(|k| a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3])
        };
        let z = unit([0, 1, 2].map(|k| mean[k] - o[k]));
        let x = unit(cross([0.0, 1.0, 0.0], z));
        let y = cross(z, x);
        let view = View::from_c2w([0, 1, 2].map(|k| [x[k], y[k], z[k]]), o, [50.0; 2], [16.0; 2], [32, 32]);
        let mut g = Gaussians::new(1, degree).unwrap();
        turn(mean, 1, &mut g.mean, |x| x);
        let sh = &record.input("sh").data;
        turn(&sh[..3], 1, &mut g.dc, |x| x);
        turn(&sh[3..], 1, &mut g.rest, |x| x);
        for simd in Simd::available() {
            let mut p = Projection::default();
            p.project(simd, &g, &view, &IDEAL, degree).unwrap();
            assert_close(&label, &p.rgb[0].map(f64::from), &record.output("colour").data, 1e-6, 1e-6);
            let bar = &record.cotangent("colour").data;
            let bar = Bars::<3> { features: [0, 1, 2].map(|c| bar[c] as f32), ..Bars::default() };
            let mut grad = g.clone();
            p.backward(simd, &g, &view, &IDEAL, degree, &[bar], None, &mut grad).unwrap();
            assert_close(&format!("{label} dmean"), &grad.mean, &record.grad("mean").data, 2e-5, 1e-6);
            let sh_bar = [&grad.dc[..], &grad.rest[..]].concat();
            assert_close(&format!("{label} dsh"), &sh_bar, &record.grad("sh").data, 2e-6, 1e-7);
        }
    }
}

/// The cloud of a `render` record.
fn cloud(record: &Record, degree: usize) -> Gaussians {
    let n = record.input("opacities").data.len();
    let mut g = Gaussians::new(n, degree).unwrap();
    turn(&record.input("means").data, n, &mut g.mean, |x| x);
    turn(&record.input("scales").data, n, &mut g.log_scale, f64::ln);
    turn(&record.input("quats").data, n, &mut g.wxyz, |x| x);
    turn(&record.input("opacities").data, n, &mut g.logit, |o| o.ln() - (-o).ln_1p());
    let numbers = 3 * (degree + 1) * (degree + 1);
    let sh = &record.input("sh").data;
    for i in 0..n {
        for (k, x) in sh[i * numbers..][..numbers].iter().enumerate() {
            let to = if k < 3 { &mut g.dc[k * n + i] } else { &mut g.rest[(k - 3) * n + i] };
            *to = *x as f32;
        }
    }
    g
}

/// Largest difference, of the largest entry, or of `least` if that is larger.
fn worst(got: &[f64], want: &[f64], least: f64) -> f64 {
    assert_eq!(got.len(), want.len());
    let largest = want.iter().fold(least, |m, x| m.max(x.abs()));
    // NaN is the worst.
    let most = got.iter().zip(want).map(|(a, b)| (a - b).abs()).fold(0.0, |m: f64, x| if x <= m { m } else { x });
    if most == 0.0 { 0.0 } else { most / largest }
}

#[test]
fn pictures_and_their_gradients_match() {
    for record in golden().op("render") {
        let label = record.label();
        let rules = match record.param("mode").str() {
            "ideal" => IDEAL,
            "threshold" => THRESHOLD,
            other => panic!("{label}: mode `{other}`"),
        };
        let size = ["width", "height"].map(|side| record.param(side).usize());
        let degree = record.param("sh_degree").usize();
        let (g, view) =
            (cloud(record, degree), view(&record.input("view").data, &record.input("intrinsics").data, size));
        let (n, pixels) = (g.len(), size[0] * size[1]);
        let background = &record.input("background").data;
        for simd in Simd::available() {
            let mut p = Projection::default();
            p.project(simd, &g, &view, &rules, degree).unwrap();
            let features: Vec<[f32; 4]> =
                p.rgb.iter().zip(&p.gaussians).map(|(c, f)| [c[0], c[1], c[2], f.z]).collect();
            let mut raster = Raster::<4>::default();
            raster.draw(simd, &p.gaussians, &features, size, &rules).unwrap();
            let mut planes = vec![0.0_f32; 5 * pixels];
            raster.planes(&mut planes).unwrap();
            let left = &planes[4 * pixels..];
            let over = |c: usize, i: usize| f64::from(planes[c * pixels + i]) + background[c] * f64::from(left[i]);
            let image: Vec<f64> = (0..3 * pixels).map(|at| over(at % 3, at / 3)).collect();
            // Needles: their conics have lost a digit.
            let atol = if record.kind == Kind::Random { 2e-6 } else { 2e-5 };
            assert_close(&format!("{label} image"), &image, &record.output("image").data, 0.0, atol);
            let alpha: Vec<f64> = left.iter().map(|&t| 1.0 - f64::from(t)).collect();
            assert_close(&format!("{label} alpha"), &alpha, &record.output("alpha").data, 0.0, atol);
            assert_close(
                &format!("{label} depth"),
                &planes[3 * pixels..4 * pixels],
                &record.output("depth").data,
                0.0,
                5.0 * atol,
            );

            let bar = &record.cotangent("image").data;
            let mut value_bar = vec![0.0_f32; 5 * pixels];
            for i in 0..pixels {
                for c in 0..3 {
                    value_bar[c * pixels + i] = bar[3 * i + c] as f32;
                }
                value_bar[3 * pixels + i] = record.cotangent("depth").data[i] as f32;
                let through: f64 = (0..3).map(|c| bar[3 * i + c] * background[c]).sum();
                value_bar[4 * pixels + i] = (through - record.cotangent("alpha").data[i]) as f32;
            }
            let mut records = Vec::new();
            raster.backward(simd, &p.gaussians, &features, &rules, &value_bar, &mut records).unwrap();
            let mut grad = g.clone();
            p.backward(simd, &g, &view, &rules, degree, &records, Some(3), &mut grad).unwrap();
            if n == 0 {
                continue;
            }
            // Through the logarithm and the logit.
            let through = |name: &str, input: &str, slope: fn(f64) -> f64| -> Vec<f64> {
                record.grad(name).data.iter().zip(&record.input(input).data).map(|(g, x)| g * slope(*x)).collect()
            };
            let numbers = 3 * (degree + 1) * (degree + 1);
            let sh_bar: Vec<f64> = (0..n * numbers)
                .map(|at| (at / numbers, at % numbers))
                .map(|(i, k)| f64::from(if k < 3 { grad.dc[k * n + i] } else { grad.rest[(k - 3) * n + i] }))
                .collect();
            let scales = through("scales", "scales", |s| s);
            // A sphere does not turn: its gradients are 0 but for rounding.
            let turns = 1e-3 * scales.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
            let opacities = through("opacities", "opacities", |o| o * (1.0 - o));
            let errors = [
                ("means", worst(&turn_back(&grad.mean, n), &record.grad("means").data, 0.0)),
                ("scales", worst(&turn_back(&grad.log_scale, n), &scales, 0.0)),
                ("quats", worst(&turn_back(&grad.wxyz, n), &record.grad("quats").data, turns)),
                ("opacities", worst(&turn_back(&grad.logit, n), &opacities, 0.0)),
                ("sh", worst(&sh_bar, &record.grad("sh").data, 0.0)),
            ];
            println!("{label} {:?}: {errors:?}", simd.level());
            // Footprints of needles are 800 times as long as broad: that many roundings, were it not for luck.
            let bound = match (record.kind, &*record.name) {
                (Kind::Random, _) => 1e-5,
                (_, "needles") => 2e-5,
                _ => 1e-3,
            };
            for (name, error) in errors {
                assert!(error < bound, "{label} d{name}: {error}");
            }
        }
    }
}
