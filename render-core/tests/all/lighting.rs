//! Lighting by spherical harmonics: identities, gradients, projection, rotation, fitting, shading.

use proptest::prelude::*;
use render_core::lighting::{
    COEFFICIENTS, COSINE_LOBE, FitError, Kind, Lighting, MIN_IRRADIANCE, Sun, Tone, basis, basis_gradient,
    fit_irradiance, outward_normal, outward_normal_backward, project_equirect, shade, shade_backward, sun_and_sky,
    sun_and_sky_backward,
};
use std::f64::consts::PI;
use testkit::gradient::{PairTolerances, Tolerance, check_f32_pair, check_pair, compare, cotangent};

type Vec3 = [f64; 3];

fn unit(x: Vec3) -> Vec3 {
    let n = x.iter().map(|x| x * x).sum::<f64>().sqrt();
    x.map(|x| x / n)
}

fn dot(a: Vec3, b: Vec3) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Directions spread evenly over the sphere, each for the same solid angle.
fn sphere(n: usize) -> impl Iterator<Item = Vec3> {
    let golden = PI * (3.0 - 5.0_f64.sqrt());
    (0..n).map(move |i| {
        let z = 1.0 - (2 * i + 1) as f64 / n as f64;
        let (s, c) = (golden * i as f64).sin_cos();
        let r = (1.0 - z * z).sqrt();
        [r * c, r * s, z]
    })
}

