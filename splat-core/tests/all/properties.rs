//! What holds for every picture, whatever is in it.

use crate::common::{bars, cloud, reordered, shoot, view};
use crate::twin;
use float_core::Simd;
use float_core::rng::Rng;
use splat_core::{DrawStats, Gaussians, Projection, Raster, RasterSettings, TILE, View};

const SETTINGS: RasterSettings = RasterSettings::DEFAULT;

fn largest_difference(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, |m, x| if x <= m { m } else { x })
}

#[test]
fn the_order_of_storage_changes_no_bit() {
    // More than one chunk.
    let (n, view) = (1500, view([70, 50]));
    let mut g = cloud(1, n, 2);
    // Smaller ones, so that most pixels see many and few finish.
    g.log_scale.iter_mut().for_each(|x| *x -= 1.0);
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by_key(|&i| Rng::new(4, 4).u64_at(i as u64));
    let other = reordered(&g, &order);
    let bar = bars(2, view.size);
    for simd in Simd::available() {
        let (mut a, mut b) = (shoot(simd, &g, &view, &SETTINGS), shoot(simd, &other, &view, &SETTINGS));
        assert_eq!(a.planes, b.planes);
        assert_eq!(a.drawn, b.drawn);
        let grads = [a.gradients(simd, &g, &view, &SETTINGS, &bar), b.gradients(simd, &other, &view, &SETTINGS, &bar)];
        assert_eq!(reordered(&grads[0], &order), grads[1]);
    }
}

#[test]
fn nothing_to_see_is_no_error() {
    for size in [[1, 1], [40, 30]] {
        let view = view(size);
        let mut behind = cloud(2, 30, 1);
        for a in 0..3 {
            for i in 0..30 {
                // Mirrored about the camera's centre.
                behind.mean[a * 30 + i] = 2.0 * view.centre()[a] - behind.mean[a * 30 + i];
            }
        }
        for g in [cloud(2, 0, 3), behind] {
            for simd in Simd::available() {
                let mut shot = shoot(simd, &g, &view, &SETTINGS);
                assert!(shot.p.gaussians.is_empty());
                let pixels = size[0] * size[1];
                assert_eq!(shot.planes, [vec![0.0; 4 * pixels], vec![1.0; pixels]].concat());
                let tiles = (size[0].div_ceil(TILE) * size[1].div_ceil(TILE)) as u64;
                assert_eq!(shot.drawn, DrawStats { pairs: 0, hidden: 0, empty_tiles: tiles, tiles });
                let grad = shot.gradients(simd, &g, &view, &SETTINGS, &bars(1, size));
                assert!(grad.fields().iter().all(|(_, x)| x.iter().all(|&x| x == 0.0)));
            }
        }
    }
}

#[test]
fn pictures_of_any_size_are_the_corner_of_a_larger_one() {
    // Small ones in the middle: no slope is clamped.
    let mut g = cloud(3, 150, 1);
    g.mean.iter_mut().for_each(|x| *x *= 0.3);
    g.log_scale.iter_mut().for_each(|x| *x -= 0.5);
    let large = View { f: [60.0, 66.0], c: [24.0, 24.0], ..view([48, 48]) };
    for simd in Simd::available() {
        let whole = shoot(simd, &g, &large, &SETTINGS);
        for size in [[1, 1], [1, 48], [48, 1], [15, 17], [16, 16], [17, 15], [31, 33], [47, 48]] {
            // Every second one from the middle on.
            let [x, y] = size.map(|n| if n % 2 == 1 { 48 - n } else { 0 });
            let part = View { size, c: [24.0 - x as f32, 24.0 - y as f32], ..large };
            // Limits of slopes move with the window: leave out whom they touch.
            let inside: Vec<usize> = (0..g.len())
                .filter(|&i| {
                    let p: [f32; 3] = core::array::from_fn(|a| {
                        (0..3).map(|k| large.r[a][k] * g.mean[k * g.len() + i]).sum::<f32>() + large.t[a]
                    });
                    (0..2).all(|a| {
                        let (slope, margin) = (p[a] / p[2], 0.15 * size[a] as f32 / part.f[a]);
                        slope > -part.c[a] / part.f[a] - margin
                            && slope < (size[a] as f32 - part.c[a]) / part.f[a] + margin
                    })
                })
                .collect();
            let few = reordered(&g, &inside);
            let (got, want) = (shoot(simd, &few, &part, &SETTINGS), shoot(simd, &few, &large, &SETTINGS));
            for k in 0..5 {
                for row in 0..size[1] {
                    let got = &got.planes[(k * size[1] + row) * size[0]..][..size[0]];
                    let want = &want.planes[(k * 48 + y + row) * 48 + x..][..size[0]];
                    assert!(largest_difference(got, want) < 2e-5, "{size:?}, plane {k}, row {row}");
                }
            }
        }
        assert!(whole.planes.iter().any(|&x| x > 0.5));
    }
}

