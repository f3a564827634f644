//! Integrated encoding: against its `f64` twin, differences, samples of the Gaussian, and the plain encoding.

use field_core::encoding::frequency::{Base, Frequency, Identity};
use field_core::encoding::integrated::{Gaussians, Integrated, Projection, icosahedron};
use field_core::rng::Rng;
use field_core::tape::{Arena, EncodingOp, Tape};
use float_core::Simd;
use proptest::prelude::*;
use testkit::gradient::{
    PairTolerances, Tolerance, central_difference, check_f32_pair, check_tangent, compare, cotangent,
};

fn uniform(seed: u64, len: usize, low: f32, high: f32) -> Vec<f32> {
    (0..len).map(|i| low + (high - low) * Rng::new(seed, 0).uniform_at(i as u64)).collect()
}

fn f64s(x: &[f32]) -> Vec<f64> {
    x.iter().map(|&x| f64::from(x)).collect()
}

fn f32s(x: &[f64]) -> Vec<f32> {
    x.iter().map(|&x| x as f32).collect()
}

/// Twin of one Gaussian: `x` is `[mean; var]`.
fn twin(dims: usize, octaves: usize, x: &[f64], out: &mut [f64]) {
    let (mean, var) = x.split_at(dims);
    let mut all = Vec::new();
    for k in 0..octaves {
        let f = 2.0_f64.powi(k as i32);
        let damp = |d: usize| (-0.5 * f * f * var[d]).exp();
        all.extend((0..dims).map(|d| damp(d) * (f * mean[d]).sin()));
        all.extend((0..dims).map(|d| damp(d) * (f * mean[d]).cos()));
    }
    out.copy_from_slice(&all);
}

fn twin_backward(dims: usize, octaves: usize, x: &[f64], out_bar: &[f64], x_bar: &mut [f64]) {
    for k in 0..octaves {
        let f = 2.0_f64.powi(k as i32);
        for d in 0..dims {
            let e = (-0.5 * f * f * x[dims + d]).exp();
            let (s, c) = (e * (f * x[d]).sin(), e * (f * x[d]).cos());
            let (s_bar, c_bar) = (out_bar[2 * k * dims + d], out_bar[(2 * k + 1) * dims + d]);
            x_bar[d] += f * (c * s_bar - s * c_bar);
            x_bar[dims + d] -= 0.5 * f * f * (s * s_bar + c * c_bar);
        }
    }
}

fn twin_tangent(dims: usize, octaves: usize, x: &[f64], x_dot: &[f64], out: &mut [f64]) {
    for k in 0..octaves {
        let f = 2.0_f64.powi(k as i32);
        for d in 0..dims {
            let e = (-0.5 * f * f * x[dims + d]).exp();
            let (s, c) = (e * (f * x[d]).sin(), e * (f * x[d]).cos());
            let (turn, damp) = (f * x_dot[d], -0.5 * f * f * x_dot[dims + d]);
            out[2 * k * dims + d] = turn * c + damp * s;
            out[(2 * k + 1) * dims + d] = damp * c - turn * s;
        }
    }
}

#[test]
fn integrated_matches_its_twin_and_differences() {
    for (dims, octaves) in [(3, 5), (1, 3), (7, 4)] {
        let encoding = Integrated::new(dims, octaves).unwrap();
        let rows = encoding.out_rows();
        let mut x = uniform(7, dims, -2.0, 2.0);
        x.extend(uniform(8, dims, 0.0, 0.2));
        let x64 = f64s(&x);
        let x_dot = cotangent(2 * dims, 3);
        for simd in Simd::available() {
            check_f32_pair(
                &x,
                &f32s(&cotangent(rows, 1)),
                (
                    |x, out| encoding.encode(simd, &x[..dims], &x[dims..], out).unwrap(),
                    |x, out_bar, x_bar| {
                        let (mean_bar, var_bar) = x_bar.split_at_mut(dims);
                        encoding
                            .encode_backward(simd, &x[..dims], &x[dims..], out_bar, Some(mean_bar), Some(var_bar))
                            .unwrap();
                    },
                ),
                (
                    |x, out| twin(dims, octaves, x, out),
                    |x, out_bar, x_bar| twin_backward(dims, octaves, x, out_bar, x_bar),
                ),
                PairTolerances { twin: Tolerance::new(1e-6, 1e-7), ..Default::default() },
            )
            .unwrap();
            let tangent = |x: &[f64], d: &[f64], out: &mut [f64]| twin_tangent(dims, octaves, x, d, out);
            let values = |x: &[f64], out: &mut [f64]| twin(dims, octaves, x, out);
            check_tangent(&x64, &x_dot, rows, values, tangent, Tolerance::new(1e-6, 1e-7)).unwrap();
            let (mut got, mut want) = (vec![f32::NAN; rows], vec![0.0; rows]);
            let dot = f32s(&x_dot);
            encoding.tangent(simd, Gaussians::stacked(&x), Gaussians::stacked(&dot), &mut got).unwrap();
            tangent(&x64, &x_dot, &mut want);
            compare("tangent", &got, &want, Tolerance::SINGLE).unwrap();
            // The second derivative against differences of the f64 tangent.
            let bar = cotangent(rows, 2);
            let mut x_bar = vec![0.0; 2 * dims];
            let (mean_bar, var_bar) = x_bar.split_at_mut(dims);
            let (at, dot) = (Gaussians::stacked(&x), Gaussians::stacked(&dot));
            encoding.tangent_backward(simd, at, dot, &f32s(&bar), Some(mean_bar), Some(var_bar)).unwrap();
            let want = central_difference(&x64, |x| {
                let mut out = vec![0.0; rows];
                tangent(x, &x_dot, &mut out);
                out.iter().zip(&bar).map(|(o, b)| o * b).sum()
            });
            compare("second derivative", &x_bar, &want, Tolerance::new(2e-4, 1e-4)).unwrap();
        }
    }
}