/// Gauss-Legendre in height times even steps in azimuth: exact for polynomials of the degrees used here.
fn exact_sphere() -> Vec<(Vec3, f64)> {
    let nodes = [
        (0.0, 128.0 / 225.0),
        (0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
        (0.906_179_845_938_664, 0.236_926_885_056_189_1),
    ];
    let mut out = Vec::new();
    for (z, w) in nodes.into_iter().flat_map(|(z, w)| if z == 0.0 { vec![(z, w)] } else { vec![(z, w), (-z, w)] }) {
        for i in 0..8 {
            let (s, c) = (2.0 * PI * f64::from(i) / 8.0).sin_cos();
            let r = f64::sqrt(1.0 - z * z);
            out.push(([r * c, r * s, z], w * 2.0 * PI / 8.0));
        }
    }
    out
}

fn lighting(kind: Kind, seed: u64) -> Lighting<f64> {
    let c = cotangent(27, seed);
    let mut lighting = Lighting::dark(kind);
    lighting.coefficients.as_flattened_mut().copy_from_slice(&c);
    lighting
}

fn single(l: &Lighting<f64>) -> Lighting<f32> {
    Lighting { kind: l.kind, coefficients: l.coefficients.map(|row| row.map(|x| x as f32)) }
}

/// A rotation from any four numbers.
fn rotation(q: [f64; 4]) -> [[f64; 3]; 3] {
    let n = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    let [w, x, y, z] = q.map(|q| q / n);
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

fn turn(r: &[[f64; 3]; 3], x: Vec3) -> Vec3 {
    r.map(|row| dot(row, x))
}

#[track_caller]
fn near(got: &[f64], want: &[f64], tolerance: f64) {
    for (i, (g, w)) in got.iter().zip(want).enumerate() {
        assert!((g - w).abs() <= tolerance, "[{i}]: got {g}, want {w}");
    }
}

fn any_vec() -> impl Strategy<Value = Vec3> {
    prop::array::uniform3(-1.0_f64..1.0).prop_filter("long enough to have a direction", |x| dot(*x, *x) > 1e-3)
}

#[test]
fn the_basis_is_orthonormal() {
    for i in 0..COEFFICIENTS {
        for j in 0..COEFFICIENTS {
            let product: f64 = exact_sphere().iter().map(|&(d, w)| w * basis(d)[i] * basis(d)[j]).sum();
            assert!((product - f64::from(u8::from(i == j))).abs() < 1e-14, "{i} {j}: {product}");
        }
    }
}

#[test]
fn the_slopes_of_the_basis_match_central_differences() {
    let forward = |d: &[f64], y: &mut [f64]| y.copy_from_slice(&basis([d[0], d[1], d[2]]));
    let backward = |d: &[f64], y_bar: &[f64], d_bar: &mut [f64]| {
        for (row, bar) in basis_gradient([d[0], d[1], d[2]]).iter().zip(y_bar) {
            d_bar.iter_mut().zip(row).for_each(|(d, g)| *d += g * bar);
        }
    };
    check_pair(&unit([0.3, -0.8, 0.4]), &cotangent(9, 1), forward, backward, Tolerance::TWIN).unwrap();
}

#[test]
fn constant_radiance_gives_irradiance_pi_everywhere() {
    let white = Lighting::<f64>::constant([1.0; 3]);
    assert!((white.coefficients[0][0] - (4.0 * PI).sqrt()).abs() < 1e-15);
    for n in sphere(50) {
        near(&white.irradiance(n), &[PI; 3], 1e-14);
        near(&white.to_kind(Kind::Irradiance).irradiance(n), &[PI; 3], 1e-14);
    }
}

#[test]
fn irradiance_is_the_cosine_weighted_integral_of_radiance() {
    let light = lighting(Kind::Radiance, 3);
    let radiance = |d: Vec3| basis(d).iter().zip(light.coefficients).map(|(y, l)| y * l[1]).sum::<f64>();
    let count = 200_000;
    for n in [[0.0, 0.0, 1.0], unit([0.5, -0.2, 0.7]), unit([-0.9, 0.3, -0.4])] {
        let sum: f64 = sphere(count).map(|d| dot(d, n).max(0.0) * radiance(d)).sum();
        near(&[light.irradiance(n)[1]], &[sum * 4.0 * PI / count as f64], 1e-4);
    }
}

#[test]
fn the_published_closed_form_is_the_same_to_six_digits() {
    let (c1, c2, c3, c4, c5) = (0.429_043, 0.511_664, 0.743_125, 0.886_227, 0.247_708);
    for seed in 0..20 {
        let light = lighting(Kind::Radiance, seed);
        let [x, y, z] = unit([cotangent(3, seed)[0], cotangent(3, seed)[1], cotangent(3, seed)[2]]);
        for c in 0..3 {
            let l: Vec<f64> = light.coefficients.iter().map(|row| row[c]).collect();
            let want = c1 * l[8] * (x * x - y * y) + c3 * l[6] * z * z + c4 * l[0] - c5 * l[6]
                + 2.0 * c1 * (l[4] * x * y + l[7] * x * z + l[5] * y * z)
                + 2.0 * c2 * (l[3] * x + l[1] * y + l[2] * z);
            // Six digits of coefficients up to 2, nine of them.
            near(&[light.irradiance([x, y, z])[c]], &[want], 1e-5);
        }
    }
}

#[test]
fn kinds_convert_and_come_back() {
    let light = lighting(Kind::Radiance, 5);
    let other = light.to_kind(Kind::Irradiance);
    assert_eq!(light.to_kind(Kind::Radiance), light);
    assert_ne!(other.coefficients, light.coefficients);
    let back = other.to_kind(Kind::Radiance);
    near(back.coefficients.as_flattened(), light.coefficients.as_flattened(), 1e-15);
    for n in sphere(9) {
        near(&other.irradiance(n), &light.irradiance(n), 1e-14);
    }
    assert_eq!(COSINE_LOBE, [PI, 2.0 * PI / 3.0, PI / 4.0]);
}

#[test]
fn irradiance_matches_its_twin_and_its_gradient_differences() {
    for kind in [Kind::Radiance, Kind::Irradiance] {
        let light = single(&lighting(kind, 7));
        let n = unit([0.2, 0.7, -0.5]).map(|x| x as f32);
        let x: Vec<f32> = light.coefficients.as_flattened().iter().copied().chain(n).collect();
        macro_rules! pair {
            ($ty:ty) => {{
                let read = move |x: &[$ty]| {
                    let mut light = Lighting::<$ty>::dark(kind);
                    light.coefficients.as_flattened_mut().copy_from_slice(&x[..27]);
                    (light, [x[27], x[28], x[29]])
                };
                (
                    move |x: &[$ty], out: &mut [$ty]| {
                        let (light, n) = read(x);
                        out.copy_from_slice(&light.irradiance(n));
                    },
                    move |x: &[$ty], bar: &[$ty], x_bar: &mut [$ty]| {
                        let (light, n) = read(x);
                        let (mut l_bar, mut n_bar) = ([[0.0; 3]; 9], [0.0; 3]);
                        light.irradiance_backward(n, [bar[0], bar[1], bar[2]], &mut l_bar, &mut n_bar);
                        let all = l_bar.as_flattened().iter().chain(&n_bar);
                        x_bar.iter_mut().zip(all).for_each(|(x, g)| *x += g);
                    },
                )
            }};
        }
        check_f32_pair(&x, &[1.0, -2.0, 0.5], pair!(f32), pair!(f64), PairTolerances::default()).unwrap();
    }
}

#[test]
fn a_zero_normal_sees_the_constant_term_and_gives_no_gradient() {
    let light = lighting(Kind::Radiance, 9);
    let e = light.irradiance([0.0, -0.0, 0.0]);
    let alone = Lighting {
        coefficients: std::array::from_fn(|k| if k == 0 { light.coefficients[0] } else { [0.0; 3] }),
        ..light
    };
    assert_eq!(e, alone.irradiance([0.0, 0.0, 1.0]));
    let (mut l_bar, mut n_bar) = ([[0.0; 3]; 9], [0.0; 3]);
    light.irradiance_backward([0.0; 3], [1.0; 3], &mut l_bar, &mut n_bar);
    assert_eq!(n_bar, [0.0; 3]);
    assert!(l_bar[0].iter().all(|&x| x > 0.0) && l_bar[1..].as_flattened().iter().all(|&x| x == 0.0));
}

proptest! {
    #![proptest_config(testkit::property::cases(64))]

    #[test]
    fn turned_lighting_on_turned_normals_changes_nothing(
        q in prop::array::uniform4(-1.0_f64..1.0), n in any_vec(), seed in any::<u64>(), mirror in any::<bool>(),
    ) {
        prop_assume!(q.iter().map(|x| x * x).sum::<f64>() > 1e-3);
        let mut r = rotation(q);
        if mirror {
            r[1] = r[1].map(|x| -x);
        }
        for kind in [Kind::Radiance, Kind::Irradiance] {
            let light = lighting(kind, seed);
            let turned = light.rotated(&r);
            near(&turned.irradiance(turn(&r, unit(n))), &light.irradiance(unit(n)), 1e-12);
            // There and back; and coefficients keep their length, band by band.
            let back: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| r[j][i]));
            near(turned.rotated(&back).coefficients.as_flattened(), light.coefficients.as_flattened(), 1e-12);
            for band in [0..1, 1..4, 4..9] {
                let square = |l: &Lighting<f64>| l.coefficients[band.clone()].as_flattened().iter().map(|x| x * x).sum::<f64>();
                prop_assert!((square(&turned) - square(&light)).abs() < 1e-11);
            }
        }
    }

    #[test]
    fn lighting_inside_out_serves_inward_normals(n in any_vec(), seed in any::<u64>()) {
        let (light, n) = (lighting(Kind::Irradiance, seed), unit(n));
        near(&light.inside_out().irradiance(n.map(|x| -x)), &light.irradiance(n), 1e-13);
        prop_assert_eq!(light.inside_out().inside_out(), light);
    }

    #[test]
    fn fitting_finds_the_lighting_that_made_the_samples(seed in any::<u64>(), count in 9_usize..200) {
        let light = lighting(Kind::Radiance, seed);
        let normals: Vec<Vec3> = sphere(count).collect();
        let samples: Vec<Vec3> = normals.iter().map(|&n| light.irradiance(n)).collect();
        let fit = fit_irradiance(&normals, &samples, 0.0).unwrap();
        prop_assert_eq!(fit.kind, Kind::Irradiance);
        near(fit.to_kind(Kind::Radiance).coefficients.as_flattened(), light.coefficients.as_flattened(), 1e-8);
    }

    #[test]
    fn colour_is_linear_in_albedo_and_shadow(e in any_vec(), k in 0.0_f64..3.0) {
        let albedo = [0.2, 0.5, 0.9];
        let one = shade(Tone::Gamma, albedo, 1.0, e);
        near(&shade(Tone::Gamma, albedo.map(|a| k * a), 1.0, e), &one.map(|c| k * c), 1e-14);
        near(&shade(Tone::Gamma, albedo, k, e), &one.map(|c| k * c), 1e-14);
    }
}