/// One Gaussian in front of a camera that stands at the origin and looks along z.
fn alone(depth: f32, scale: f32, logit: f32, dc: [f32; 3]) -> (Gaussians, View) {
    let mut g = Gaussians::new(1, 0).unwrap();
    g.mean[2] = depth;
    g.log_scale.fill(scale.ln());
    g.logit[0] = logit;
    g.dc.copy_from_slice(&dc);
    let r = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    (g, View { r, t: [0.0; 3], f: [20.0; 2], c: [8.5; 2], size: [17, 17] })
}

#[test]
fn one_gaussian_is_what_the_formula_says() {
    // On the axis, 4 units away: a deviation of 20 * 0.5 / 4 pixels, and the blur.
    let (g, view) = alone(4.0, 0.5, 1.2, [0.3, -0.5, 1.0]);
    let variance = 2.5_f64 * 2.5 + 0.3;
    let o = 1.0 / (1.0 + (-1.2_f64).exp());
    for simd in Simd::available() {
        let shot = shoot(simd, &g, &view, &SETTINGS);
        for y in 0..17 {
            for x in 0..17 {
                let d2 = ((x as f64 - 8.0).powi(2) + (y as f64 - 8.0).powi(2)) / variance;
                let alpha = o * (-0.5 * d2).exp();
                let alpha = if alpha > 1.0 / 255.0 { alpha } else { 0.0 };
                for (k, c) in [0.3, -0.5, 1.0].into_iter().enumerate() {
                    let want = alpha * (0.5 + 0.282_094_79 * c);
                    let got = f64::from(shot.planes[k * 289 + y * 17 + x]);
                    assert!((got - want).abs() < 1e-6, "{x} {y}: {got}, expected {want}");
                }
                assert!((f64::from(shot.planes[3 * 289 + y * 17 + x]) - 4.0 * alpha).abs() < 2e-6);
                assert!((f64::from(shot.planes[4 * 289 + y * 17 + x]) - (1.0 - alpha)).abs() < 1e-6);
            }
        }
    }
}

#[test]
fn a_pixel_is_finished_before_what_would_leave_too_little_light() {
    // All opaque: 0.99 each, and the second would leave 1e-4 of the light, rounded a little more or less.
    let (g, view) = alone(4.0, 0.5, 13.0, [0.0; 3]);
    let mut three = reordered(&g, &[0, 0, 0]);
    three.mean[6..].copy_from_slice(&[4.0, 5.0, 6.0]);
    let settings = SETTINGS.with_transmittance_min(1.1e-4);
    let shot = shoot(Simd::best(), &three, &view, &settings);
    let middle = shot.planes[4 * 289 + 8 * 17 + 8];
    assert!((middle - 0.01).abs() < 1e-6, "{middle}");
    let depth = shot.planes[3 * 289 + 8 * 17 + 8];
    assert!((depth - 0.99 * 4.0).abs() < 1e-5, "only the first: {depth}");
}

#[test]
fn shares_and_what_is_left_make_one() {
    for seed in 0..4 {
        let (g, view) = (cloud(20 + seed, 800, 0), view([50, 40]));
        for simd in Simd::available() {
            let p = shoot(simd, &g, &view, &SETTINGS).p;
            let mut raster = Raster::<1>::default();
            raster.draw(simd, &p.gaussians, &vec![[1.0]; p.gaussians.len()], view.size, &SETTINGS).unwrap();
            let mut planes = vec![f32::NAN; 2 * 2000];
            raster.planes(&mut planes).unwrap();
            for i in 0..2000 {
                let (sum, left) = (planes[i], planes[2000 + i]);
                assert!((sum + left - 1.0).abs() < 1e-6 && left > 1e-4, "{sum} + {left}");
            }
        }
    }
}

