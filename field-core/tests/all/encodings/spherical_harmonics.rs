//! Spherical harmonics.

use super::{f32s, uniform};
use field_core::FieldError;
use field_core::encoding::spherical_harmonics::{Directions, SphericalHarmonics};
use field_core::rng::Rng;
use float_core::Simd;
use testkit::gradient::{Tolerance, compare, cotangent};

/// Basis from the recurrence of the associated Legendre polynomials, in angles.
fn sh_twin(degree: usize, d: &[f64], out: &mut [f64]) {
    let norm = d.iter().map(|x| x * x).sum::<f64>().sqrt();
    let (z, phi) = (d[2] / norm, d[1].atan2(d[0]));
    let s = (1.0 - z * z).max(0.0).sqrt();
    let legendre = |l: usize, m: usize| {
        // With the Condon-Shortley phase.
        let mut pmm = 1.0;
        for k in 1..=m {
            pmm *= -((2 * k - 1) as f64) * s;
        }
        let (mut a, mut b) = (0.0, pmm);
        for k in m + 1..=l {
            let next = ((2 * k - 1) as f64 * z * b - (k + m - 1) as f64 * a) / (k - m) as f64;
            (a, b) = (b, next);
        }
        b
    };
    let factorial = |n: usize| (1..=n).map(|k| k as f64).product::<f64>();
    for l in 0..degree {
        for m in -(l as i64)..=l as i64 {
            let a = m.unsigned_abs() as usize;
            let k = ((2 * l + 1) as f64 / (4.0 * std::f64::consts::PI) * factorial(l - a) / factorial(l + a)).sqrt();
            let angle = a as f64 * phi;
            let turn = match m.signum() {
                0 => 1.0,
                1 => 2.0_f64.sqrt() * angle.cos(),
                _ => 2.0_f64.sqrt() * angle.sin(),
            };
            out[(l * l + l).wrapping_add_signed(m as isize)] = k * legendre(l, a) * turn;
        }
    }
}

fn differences(d: &[f64], rows: usize, mut f: impl FnMut(&[f64], &mut [f64])) -> Vec<Vec<f64>> {
    // jacobian[axis][row]
    (0..3)
        .map(|a| {
            let h = 1e-6;
            let mut at = |s: f64| {
                let mut d = d.to_vec();
                d[a] += s;
                let mut out = vec![0.0; rows];
                f(&d, &mut out);
                out
            };
            let (up, down) = (at(h), at(-h));
            up.iter().zip(&down).map(|(u, d)| (u - d) / (2.0 * h)).collect()
        })
        .collect()
}

#[test]
fn spherical_harmonics_match_the_angular_twin() {
    for degree in 1..=5 {
        let basis = SphericalHarmonics::new(degree, Directions::Any).unwrap();
        let rows = basis.out_rows();
        for seed in 0..20 {
            let d = uniform(seed, 3, -2.0, 2.0);
            let d64: Vec<f64> = d.iter().map(|&d| f64::from(d)).collect();
            let twin = |d: &[f64], out: &mut [f64]| sh_twin(degree, d, out);
            let jacobian = differences(&d64, rows, twin);
            let (d_dot, bar) = (cotangent(3, seed), cotangent(rows, seed + 50));
            let along = |d: &[f64]| -> f64 {
                let j = differences(d, rows, twin);
                (0..rows).map(|r| bar[r] * (0..3).map(|a| j[a][r] * d_dot[a]).sum::<f64>()).sum()
            };
            let mut want = vec![0.0; rows];
            twin(&d64, &mut want);
            for simd in Simd::available() {
                let mut out = vec![f32::NAN; rows];
                basis.encode(simd, &d, &mut out).unwrap();
                compare("basis", &out, &want, Tolerance::new(1e-6, 1e-6)).unwrap();

                let mut d_bar = vec![0.0; 3];
                basis.encode_backward(simd, &d, &f32s(&bar), &mut d_bar).unwrap();
                let gradient: Vec<f64> =
                    jacobian.iter().map(|j| j.iter().zip(&bar).map(|(j, b)| j * b).sum()).collect();
                compare("gradient", &d_bar, &gradient, Tolerance::SINGLE).unwrap();

                let mut tangent = vec![f32::NAN; rows];
                basis.tangent(simd, &d, &f32s(&d_dot), &mut tangent).unwrap();
                let along_d: Vec<f64> = (0..rows).map(|r| (0..3).map(|a| jacobian[a][r] * d_dot[a]).sum()).collect();
                compare("tangent", &tangent, &along_d, Tolerance::SINGLE).unwrap();

                let mut d_bar = vec![0.0; 3];
                basis.tangent_backward_d(simd, &d, &f32s(&d_dot), &f32s(&bar), &mut d_bar).unwrap();
                // Differences of differences keep about five digits; wide steps.
                let h = 1e-3;
                let second: Vec<f64> = (0..3)
                    .map(|a| {
                        let at = |s: f64| {
                            let mut d = d64.clone();
                            d[a] += s;
                            along(&d)
                        };
                        (8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h)
                    })
                    .collect();
                compare("second derivative", &d_bar, &second, Tolerance::new(1e-3, 1e-4)).unwrap();
            }
        }
    }
}

