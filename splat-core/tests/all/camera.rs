//! Gradients with respect to the camera, against differences of whole pictures of the specification.

use crate::common::{bars, beside_the_picture, cloud, shoot, view};
use crate::twin::{self, Camera};
use float_core::Simd;
use splat_core::{CameraGradient, Gaussians, RasterSettings, View, Widening};

/// Names of the numbers of a camera's gradient.
const NAMES: [&str; 10] = ["omega x", "omega y", "omega z", "v x", "v y", "v z", "fx", "fy", "cx", "cy"];

fn numbers(g: &CameraGradient) -> [f64; 10] {
    let mut out = [0.0; 10];
    out[..6].copy_from_slice(&g.xi);
    out[6..8].copy_from_slice(&g.f);
    out[8..].copy_from_slice(&g.c);
    out
}

/// The camera with number `k` moved by `by`: the world-to-camera transform multiplied from the left, or intrinsics.
fn moved(camera: &Camera, k: usize, by: f64) -> Camera {
    let mut out = *camera;
    match k {
        0..3 => {
            let (s, c) = by.sin_cos();
            let (i, j) = ((k + 1) % 3, (k + 2) % 3);
            let turn = |x: [f64; 3]| {
                let mut y = x;
                (y[i], y[j]) = (c * x[i] - s * x[j], s * x[i] + c * x[j]);
                y
            };
            for column in 0..3 {
                let turned = turn([0, 1, 2].map(|row| camera.r[row][column]));
                (0..3).for_each(|row| out.r[row][column] = turned[row]);
            }
            out.t = turn(camera.t);
        }
        3..6 => out.t[k - 3] += by,
        6..8 => out.f[k - 6] += by,
        _ => out.c[k - 8] += by,
    }
    out
}

/// Largest error relative to the number and to a thousandth of the largest of its kind; `None` where a decision is too near to
/// difference over.
fn worst(g: &Gaussians, view: &View, settings: &RasterSettings, simd: Simd, seed: u64) -> Option<(f64, String)> {
    let (bar, at, camera) = (bars(seed, view.size), twin::flat(g), twin::camera(view));
    let picture = |camera: &Camera| {
        twin::draw(&twin::project_by(&at, g.len(), g.degree(), camera, settings), view.size, settings)
    };
    if picture(&camera).margin() < 1e-5 {
        return None;
    }
    let loss =
        |camera: &Camera| -> f64 { picture(camera).planes.iter().zip(&bar).map(|(a, b)| a * f64::from(*b)).sum() };
    let (_, got) = shoot(simd, g, view, settings).gradients_with_camera(simd, g, view, settings, &bar);
    let got = numbers(&got);
    let mut worst = (0.0, String::new());
    for (k, got_k) in got.into_iter().enumerate() {
        // Radians, world units; pixels.
        let h = if k < 6 { 1e-6 } else { 1e-4 };
        let want = (loss(&moved(&camera, k, h)) - loss(&moved(&camera, k, -h))) / (2.0 * h);
        let kind = [0..3, 3..6, 6..8, 8..10].into_iter().find(|kind| kind.contains(&k)).unwrap();
        let scale = got[kind].iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        let error = (got_k - want).abs() / (1e-3 * scale + want.abs());
        if error > worst.0 || error.is_nan() {
            worst = (error, format!("{}: {got_k}, expected {want}, largest {scale}", NAMES[k]));
        }
    }
    Some(worst)
}

fn widening(k: u64) -> RasterSettings {
    RasterSettings::DEFAULT.with_widening(if k.is_multiple_of(2) { Widening::Keeps } else { Widening::Dims })
}

#[test]
fn gradients_of_the_camera_are_those_of_the_specification() {
    let mut compared = 0;
    for seed in 0..10 {
        let degree = (3 - seed % 4) as usize;
        let (mut g, view) = (cloud(400 + seed, 14, degree), view([21, 18]));
        // Colours that depend strongly on the direction.
        g.rest.iter_mut().for_each(|x| *x *= 2.0);
        for simd in Simd::available() {
            let Some((worst, what)) = worst(&g, &view, &widening(seed / 2), simd, seed) else { continue };
            compared += 1;
            println!("{seed} {:?}: {worst:.1e}", simd.level());
            assert!(worst < 2e-4, "{seed}: {what}");
        }
    }
    assert!(compared >= 6 * Simd::available().count(), "{compared}");
}