#[test]
fn one_more_gaussian_never_leaves_more_light() {
    let view = view([50, 40]);
    // Few enough that no pixel finishes.
    let g = cloud(30, 25, 0);
    let light = |g: &Gaussians| shoot(Simd::best(), g, &view, &SETTINGS).planes[4 * 2000..].to_vec();
    let mut before = vec![1.0; 2000];
    for n in 1..=25 {
        let now = light(&reordered(&g, &(0..n).collect::<Vec<_>>()));
        for (now, before) in now.iter().zip(&before) {
            // Another place in the product may round otherwise.
            assert!(*now <= before * (1.0 + 2e-6) || *before < 1e-3, "{n}: {before} to {now}");
        }
        before = now;
    }
    assert!(before.iter().any(|&x| x < 0.1));
}

#[test]
fn two_of_the_same_are_both_drawn_the_first_in_front() {
    let (g, view) = alone(4.0, 0.5, 0.0, [1.0, 0.0, 0.0]);
    let mut two = reordered(&g, &[0, 0]);
    (two.dc[1], two.dc[3]) = (0.0, 1.0);
    for simd in Simd::available() {
        let shot = shoot(simd, &two, &view, &SETTINGS);
        let at = 8 * 17 + 8;
        let (lit, dim) = (0.5 + 0.282_094_8, 0.5);
        let want = [0.5 * lit + 0.25 * dim, 0.5 * dim + 0.25 * lit];
        assert!((shot.planes[at] - want[0]).abs() < 1e-6 && (shot.planes[289 + at] - want[1]).abs() < 1e-6);
        assert!((shot.planes[4 * 289 + at] - 0.25).abs() < 1e-6);
    }
}

/// The cloud, turned about the camera's frame and moved; without colours that turn.
fn moved(g: &Gaussians, r: [[f64; 3]; 3], wxyz: [f64; 4], t: [f64; 3], scale: f64) -> Gaussians {
    let (n, mut out) = (g.len(), g.clone());
    for i in 0..n {
        let x: [f64; 3] = core::array::from_fn(|k| f64::from(g.mean[k * n + i]));
        let q: [f64; 4] = core::array::from_fn(|k| f64::from(g.wxyz[k * n + i]));
        let [a, b, c, d] = wxyz;
        let turned = [
            a * q[0] - b * q[1] - c * q[2] - d * q[3],
            a * q[1] + b * q[0] + c * q[3] - d * q[2],
            a * q[2] - b * q[3] + c * q[0] + d * q[1],
            a * q[3] + b * q[2] - c * q[1] + d * q[0],
        ];
        for k in 0..3 {
            out.mean[k * n + i] = (scale * (0..3).map(|m| r[k][m] * x[m]).sum::<f64>() + t[k]) as f32;
            out.log_scale[k * n + i] = (f64::from(g.log_scale[k * n + i]) + scale.ln()) as f32;
        }
        for (k, q) in turned.into_iter().enumerate() {
            out.wxyz[k * n + i] = q as f32;
        }
    }
    out
}

#[test]
fn turning_and_scaling_the_world_with_the_camera_changes_nothing() {
    let (s, c) = (0.35_f64.sin(), 0.35_f64.cos());
    // By 0.7 about y.
    let wxyz = [c, 0.0, s, 0.0];
    let (cos, sin) = (0.7_f64.cos(), 0.7_f64.sin());
    let r = [[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]];
    let one = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for seed in 0..4 {
        let (g, here) = (cloud(40 + seed, 200, 0), view([48, 40]));
        let want = shoot(Simd::best(), &g, &here, &SETTINGS).planes;
        for (r, wxyz, t, scale) in [
            (r, wxyz, [0.5, -0.2, 1.0], 1.0),
            (one, [1.0, 0.0, 0.0, 0.0], [0.0; 3], 64.0),
            (one, [1.0, 0.0, 0.0, 0.0], [0.0; 3], 1.0 / 64.0),
        ] {
            let there = moved(&g, r, wxyz, t, scale);
            // x_camera = scale (R_here R^T (x - t) / scale + t_here).
            let back: [[f64; 3]; 3] = core::array::from_fn(|i| {
                core::array::from_fn(|k| (0..3).map(|m| f64::from(here.r[i][m]) * r[k][m]).sum())
            });
            let at = |i: usize| scale * f64::from(here.t[i]) - (0..3).map(|k| back[i][k] * t[k]).sum::<f64>();
            let view = View { r: back.map(|row| row.map(|x| x as f32)), t: [0, 1, 2].map(|i| at(i) as f32), ..here };
            let settings = SETTINGS.with_near(SETTINGS.near * scale as f32);
            let mut got = shoot(Simd::best(), &there, &view, &settings).planes;
            got[3 * 1920..4 * 1920].iter_mut().for_each(|z| *z /= scale as f32);
            // A decision may turn: 1/255 of a colour, at few pixels.
            let turned = got.iter().zip(&want).filter(|(a, b)| (**a - **b).abs() > 1e-4).count();
            assert!(turned <= 5 && largest_difference(&got, &want) < 0.05, "{seed}: {turned} differ");
        }
    }
}