#[test]
fn the_tape_sees_means_and_variances_as_one_matrix() {
    let encoding = Integrated::new(3, 4).unwrap();
    let n = 21;
    let mut x = uniform(1, 3 * n, -2.0, 2.0);
    x.extend(uniform(2, 3 * n, 0.0, 0.3));
    let bar = uniform(3, encoding.out_rows() * n, -1.0, 1.0);
    for simd in Simd::available() {
        let op = EncodingOp::new(encoding, simd);
        let mut arena = Arena::new();
        let mut tape = Tape::new(&mut arena, &[]);
        let node = tape.input(6, n, &x).unwrap();
        let out = tape.custom(&op, &[node]).unwrap();
        let mut want = vec![0.0; bar.len()];
        encoding.encode(simd, &x[..3 * n], &x[3 * n..], &mut want).unwrap();
        assert_eq!(tape.value(out).unwrap().data, want);
        let along = tape.constant(6, n, &vec![0.1; 6 * n]).unwrap();
        let dot = tape.jvp([out], &[(node, along)]).unwrap();
        let (mut want, half) = (vec![0.0; bar.len()], [0.1; 63]);
        let halves = Gaussians { mean: &half, var: &half };
        encoding.tangent(simd, Gaussians::stacked(&x), halves, &mut want).unwrap();
        assert_eq!(tape.value(dot[0]).unwrap().data, want);
        tape.backward(&[(out, &bar)], &mut []).unwrap();
        let mut x_bar = vec![0.0; x.len()];
        let (mean_bar, var_bar) = x_bar.split_at_mut(3 * n);
        encoding.encode_backward(simd, &x[..3 * n], &x[3 * n..], &bar, Some(mean_bar), Some(var_bar)).unwrap();
        assert_eq!(tape.gradient(node).unwrap(), x_bar);
    }
}

#[test]
fn without_variance_it_is_the_plain_encoding_bit_for_bit() {
    let (plain, integrated) =
        (Frequency::new(3, 16, Base::One, Identity::Omit).unwrap(), Integrated::new(3, 16).unwrap());
    assert_eq!(plain.out_rows(), integrated.out_rows());
    for n in [1, 15, 16, 37] {
        let x = uniform(n as u64, 3 * n, -5.0, 5.0);
        for simd in Simd::available() {
            let (mut a, mut b) = (vec![0.0; 96 * n], vec![f32::NAN; 96 * n]);
            plain.encode(simd, &x, None, &mut a).unwrap();
            integrated.encode(simd, &x, &vec![0.0; 3 * n], &mut b).unwrap();
            assert_eq!(a, b);
        }
    }
}

#[test]
fn it_is_the_mean_of_the_plain_encoding() {
    let (mean, var) = (0.4_f64, 2.3_f64);
    let encoding = Integrated::new(1, 2).unwrap();
    let mut out = [0.0; 4];
    encoding.encode(Simd::best(), &[mean as f32], &[var as f32], &mut out).unwrap();
    assert!((f64::from(out[0]) - 0.1233).abs() < 5e-5, "{}", out[0]);
    let (rng, n) = (Rng::new(5, 0), 400_000);
    let mut sums = [0.0; 4];
    for i in 0..n {
        let x = mean + var.sqrt() * f64::from(rng.normal_at(i));
        for (sum, v) in sums.iter_mut().zip([x.sin(), x.cos(), (2.0 * x).sin(), (2.0 * x).cos()]) {
            *sum += v / n as f64;
        }
    }
    // The deviation of a sine is at most 1 / sqrt(2) for each sample.
    for (sum, out) in sums.iter().zip(out) {
        assert!((sum - f64::from(out)).abs() < 4.0 * (0.5 / n as f64).sqrt(), "{sum} {out}");
    }
}