#[test]
fn spherical_harmonics_are_orthonormal() {
    const N: usize = 100_000;
    let basis = SphericalHarmonics::new(5, Directions::Any).unwrap();
    let rng = Rng::new(4, 4);
    let mut d = vec![0.0; 3 * N];
    rng.fill_normal(0, &mut d);
    let mut y = vec![0.0; 25 * N];
    basis.encode(Simd::best(), &d, &mut y).unwrap();
    for a in 0..25 {
        for b in 0..=a {
            let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(a * b)).sum::<f64>();
            let mean = dot(&y[a * N..(a + 1) * N], &y[b * N..(b + 1) * N]) / N as f64 * 4.0 * std::f64::consts::PI;
            let want = if a == b { 1.0 } else { 0.0 };
            // Deviation of a product is below 2, so five standard errors are 0.03.
            assert!((mean - want).abs() < 0.03, "<Y{a}, Y{b}> = {mean}");
        }
    }
}

#[test]
fn unit_directions_take_the_fast_path_to_the_same_result() {
    let (any, unit) =
        (SphericalHarmonics::new(4, Directions::Any).unwrap(), SphericalHarmonics::new(4, Directions::Unit).unwrap());
    const N: usize = 37;
    let mut d = uniform(3, 3 * N, -1.0, 1.0);
    for i in 0..N {
        let norm = (d[i] * d[i] + d[N + i] * d[N + i] + d[2 * N + i] * d[2 * N + i]).sqrt();
        (0..3).for_each(|a| d[a * N + i] /= norm);
    }
    let run = |basis: SphericalHarmonics| {
        let (mut out, mut d_bar) = (vec![0.0; 16 * N], vec![0.0; 3 * N]);
        basis.encode(Simd::best(), &d, &mut out).unwrap();
        basis.encode_backward(Simd::best(), &d, &uniform(9, 16 * N, -1.0, 1.0), &mut d_bar).unwrap();
        (out, d_bar)
    };
    let ((out, d_bar), (want, want_bar)) = (run(unit), run(any));
    compare("values", &out, &want, Tolerance::new(1e-6, 1e-6)).unwrap();
    compare("gradients", &d_bar, &want_bar, Tolerance::new(1e-5, 1e-5)).unwrap();
}

#[test]
fn directions_of_any_length_work_and_those_of_none_are_refused() {
    let basis = SphericalHarmonics::new(4, Directions::Any).unwrap();
    let (mut want, mut out) = (vec![0.0; 16], vec![0.0; 16]);
    basis.encode(Simd::best(), &[0.6, -0.8, 0.3], &mut want).unwrap();
    for scale in [1e-30_f32, 1e-10, 1e10, 1e30] {
        basis.encode(Simd::best(), &[0.6 * scale, -0.8 * scale, 0.3 * scale], &mut out).unwrap();
        compare("scaled", &out, &want, Tolerance::new(1e-6, 1e-6)).unwrap();
    }
    for bad in [[0.0; 3], [f32::NAN, 1.0, 0.0], [1.0, f32::INFINITY, 0.0]] {
        let d: Vec<f32> = (0..3).flat_map(|a| [1.0, bad[a]]).collect();
        let error = basis.encode(Simd::best(), &d, &mut [0.0; 32]).unwrap_err();
        assert_eq!(error, FieldError::Direction { index: 1 });
        assert_eq!(error.to_string(), "direction 1 is zero or not finite");
    }
    assert!(SphericalHarmonics::new(0, Directions::Any).is_err());
    assert!(SphericalHarmonics::new(6, Directions::Any).is_err());
    assert_eq!(basis.encode(Simd::best(), &[], &mut []), Ok(()));
}