#[test]
fn gradients_are_linear_in_those_of_the_picture() {
    let (g, view) = (cloud(50, 120, 2), view([40, 30]));
    for simd in Simd::available() {
        let mut shot = shoot(simd, &g, &view, &SETTINGS);
        let (one, two) = (bars(1, view.size), bars(2, view.size));
        let both: Vec<f32> = one.iter().zip(&two).map(|(a, b)| 2.0 * a - 0.5 * b).collect();
        let mut of = |bar: &[f32]| twin::flat(&shot.gradients(simd, &g, &view, &SETTINGS, bar));
        let (one, two, both) = (of(&one), of(&two), of(&both));
        let scale = both.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        for ((a, b), both) in one.iter().zip(&two).zip(&both) {
            assert!((2.0 * a - 0.5 * b - both).abs() < 1e-5 * scale, "{a}, {b}, together {both}");
        }
        // Exactly so for powers of two.
        let doubled: Vec<f32> = bars(1, view.size).iter().map(|x| 2.0 * x).collect();
        assert!(of(&doubled).iter().zip(&one).all(|(d, a)| *d == 2.0 * a));
    }
}

#[test]
fn far_away_in_the_world_costs_digits_and_nothing_else() {
    // A camera a million units from the origin, Gaussians as large as rounding there.
    let (mut g, mut view) = alone(4.0, 0.5, 1.0, [1.0; 3]);
    let here = shoot(Simd::best(), &g, &view, &SETTINGS).planes;
    g.mean[0] += 1e6;
    view.t[0] -= 1e6;
    assert_eq!(shoot(Simd::best(), &g, &view, &SETTINGS).planes, here);
    // A million units ahead, a fifth of it large: the same picture, but for depth.
    let (far, _) = alone(4e6, 5e5, 1.0, [1.0; 3]);
    let got = shoot(Simd::best(), &far, &alone(4.0, 1.0, 0.0, [0.0; 3]).1, &SETTINGS).planes;
    assert!(largest_difference(&got[..3 * 289], &here[..3 * 289]) < 1e-6);
}

#[test]
fn a_gaussian_at_the_cameras_centre_is_behind_it_and_one_without_a_rotation_is_not_turned() {
    let (mut g, view) = alone(0.0, 1.0, 1.0, [1.0; 3]);
    assert!(shoot(Simd::best(), &g, &view, &SETTINGS).p.gaussians.is_empty());
    // As near as may be.
    g.mean[2] = SETTINGS.near * 1.001;
    let mut shot = shoot(Simd::best(), &g, &view, &SETTINGS);
    assert_eq!(shot.p.gaussians.len(), 1);
    let bar = bars(5, view.size);
    let grad = shot.gradients(Simd::best(), &g, &view, &SETTINGS, &bar);
    assert!(grad.fields().iter().all(|(_, x)| x.iter().all(|x| x.is_finite())));
    let (mut g, view) = alone(4.0, 0.5, 1.0, [1.0; 3]);
    g.log_scale[0] = 0.0;
    let want = shoot(Simd::best(), &g, &view, &SETTINGS).planes;
    for wxyz in [[0.0; 4], [1e-9, 0.0, 1e-9, 0.0], [5.0, 0.0, 0.0, 0.0], [-1e-3, 0.0, 0.0, 0.0]] {
        g.wxyz.copy_from_slice(&wxyz);
        let mut shot = shoot(Simd::best(), &g, &view, &SETTINGS);
        assert!(largest_difference(&shot.planes, &want) < 1e-6, "{wxyz:?}");
        let grad = shot.gradients(Simd::best(), &g, &view, &SETTINGS, &bar);
        assert!(wxyz[0] == 5.0 || wxyz[0] < 0.0 || grad.wxyz.iter().all(|&x| x == 0.0), "{:?}", grad.wxyz);
    }
}