#[test]
fn the_view_dependence_of_colours_is_part_of_the_camera_gradient() {
    // With and without it, the position's part differs by far more than the bound of the test above.
    let (mut g, view, settings) = (cloud(401, 14, 2), view([21, 18]), widening(0));
    g.rest.iter_mut().for_each(|x| *x *= 2.0);
    let bar = bars(1, view.size);
    let of = |g: &Gaussians| {
        let (_, camera) =
            shoot(Simd::best(), g, &view, &settings).gradients_with_camera(Simd::best(), g, &view, &settings, &bar);
        camera
    };
    let with = of(&g);
    // The same colours for this view, without a dependence on the direction.
    let shot = shoot(Simd::best(), &g, &view, &settings);
    let mut flat = g.clone();
    flat.rest.fill(0.0);
    for (f, rgb) in shot.p.gaussians.iter().zip(&shot.p.rgb) {
        for (c, x) in rgb.iter().enumerate() {
            flat.dc[c * g.len() + f.index as usize] = (x - 0.5) / splat_core::SH_0;
        }
    }
    let without = of(&flat);
    let difference: f64 = (3..6).map(|k| (with.xi[k] - without.xi[k]).abs()).sum();
    let size: f64 = (3..6).map(|k| with.xi[k].abs()).sum();
    assert!(difference > 0.01 * size, "{difference} of {size}");
}

#[test]
fn gradients_of_the_camera_hold_where_the_jacobian_is_clamped() {
    let view = view([21, 18]);
    let mut compared = 0;
    for (k, g) in beside_the_picture(&view) {
        for simd in Simd::available() {
            let Some((worst, what)) = worst(&g, &view, &widening(k as u64), simd, 7) else { continue };
            compared += 1;
            println!("{k} {:?}: {worst:.1e}", simd.level());
            assert!(worst < 2e-4, "{k}: {what}");
        }
    }
    assert!(compared >= 3 * Simd::available().count(), "{compared}");
}

#[test]
fn asking_for_the_camera_changes_no_bit_of_the_cloud_and_nothing_visible_has_none() {
    let (g, view, settings) = (cloud(1, 2500, 2), view([70, 50]), RasterSettings::DEFAULT);
    let bar = bars(2, view.size);
    for simd in Simd::available() {
        let mut shot = shoot(simd, &g, &view, &settings);
        let plain = shot.gradients(simd, &g, &view, &settings, &bar);
        let (with, camera) = shot.gradients_with_camera(simd, &g, &view, &settings, &bar);
        let bits = |g: &Gaussians| -> Vec<u32> {
            g.fields().into_iter().flat_map(|(_, x)| x.iter().map(|x| x.to_bits()).collect::<Vec<_>>()).collect()
        };
        assert_eq!(bits(&plain), bits(&with));
        assert!(numbers(&camera).iter().all(|x| x.is_finite() && *x != 0.0), "{camera:?}");
        // Moving the camera is moving all centres in its axes: `v_bar = R sum(mean_bar)`.
        let back = |k: usize| plain.mean[k * g.len()..][..g.len()].iter().map(|x| f64::from(*x)).sum::<f64>();
        for i in 0..3 {
            let want: f64 = (0..3).map(|k| f64::from(view.r[i][k]) * back(k)).sum();
            let scale: f64 = plain.mean.iter().map(|x| f64::from(x.abs())).sum();
            assert!((camera.xi[3 + i] - want).abs() < 1e-6 * scale, "{i}: {} and {want}", camera.xi[3 + i]);
        }
    }
    let none = Gaussians::new(0, 1).unwrap();
    let (_, camera) =
        shoot(Simd::best(), &none, &view, &settings).gradients_with_camera(Simd::best(), &none, &view, &settings, &bar);
    assert_eq!(camera, CameraGradient::default());
}