#[test]
fn the_grey_lighting_is_its_luminance() {
    let light = lighting(Kind::Irradiance, 2);
    let grey = light.grey();
    for (grey, [r, g, b]) in grey.iter().zip(light.coefficients) {
        assert_eq!(*grey, 0.2126 * r + 0.7152 * g + 0.0722 * b);
    }
    near(&Lighting::<f64>::constant([1.0; 3]).grey(), &[(4.0 * PI).sqrt(), 0.0, 0.0], 1e-15);
    let sky = Lighting::<f32>::mild_sky();
    assert!(
        sphere(100).all(|n| sky.irradiance(n.map(|x| x as f32)).iter().all(|&e| e > 0.0)),
        "a sky lights all normals"
    );
}

/// A map of the given radiance, each pixel the value at its centre.
fn map(width: usize, height: usize, radiance: impl Fn(Vec3) -> Vec3) -> Vec<f32> {
    let mut map = Vec::new();
    for v in 0..height {
        for u in 0..width {
            let (st, ct) = (PI * (v as f64 + 0.5) / height as f64).sin_cos();
            let (sp, cp) = (2.0 * PI * (u as f64 + 0.5) / width as f64).sin_cos();
            map.extend(radiance([st * cp, st * sp, ct]).map(|x| x as f32));
        }
    }
    map
}