#[test]
fn scaling_the_scene_shifts_the_octaves() {
    let encoding = Integrated::new(3, 8).unwrap();
    let n = 20;
    let (mean, var) = (uniform(1, 3 * n, -1.0, 1.0), uniform(2, 3 * n, 0.0, 1e-2));
    let scaled = |x: &[f32], k: f32| x.iter().map(|x| k * x).collect::<Vec<_>>();
    for simd in Simd::available() {
        let (mut a, mut b) = (vec![0.0; 48 * n], vec![0.0; 48 * n]);
        encoding.encode(simd, &mean, &var, &mut a).unwrap();
        // Four times as large: two octaves lower.
        encoding.encode(simd, &scaled(&mean, 4.0), &scaled(&var, 16.0), &mut b).unwrap();
        assert_eq!(a[12 * n..], b[..36 * n]);
    }
}

#[test]
fn extreme_gaussians_give_zeros_ones_or_nan_but_nothing_else() {
    let encoding = Integrated::new(1, 32).unwrap();
    let encode = |mean: f32, var: f32| {
        let mut out = [0.0; 64];
        encoding.encode(Simd::best(), &[mean], &[var], &mut out).unwrap();
        out
    };
    for var in [1e30, f32::MAX, f32::INFINITY] {
        assert_eq!(encode(0.3, var), [0.0; 64]);
    }
    for (mean, var) in [(f32::NAN, 0.1), (0.3, f32::NAN), (f32::INFINITY, 0.1), (f32::INFINITY, 1e30)] {
        assert!(encode(mean, var).iter().all(|x| x.is_nan()), "{mean} {var}");
    }
    // Rounded below 0, denormal and 0 are all no variance in the first octaves.
    let point = encode(0.3, 0.0);
    assert_eq!(encode(0.3, -1e-9), point);
    assert_eq!(encode(0.3, 1e-40)[..20], point[..20]);
    assert!(encode(1e20, 1e-3).iter().all(|x| x.is_finite()));
    encoding.encode(Simd::best(), &[], &[], &mut []).unwrap();
}

#[test]
fn wrong_shapes_and_settings_are_refused() {
    assert!(Integrated::new(0, 4).is_err() && Integrated::new(3, 0).is_err() && Integrated::new(3, 33).is_err());
    let encoding = Integrated::new(3, 2).unwrap();
    let simd = Simd::SCALAR;
    assert!(encoding.encode(simd, &[0.0; 3], &[0.0; 2], &mut [0.0; 12]).is_err());
    assert!(encoding.encode(simd, &[0.0; 4], &[0.0; 4], &mut [0.0; 12]).is_err());
    assert!(encoding.encode(simd, &[0.0; 3], &[0.0; 3], &mut [0.0; 11]).is_err());
    let mut short = [0.0; 2];
    assert!(encoding.encode_backward(simd, &[0.0; 3], &[0.0; 3], &[0.0; 12], Some(&mut short), None).is_err());
    let projection = Projection::new(&icosahedron(2));
    assert!(projection.project(simd, &[0.0; 3], &[0.0; 5], &mut [0.0; 21], &mut [0.0; 21]).is_err());
    assert!(projection.project(simd, &[0.0; 3], &[0.0; 6], &mut [0.0; 20], &mut [0.0; 21]).is_err());
}

// ---- projection

fn projected(basis: &[[f64; 3]], x: &[f64], out: &mut [f64]) {
    let (mean, [xx, xy, xz, yy, yz, zz]) = (&x[..3], <[f64; 6]>::try_from(&x[3..9]).unwrap());
    let c = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    for (k, p) in basis.iter().enumerate() {
        out[k] = (0..3).map(|a| p[a] * mean[a]).sum();
        out[basis.len() + k] = (0..9).map(|e| p[e / 3] * c[e / 3][e % 3] * p[e % 3]).sum();
    }
}