#[test]
fn quaternions_of_any_length_turn_alike_and_their_gradients_are_less_the_longer_they_are() {
    let (g, view) = (cloud(61, 60, 0), view([40, 30]));
    // By powers of two: not a bit is lost.
    let bar = bars(6, view.size);
    for simd in Simd::available() {
        let mut shot = shoot(simd, &g, &view, &SETTINGS);
        let grad = shot.gradients(simd, &g, &view, &SETTINGS, &bar);
        for power in [-20, 30, 62, 66, 100, 124] {
            let factor = 2.0_f32.powi(power);
            let mut long = g.clone();
            long.wxyz.iter_mut().for_each(|x| *x *= factor);
            let mut shot_long = shoot(simd, &long, &view, &SETTINGS);
            assert!(shot_long.planes == shot.planes, "{:?}, 2^{power}", simd.level());
            let got = shot_long.gradients(simd, &long, &view, &SETTINGS, &bar);
            assert!((&got.mean, &got.log_scale) == (&grad.mean, &grad.log_scale), "{:?}, 2^{power}", simd.level());
            // Longer still, the smallest gradients end among denormal numbers.
            if power <= 66 {
                let back: Vec<f32> = got.wxyz.iter().map(|x| x * factor).collect();
                assert!(back == grad.wxyz, "{:?}, 2^{power}", simd.level());
            }
        }
    }
}

#[test]
fn degrees_above_those_asked_for_play_no_part() {
    let (g, view) = (cloud(60, 50, 3), view([30, 20]));
    let mut flat = g.clone();
    flat.rest.fill(0.0);
    let (mut a, mut b) = (Projection::default(), Projection::default());
    a.project(Simd::best(), &g, &view, &SETTINGS, 0).unwrap();
    b.project(Simd::best(), &flat, &view, &SETTINGS, 3).unwrap();
    assert_eq!(a.gaussians, b.gaussians);
    assert!(a.rgb.iter().flatten().zip(b.rgb.iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-6));
}

#[test]
fn what_is_left_out_behind_enough_is_worth_no_more() {
    let view = view([70, 50]);
    let (mut pixels_ended, mut hidden) = (0, [0, 0]);
    for seed in 0..6 {
        let mut g = cloud(20 + seed, 800, 1);
        // Opaque ones in front of others.
        g.logit.iter_mut().for_each(|x| *x += 3.0);
        for simd in Simd::available() {
            let whole = shoot(simd, &g, &view, &SETTINGS);
            let brightest = whole.p.rgb.iter().flatten().fold(0.0_f32, |most, &c| most.max(c));
            for budget in [1.0 / 2048.0, 1.0 / 255.0, 1.0 / 16.0] {
                let part = shoot(simd, &g, &view, &SETTINGS.with_transmittance_stop(budget / brightest));
                let pixels = 70 * 50;
                let error = largest_difference(&part.planes[..3 * pixels], &whole.planes[..3 * pixels]);
                assert!(error <= budget * (1.0 + 1e-5), "{error} for {budget}");
                let light = largest_difference(&part.planes[4 * pixels..], &whole.planes[4 * pixels..]);
                assert!(light <= budget / brightest * (1.0 + 1e-5), "{light}");
                pixels_ended += usize::from(error > 0.0);
                hidden = [hidden[0] + whole.drawn.hidden, hidden[1] + part.drawn.hidden];
            }
        }
    }
    assert!(pixels_ended > 10 && hidden[1] > hidden[0], "{pixels_ended} {hidden:?}");
}

#[test]
fn gradients_of_pictures_that_end_early_are_those_of_what_they_show() {
    // The last that counts is the one that leaves little enough; what is behind has no gradient.
    let view = view([16, 16]);
    let mut g = cloud(7, 3, 0);
    for i in 0..3 {
        for a in 0..3 {
            // One behind the other, all over the picture.
            g.mean[a * 3 + i] = view.centre()[a] + view.r[2][a] * (2.0 + i as f32);
            g.log_scale[a * 3 + i] = 3.0;
        }
        g.logit[i] = 2.0;
    }
    let settings = SETTINGS.with_transmittance_stop(0.2);
    for simd in Simd::available() {
        let mut shot = shoot(simd, &g, &view, &settings);
        let grad = shot.gradients(simd, &g, &view, &settings, &bars(3, view.size));
        assert!(grad.logit[0] != 0.0 && grad.logit[1] == 0.0 && grad.logit[2] == 0.0, "{:?}", grad.logit);
    }
}