#[test]
fn a_constant_map_is_a_constant_lighting_at_any_resolution() {
    for (width, height) in [(1, 1), (2, 1), (1, 7), (5, 3), (64, 32)] {
        let light = project_equirect(&vec![0.5; 3 * width * height], width, height).unwrap();
        let want = Lighting::<f64>::constant([0.5; 3]);
        assert_eq!(light.kind, Kind::Radiance);
        // The solid angles sum to 4 pi, and no other band leaks in.
        near(light.coefficients.as_flattened(), want.coefficients.as_flattened(), 1e-14);
    }
}

#[test]
fn a_map_of_a_lighting_projects_to_that_lighting() {
    let light = lighting(Kind::Radiance, 4);
    let radiance = |d: Vec3| {
        let y = basis(d);
        std::array::from_fn(|c| (0..9).map(|k| y[k] * light.coefficients[k][c]).sum())
    };
    let error = |n: usize| {
        let got = project_equirect(&map(2 * n, n, radiance), 2 * n, n).unwrap();
        let pairs = got.coefficients.as_flattened().iter().zip(light.coefficients.as_flattened());
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    let (coarse, fine) = (error(16), error(128));
    // Second order in the size of pixels.
    assert!(fine < 1e-3 && coarse / fine > 40.0, "{coarse} {fine}");
}

#[test]
fn a_bright_spot_lights_what_faces_it() {
    // One pixel at the top, one to the side: +z, and the azimuth of +y.
    for (v, u, towards) in [(0, 3, [0.0, 0.0, 1.0]), (8, 4, [0.0, 1.0, 0.0])] {
        let (width, height) = (16, 17);
        let mut map = vec![0.0; 3 * width * height];
        map[3 * (v * width + u)..][..3].fill(100.0);
        let light = project_equirect(&map, width, height).unwrap();
        let best = sphere(2000).max_by(|&a, &b| light.irradiance(a)[0].total_cmp(&light.irradiance(b)[0])).unwrap();
        assert!(dot(best, towards) > 0.95, "{best:?} {towards:?}");
    }
}

#[test]
fn bad_maps_are_refused() {
    let text = |map: &[f32], w, h| project_equirect(map, w, h).unwrap_err().to_string();
    assert_eq!(text(&[0.0; 5], 2, 1), "`map` holds 5 values, expected 6");
    assert_eq!(text(&[], 0, 0), "`map` holds 0 values, expected 3");
    assert_eq!(text(&[1.0; 3], 0, 5), "`map` holds 3 values, expected 0");
    assert_eq!(text(&[1.0; 3], 1, 0), "`map` holds 3 values, expected 0");
    let wraps = 1 << (usize::BITS / 2);
    assert_eq!(text(&[], wraps, wraps), format!("`map` holds 0 values, expected {}", usize::MAX));
    assert_eq!(text(&[0.0, 0.0, f32::NAN], 1, 1), "`map[2]` is NaN or infinite");
}

#[test]
fn a_fit_that_is_not_determined_is_refused_or_left_to_the_ridge() {
    let light = lighting(Kind::Irradiance, 8);
    let fit = |normals: &[Vec3], ridge| {
        let samples: Vec<Vec3> = normals.iter().map(|&n| light.irradiance(n)).collect();
        fit_irradiance(normals, &samples, ridge)
    };
    assert_eq!(fit(&[], 0.0), Err(FitError::Undetermined { coefficient: 0 }));
    assert_eq!(fit(&[[0.0, 0.0, 1.0]; 50], 0.0), Err(FitError::Undetermined { coefficient: 1 }));
    let eight: Vec<Vec3> = sphere(8).collect();
    let refused = fit(&eight, 0.0).unwrap_err();
    assert_eq!(refused, FitError::Undetermined { coefficient: 8 });
    assert!(refused.to_string().contains("do not determine coefficient 8"));
    // A ridge decides: nothing is dark, little is small, and what there is is reproduced.
    assert_eq!(fit(&[], 1.0).unwrap().coefficients, [[0.0; 3]; 9]);
    let ridged = fit(&[[0.0, 0.0, 1.0]; 50], 1e-9).unwrap();
    near(&ridged.irradiance([0.0, 0.0, 1.0]), &light.irradiance([0.0, 0.0, 1.0]), 1e-7);
    // Half a sphere of normals is enough.
    let half: Vec<Vec3> = sphere(500).filter(|n| n[2] > 0.0).collect();
    near(fit(&half, 0.0).unwrap().coefficients.as_flattened(), light.coefficients.as_flattened(), 1e-9);
    assert!(matches!(fit_irradiance(&half, &half[1..], 0.0), Err(FitError::Input(_))));
    assert!(matches!(fit_irradiance(&[[f64::NAN, 0.0, 0.0]], &[[0.0; 3]], 1.0), Err(FitError::Input(_))));
}

#[test]
fn the_fit_is_the_least_square() {
    // Noise on top: no neighbour is better.
    let light = lighting(Kind::Irradiance, 6);
    let normals: Vec<Vec3> = sphere(60).filter(|n| n[0] > -0.3).collect();
    let noise = cotangent(3 * normals.len(), 4);
    let samples: Vec<Vec3> = normals
        .iter()
        .enumerate()
        .map(|(i, &n)| {
            let e = light.irradiance(n);
            std::array::from_fn(|c| e[c] + 0.1 * noise[3 * i + c])
        })
        .collect();
    let cost = |l: &Lighting<f64>| -> f64 {
        normals
            .iter()
            .zip(&samples)
            .map(|(&n, s)| l.irradiance(n).iter().zip(s).map(|(a, b)| (a - b).powi(2)).sum::<f64>())
            .sum()
    };
    let fit = fit_irradiance(&normals, &samples, 0.0).unwrap();
    for k in 0..9 {
        for step in [-1e-3, 1e-3] {
            let mut other = fit;
            other.coefficients[k][1] += step;
            assert!(cost(&other) > cost(&fit));
        }
    }
}

#[test]
fn shading_matches_its_twin_and_its_gradient_differences() {
    // Above and below the least irradiance.
    let x = [0.3_f32, 0.6, 0.9, 0.7, 2.5, 0.4, 0.0];
    for tone in [Tone::Gamma, Tone::Identity] {
        macro_rules! pair {
            ($ty:ty) => {{
                let read = |x: &[$ty]| ([x[0], x[1], x[2]], x[3], [x[4], x[5], x[6]]);
                (
                    move |x: &[$ty], out: &mut [$ty]| {
                        let (albedo, shadow, e) = read(x);
                        out.copy_from_slice(&shade(tone, albedo, shadow, e));
                    },
                    move |x: &[$ty], bar: &[$ty], x_bar: &mut [$ty]| {
                        let (albedo, shadow, e) = read(x);
                        let (mut a_bar, mut s_bar, mut e_bar) = ([0.0; 3], 0.0, [0.0; 3]);
                        shade_backward(
                            tone,
                            albedo,
                            shadow,
                            e,
                            [bar[0], bar[1], bar[2]],
                            &mut a_bar,
                            &mut s_bar,
                            &mut e_bar,
                        );
                        let all = a_bar.into_iter().chain([s_bar]).chain(e_bar);
                        x_bar.iter_mut().zip(all).for_each(|(x, g)| *x += g);
                    },
                )
            }};
        }
        check_f32_pair(&x, &[1.0, -2.0, 0.5], pair!(f32), pair!(f64), PairTolerances::default()).unwrap();
    }
}

#[test]
fn darkness_is_dark_and_never_nan() {
    let least = MIN_IRRADIANCE.powf(1.0 / 2.2);
    for e in [0.0, -0.0, -1e-30, -5.0, f64::NEG_INFINITY, 1e-5] {
        assert_eq!(Tone::Gamma.apply(e), (least, 0.0));
        let c = shade(Tone::Gamma, [1.0; 3], 1.0, [e; 3]);
        assert!(c.iter().all(|&c| c < 4.0 / 255.0));
    }
    assert!(Tone::Gamma.apply(f64::NAN).0.is_finite(), "the least counts");
    let (value, slope) = Tone::Gamma.apply(1e30_f32);
    assert!(value.is_finite() && slope > 0.0);
    assert_eq!(Tone::Identity.apply(-2.0), (-2.0, 1.0));
}

#[test]
fn sun_and_sky_match_their_twin_and_gradient() {
    let x = [0.3_f32, 0.6, 0.9, 1.5, 0.2, -0.4, 3.0, 2.0, 1.0, 0.7, 0.6];
    for cosine in [0.6, -0.4] {
        let x: Vec<f32> = x[..10].iter().copied().chain([cosine]).collect();
        macro_rules! pair {
            ($ty:ty) => {{
                let read = |x: &[$ty]| {
                    let sun = Sun { irradiance: [x[6], x[7], x[8]], visibility: x[9], cosine: x[10] };
                    ([x[0], x[1], x[2]], [x[3], x[4], x[5]], sun)
                };
                (
                    move |x: &[$ty], out: &mut [$ty]| {
                        let (albedo, ambient, sun) = read(x);
                        out.copy_from_slice(&sun_and_sky(albedo, ambient, sun));
                    },
                    move |x: &[$ty], bar: &[$ty], x_bar: &mut [$ty]| {
                        let (albedo, ambient, sun) = read(x);
                        let (mut a_bar, mut e_bar) = ([0.0; 3], [0.0; 3]);
                        let mut sun_bar = Sun { irradiance: [0.0; 3], visibility: 0.0, cosine: 0.0 };
                        let out_bar = [bar[0], bar[1], bar[2]];
                        sun_and_sky_backward(albedo, ambient, sun, out_bar, &mut a_bar, &mut e_bar, &mut sun_bar);
                        let last = [sun_bar.visibility, sun_bar.cosine];
                        let all = a_bar.into_iter().chain(e_bar).chain(sun_bar.irradiance).chain(last);
                        x_bar.iter_mut().zip(all).for_each(|(x, g)| *x += g);
                    },
                )
            }};
        }
        check_f32_pair(&x, &[1.0, -2.0, 0.5], pair!(f32), pair!(f64), PairTolerances::default()).unwrap();
    }
    // At night, behind, or in the shadow only the sky is left.
    let sun = Sun { irradiance: [9.0; 3], visibility: 0.0, cosine: 1.0 };
    assert_eq!(sun_and_sky([PI; 3], [0.5, 0.0, -1.0], sun), [0.5, 0.0, 0.0]);
}

#[test]
fn normals_point_out_of_matter() {
    // A ball of Gaussian density: the gradient points inwards.
    for d in sphere(40) {
        let gradient = d.map(|x| -3.7 * x);
        near(&outward_normal(gradient), &d, 1e-15);
    }
    assert_eq!(outward_normal([0.0_f32; 3]), [0.0; 3]);
    let tiny = outward_normal([1e-20_f32, 0.0, 0.0]);
    assert!(tiny[0] <= 0.0 && tiny[0] > -1e-11);
    assert_eq!(outward_normal([0.0_f32, -1e30, 0.0]), [0.0, 1.0, 0.0]);
    macro_rules! pair {
        ($ty:ty) => {
            (
                |x: &[$ty], out: &mut [$ty]| out.copy_from_slice(&outward_normal([x[0], x[1], x[2]])),
                |x: &[$ty], bar: &[$ty], x_bar: &mut [$ty]| {
                    let mut g = [0.0; 3];
                    outward_normal_backward([x[0], x[1], x[2]], [bar[0], bar[1], bar[2]], &mut g);
                    x_bar.iter_mut().zip(g).for_each(|(x, g)| *x += g);
                },
            )
        };
    }
    check_f32_pair(&[0.7, -1.5, 2.0], &[1.0, -2.0, 0.5], pair!(f32), pair!(f64), PairTolerances::default()).unwrap();
    let mut bar = [0.0; 3];
    outward_normal_backward([0.0; 3], [1.0; 3], &mut bar);
    assert_eq!(bar, [0.0; 3]);
    // The gradient is tangent to the sphere of the normal.
    outward_normal_backward([0.0, 0.0, 2.0], [5.0, 6.0, 7.0], &mut bar);
    compare("tangent", &bar, &[-2.5, -3.0, 0.0], Tolerance::TWIN).unwrap();
}