#[test]
fn projection_matches_its_twin_and_differences() {
    let basis = icosahedron(2);
    let (k, projection) = (basis.len(), Projection::new(&basis));
    let x = [0.3, -0.7, 1.1, 0.5, 0.1, -0.05, 0.4, 0.02, 0.3_f32];
    let twin_backward = |_: &[f64], out_bar: &[f64], x_bar: &mut [f64]| {
        for (j, p) in basis.iter().enumerate() {
            for a in 0..3 {
                x_bar[a] += p[a] * out_bar[j];
            }
            for (e, (a, b)) in [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].into_iter().enumerate() {
                x_bar[3 + e] += if a == b { 1.0 } else { 2.0 } * p[a] * p[b] * out_bar[k + j];
            }
        }
    };
    for simd in Simd::available() {
        check_f32_pair(
            &x,
            &f32s(&cotangent(2 * k, 1)),
            (
                |x, out| {
                    let (along, var) = out.split_at_mut(k);
                    projection.project(simd, &x[..3], &x[3..], along, var).unwrap();
                },
                |x, out_bar, x_bar| {
                    let (mean_bar, cov_bar) = x_bar.split_at_mut(3);
                    projection.project_backward(&x[3..], &out_bar[..k], &out_bar[k..], mean_bar, cov_bar).unwrap();
                },
            ),
            (|x, out| projected(&basis, x, out), twin_backward),
            PairTolerances { twin: Tolerance::new(1e-6, 1e-7), ..Default::default() },
        )
        .unwrap();
    }
}

#[test]
fn projection_onto_the_axes_is_the_diagonal() {
    let projection = Projection::new(&[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    let n = 37;
    let (mean, cov) = (uniform(1, 3 * n, -1.0, 1.0), uniform(2, 6 * n, 0.0, 1.0));
    for simd in Simd::available() {
        let (mut along, mut var) = (vec![0.0; 3 * n], vec![0.0; 3 * n]);
        projection.project(simd, &mean, &cov, &mut along, &mut var).unwrap();
        assert_eq!(along, mean);
        assert_eq!(var, [&cov[..n], &cov[3 * n..4 * n], &cov[5 * n..]].concat());
    }
    projection.project(Simd::best(), &[], &[], &mut [], &mut []).unwrap();
}

#[test]
fn icosahedra_favour_no_direction() {
    for (parts, count) in [(0, 0), (1, 6), (2, 21), (3, 46)] {
        let basis = icosahedron(parts);
        assert_eq!(basis.len(), count);
        for a in 0..3 {
            for b in 0..3 {
                let sum: f64 = basis.iter().map(|p| p[a] * p[b]).sum();
                let want = if a == b { count as f64 / 3.0 } else { 0.0 };
                assert!((sum - want).abs() < 1e-12, "{parts}: {sum}");
            }
        }
        for (i, p) in basis.iter().enumerate() {
            assert!((p.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-14);
            for q in &basis[..i] {
                // Neither equal nor antipodal.
                let dot: f64 = (0..3).map(|a| p[a] * q[a]).sum();
                assert!(dot.abs() < 0.99, "{dot}");
            }
        }
    }
}

proptest! {
    #![proptest_config(testkit::property::cases(128))]

    #[test]
    fn magnitudes_are_bounded_and_fall_with_the_variance(mean in -10.0_f32..10.0, var in 0.0_f32..4.0, more in 0.0_f32..4.0) {
        let encoding = Integrated::new(1, 16).unwrap();
        let encode = |var: f32| {
            let mut out = [0.0; 32];
            encoding.encode(Simd::best(), &[mean], &[var], &mut out).unwrap();
            out
        };
        let (a, b) = (encode(var), encode(var + more));
        for i in 0..32 {
            prop_assert!(a[i].abs() <= 1.0 + 2e-7, "{}", a[i]);
            prop_assert!(b[i].abs() <= a[i].abs() * (1.0 + 1e-6) + 1e-12, "{} {}", a[i], b[i]);
        }
        // Sine and cosine of an octave share one magnitude, which never grows with the octave.
        let size = |o: &[f32; 32], k: usize| (o[2 * k] * o[2 * k] + o[2 * k + 1] * o[2 * k + 1]).sqrt();
        for k in 1..16 {
            prop_assert!(size(&a, k) <= size(&a, k - 1) + 1e-6);
        }
    }

    #[test]
    fn a_batch_is_a_loop_of_singles(n in 0_usize..70) {
        let encoding = Integrated::new(3, 6).unwrap();
        let (mean, var) = (uniform(1, 3 * n, -3.0, 3.0), uniform(2, 3 * n, 0.0, 0.1));
        for simd in Simd::available() {
            let mut out = vec![0.0; 36 * n];
            encoding.encode(simd, &mean, &var, &mut out).unwrap();
            for i in 0..n {
                let at = |x: &[f32]| [x[i], x[n + i], x[2 * n + i]];
                let mut one = [0.0; 36];
                encoding.encode(simd, &at(&mean), &at(&var), &mut one).unwrap();
                for (r, one) in one.iter().enumerate() {
                    prop_assert_eq!(out[r * n + i], *one);
                }
            }
        }
    }
}
