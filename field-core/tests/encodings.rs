//! Frequency encoding, spherical harmonics, dense grid and embeddings: against naive `f64` twins, differences, and the
//! properties of their definitions.

use field_core::FieldError;
use field_core::embedding::Embedding;
use field_core::encoding::dense_grid::DenseGrid;
use field_core::encoding::frequency::{Base, Frequency, Identity};
use field_core::encoding::hash_grid::Interpolation;
use field_core::encoding::spherical_harmonics::{Directions, SphericalHarmonics};
use field_core::encoding::window;
use field_core::rng::Rng;
use float_core::Simd;
use proptest::prelude::*;
use testkit::gradient::{PairTolerances, Tolerance, check_f32_pair, check_pair, check_tangent, compare, cotangent};

fn uniform(seed: u64, len: usize, low: f32, high: f32) -> Vec<f32> {
    (0..len).map(|i| low + (high - low) * Rng::new(seed, 0).uniform_at(i as u64)).collect()
}

fn f32s(x: &[f64]) -> Vec<f32> {
    x.iter().map(|&x| x as f32).collect()
}

fn bits(x: &[f32]) -> Vec<u32> {
    x.iter().map(|x| x.to_bits()).collect()
}

// ---- frequency

/// Twin of one point: values and, with `x_dot`, the tangent.
struct FrequencyTwin {
    octaves: usize,
    kappa: f64,
    identity: bool,
    w: Vec<f64>,
}

impl FrequencyTwin {
    fn new(octaves: usize, base: Base, identity: Identity, w: &[f32]) -> Self {
        let kappa = if base == Base::Pi { std::f64::consts::PI } else { 1.0 };
        Self { octaves, kappa, identity: identity == Identity::Include, w: w.iter().map(|&w| f64::from(w)).collect() }
    }

    fn values(&self, x: &[f64], out: &mut [f64]) {
        let mut all = if self.identity { x.to_vec() } else { Vec::new() };
        for k in 0..self.octaves {
            let f = 2.0_f64.powi(k as i32) * self.kappa;
            all.extend(x.iter().map(|x| self.w[k] * (f * x).sin()));
            all.extend(x.iter().map(|x| self.w[k] * (f * x).cos()));
        }
        out.copy_from_slice(&all);
    }

    fn tangent(&self, x: &[f64], x_dot: &[f64], out: &mut [f64]) {
        let mut all = if self.identity { x_dot.to_vec() } else { Vec::new() };
        for k in 0..self.octaves {
            let f = 2.0_f64.powi(k as i32) * self.kappa;
            all.extend(x.iter().zip(x_dot).map(|(x, d)| self.w[k] * f * d * (f * x).cos()));
            all.extend(x.iter().zip(x_dot).map(|(x, d)| -self.w[k] * f * d * (f * x).sin()));
        }
        out.copy_from_slice(&all);
    }

    fn backward(&self, x: &[f64], out_bar: &[f64], x_bar: &mut [f64]) {
        let mut at = 0;
        if self.identity {
            x_bar.iter_mut().zip(out_bar).for_each(|(x, o)| *x += o);
            at = x.len();
        }
        for k in 0..self.octaves {
            let f = 2.0_f64.powi(k as i32) * self.kappa;
            for (d, x) in x.iter().enumerate() {
                let (s, c) = (out_bar[at + d], out_bar[at + x_bar.len() + d]);
                x_bar[d] += self.w[k] * f * ((f * x).cos() * s - (f * x).sin() * c);
            }
            at += 2 * x.len();
        }
    }
}

/// The rows of an encoding with a window, from those without one: what is computed and multiplied by the weights.
fn weighted(encoding: &Frequency, n: usize, w: &[f32], mut rows: Vec<f32>) -> Vec<f32> {
    let identity = encoding.out_rows() - 2 * encoding.dims() * encoding.octaves();
    for (i, value) in rows.iter_mut().enumerate() {
        let k = (i / n).checked_sub(identity).map(|row| row / (2 * encoding.dims()));
        *value *= k.map_or(1.0, |k| w[k]);
    }
    rows
}

#[test]
fn closed_octaves_are_what_multiplying_by_0_makes_of_them() {
    let n = 37;
    for (identity, w) in [
        (Identity::Include, [1.0, 0.0, 0.5, 0.0]),
        (Identity::Omit, [0.0, 1.0, 1.0, 0.0]),
        (Identity::Include, [0.0; 4]),
        (Identity::Omit, [-0.0, 0.0, 0.0, 0.25]),
    ] {
        let encoding = Frequency::new(3, 4, Base::One, identity).unwrap();
        let rows = encoding.out_rows();
        let (x, x_dot) = (uniform(1, 3 * n, -2.0, 2.0), uniform(2, 3 * n, -1.0, 1.0));
        let bar = uniform(3, rows * n, -1.0, 1.0);
        let bar_of_open = weighted(&encoding, n, &w, bar.clone());
        for simd in Simd::available() {
            // Outputs hold NaN before: what is not computed must still be written.
            let (mut got, mut all) = (vec![f32::NAN; rows * n], vec![0.0; rows * n]);
            encoding.encode(simd, &x, Some(&w), &mut got).unwrap();
            encoding.encode(simd, &x, None, &mut all).unwrap();
            assert_eq!(got, weighted(&encoding, n, &w, all.clone()), "{w:?}");
            encoding.tangent(simd, &x, Some(&w), &x_dot, &mut got).unwrap();
            encoding.tangent(simd, &x, None, &x_dot, &mut all).unwrap();
            // A weight of 0.5 is exact wherever it is multiplied.
            assert_eq!(got, weighted(&encoding, n, &w, all), "{w:?}");
            let (mut got, mut all) = (vec![0.5; 3 * n], vec![0.5; 3 * n]);
            encoding.encode_backward(simd, &x, Some(&w), &bar, &mut got).unwrap();
            encoding.encode_backward(simd, &x, None, &bar_of_open, &mut all).unwrap();
            assert_eq!(got, all, "{w:?}");
            encoding.tangent_backward_x(simd, &x, Some(&w), &x_dot, &bar, &mut got).unwrap();
            encoding.tangent_backward_x(simd, &x, None, &x_dot, &bar_of_open, &mut all).unwrap();
            assert_eq!(got, all, "{w:?}");
        }
    }
}

#[test]
fn a_closed_octave_says_0_where_the_input_is_no_number_and_an_open_one_nan() {
    let encoding = Frequency::new(1, 2, Base::One, Identity::Include).unwrap();
    for x in [f32::NAN, f32::INFINITY] {
        let (mut out, mut x_bar) = ([0.0; 5], [0.0]);
        encoding.encode(Simd::best(), &[x], Some(&[1.0, 0.0]), &mut out).unwrap();
        assert!(!out[0].is_finite() && out[1].is_nan() && out[2].is_nan(), "{out:?}");
        assert_eq!(out[3..], [0.0, 0.0]);
        encoding.encode_backward(Simd::best(), &[x], Some(&[0.0, 0.0]), &[1.0; 5], &mut x_bar).unwrap();
        assert_eq!(x_bar, [1.0]);
    }
}

#[test]
fn frequency_matches_its_twin_and_differences() {
    for (dims, octaves, base, identity) in [
        (3, 5, Base::One, Identity::Include),
        (3, 4, Base::Pi, Identity::Omit),
        (1, 3, Base::Pi, Identity::Include),
        (2, 0, Base::One, Identity::Include),
    ] {
        let encoding = Frequency::new(dims, octaves, base, identity).unwrap();
        let mut w = vec![0.0; octaves];
        window::nerfies(2.4, &mut w);
        let twin = FrequencyTwin::new(octaves, base, identity, &w);
        let rows = encoding.out_rows();
        let x = uniform(7, dims, -1.0, 1.0);
        let x64: Vec<f64> = x.iter().map(|&x| f64::from(x)).collect();
        let x_dot = cotangent(dims, 3);
        for simd in Simd::available() {
            check_f32_pair(
                &x,
                &f32s(&cotangent(rows, 1)),
                (
                    |x, out| encoding.encode(simd, x, Some(&w), out).unwrap(),
                    |x, out_bar, x_bar| encoding.encode_backward(simd, x, Some(&w), out_bar, x_bar).unwrap(),
                ),
                (|x, out| twin.values(x, out), |x, out_bar, x_bar| twin.backward(x, out_bar, x_bar)),
                PairTolerances { twin: Tolerance::new(1e-6, 1e-7), ..Default::default() },
            )
            .unwrap();
            let tangent = |x: &[f64], d: &[f64], out: &mut [f64]| twin.tangent(x, d, out);
            check_tangent(&x64, &x_dot, rows, |x, out| twin.values(x, out), tangent, Tolerance::new(1e-6, 1e-7))
                .unwrap();
            let (mut got, mut want) = (vec![f32::NAN; rows], vec![0.0; rows]);
            encoding.tangent(simd, &x, Some(&w), &f32s(&x_dot), &mut got).unwrap();
            twin.tangent(&x64, &x_dot, &mut want);
            compare("tangent", &got, &want, Tolerance::SINGLE).unwrap();
            // The second derivative against differences of the f64 tangent.
            let bar = cotangent(rows, 2);
            let mut x_bar = vec![0.0; dims];
            encoding.tangent_backward_x(simd, &x, Some(&w), &f32s(&x_dot), &f32s(&bar), &mut x_bar).unwrap();
            let want = testkit::gradient::central_difference(&x64, |x| {
                let mut out = vec![0.0; rows];
                twin.tangent(x, &x_dot, &mut out);
                out.iter().zip(&bar).map(|(o, b)| o * b).sum()
            });
            compare("second derivative", &x_bar, &want, Tolerance::SINGLE).unwrap();
        }
    }
}

#[test]
fn frequency_of_zero_is_sines_0_and_cosines_1() {
    let encoding = Frequency::new(2, 6, Base::Pi, Identity::Omit).unwrap();
    let mut out = vec![9.0; 24];
    encoding.encode(Simd::best(), &[0.0, -0.0], None, &mut out).unwrap();
    for rows in out.chunks(4) {
        assert_eq!(rows, [0.0, 0.0, 1.0, 1.0]);
    }
}

#[test]
fn frequency_has_the_channels_of_the_paper_and_the_code() {
    let rows = |octaves, base, identity| Frequency::new(3, octaves, base, identity).unwrap().out_rows();
    assert_eq!((rows(10, Base::One, Identity::Include), rows(4, Base::One, Identity::Include)), (63, 27));
    assert_eq!((rows(10, Base::Pi, Identity::Omit), rows(4, Base::Pi, Identity::Omit)), (60, 24));
    assert!(Frequency::new(0, 4, Base::One, Identity::Include).is_err());
    assert!(Frequency::new(3, 0, Base::One, Identity::Omit).is_err());
    assert!(Frequency::new(3, 33, Base::One, Identity::Omit).is_err());
}

// ---- spherical harmonics

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

// ---- dense grid

/// Twin: features, and gradients of `<bar, features>` with respect to table and position.
fn dense_twin(grid: &DenseGrid, params: &[f64], x: &[f64], out: &mut [f64]) {
    let [rx, ry, rz] = grid.resolution().map(|r| r as usize);
    let mut cell = [0; 3];
    let mut f = [0.0; 3];
    for (a, r) in [rx, ry, rz].into_iter().enumerate() {
        let p = x[a].clamp(0.0, 1.0) * (r - 1) as f64;
        cell[a] = (p as usize).min(r.saturating_sub(2));
        f[a] = p - cell[a] as f64;
    }
    out.fill(0.0);
    for c in 0..8 {
        let bit = [c & 1, c >> 1 & 1, c >> 2];
        let w: f64 = (0..3).map(|a| if bit[a] == 1 { f[a] } else { 1.0 - f[a] }).product();
        if w == 0.0 {
            continue;
        }
        let vertex = cell[0] + bit[0] + rx * (cell[1] + bit[1] + ry * (cell[2] + bit[2]));
        for (k, out) in out.iter_mut().enumerate() {
            *out += w * params[vertex * grid.features() + k];
        }
    }
}

#[test]
fn dense_grid_matches_its_twin_for_any_number_of_features() {
    for (resolution, features) in [([4, 5, 3], 1), ([2, 2, 2], 3), ([7, 1, 3], 5), ([3, 4, 5], 15), ([1, 1, 1], 2)] {
        let grid = DenseGrid::new(resolution, features, Interpolation::Linear).unwrap();
        let params = uniform(1, grid.params_len(), -1.0, 1.0);
        let params64: Vec<f64> = params.iter().map(|&p| f64::from(p)).collect();
        const N: usize = 23;
        let x = uniform(2, 3 * N, -0.1, 1.1);
        let bar = cotangent(features * N, 4);
        let point = |i: usize| [0, 1, 2].map(|a| f64::from(x[a * N + i]));
        let bar_of = |i: usize| (0..features).map(|k| bar[k * N + i]).collect::<Vec<_>>();
        let mut want = vec![0.0; features * N];
        let (mut want_grad, mut want_x) = (vec![0.0; params.len()], vec![0.0; 3 * N]);
        for i in 0..N {
            let mut out = vec![0.0; features];
            dense_twin(&grid, &params64, &point(i), &mut out);
            (0..features).for_each(|k| want[k * N + i] = out[k]);
            // Linear in the table: a unit vector gives its derivative exactly.
            for (p, grad) in want_grad.iter_mut().enumerate() {
                let mut one = vec![0.0; params.len()];
                one[p] = 1.0;
                dense_twin(&grid, &one, &point(i), &mut out);
                *grad += out.iter().zip(bar_of(i)).map(|(o, b)| o * b).sum::<f64>();
            }
            let gradient = testkit::gradient::central_difference(&point(i), |x| {
                dense_twin(&grid, &params64, x, &mut out);
                out.iter().zip(bar_of(i)).map(|(o, b)| o * b).sum()
            });
            (0..3).for_each(|a| want_x[a * N + i] = gradient[a]);
        }
        let mut bits_of_all = Vec::new();
        for simd in Simd::available() {
            let (mut out, mut grad, mut x_bar) =
                (vec![f32::NAN; features * N], vec![0.0; params.len()], vec![0.0; 3 * N]);
            grid.encode(simd, &params, &x, &mut out).unwrap();
            grid.encode_backward(simd, &x, &f32s(&bar), &mut grad).unwrap();
            grid.encode_backward_x(simd, &params, &x, &f32s(&bar), &mut x_bar).unwrap();
            compare("features", &out, &want, Tolerance::new(2e-6, 1e-6)).unwrap();
            compare("table gradient", &grad, &want_grad, Tolerance::SINGLE).unwrap();
            compare("position gradient", &x_bar, &want_x, Tolerance::SINGLE).unwrap();
            // The tangent is the adjoint of the position gradient, and linear in the table.
            let x_dot = uniform(6, 3 * N, -1.0, 1.0);
            let (mut tangent, mut tangent_grad) = (vec![0.0; features * N], vec![0.0; params.len()]);
            grid.tangent(simd, &params, &x, &x_dot, &mut tangent).unwrap();
            grid.tangent_backward(simd, &x, &x_dot, &f32s(&bar), &mut tangent_grad).unwrap();
            let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(a * b)).sum::<f64>();
            let bar = f32s(&bar);
            let three = [dot(&tangent, &bar), dot(&x_bar, &x_dot), dot(&tangent_grad, &params)];
            assert!((three[0] - three[1]).abs() < 1e-4 * (1.0 + three[0].abs()), "{three:?}");
            assert!((three[0] - three[2]).abs() < 1e-4 * (1.0 + three[0].abs()), "{three:?}");
            bits_of_all.push([bits(&out), bits(&grad), bits(&x_bar), bits(&tangent)]);
        }
        assert!(bits_of_all.windows(2).all(|pair| pair[0] == pair[1]));
    }
}

#[test]
fn dense_grid_interpolates_its_vertices_and_refuses_bad_sizes() {
    let grid = DenseGrid::new([3, 2, 4], 1, Interpolation::Smoothstep).unwrap();
    let params = uniform(1, 24, -1.0, 1.0);
    for v in 0..24 {
        let x = [(v % 3) as f32 / 2.0, (v / 3 % 2) as f32, (v / 6) as f32 / 3.0];
        let mut out = [0.0];
        grid.encode(Simd::best(), &params, &x, &mut out).unwrap();
        assert!((out[0] - params[v]).abs() < 1e-6);
    }
    assert!(DenseGrid::new([0, 2, 2], 1, Interpolation::Linear).is_err());
    assert!(DenseGrid::new([2, 2, 2], 0, Interpolation::Linear).is_err());
    assert!(DenseGrid::new([1 << 20, 1 << 20, 1 << 20], usize::MAX, Interpolation::Linear).is_err());
    assert!(grid.encode(Simd::best(), &params[1..], &[], &mut []).is_err());
    assert_eq!(grid.encode(Simd::best(), &params, &[], &mut []), Ok(()));
    let mut x_bar = [0.0; 3];
    grid.encode_backward_x(Simd::best(), &params, &[f32::NAN, -1.0, 2.0], &[1.0], &mut x_bar).unwrap();
    assert_eq!(x_bar, [0.0; 3]);
}

#[test]
fn dense_grid_second_derivative_matches_differences() {
    for interpolation in [Interpolation::Linear, Interpolation::Smoothstep] {
        let grid = DenseGrid::new([4, 3, 5], 3, interpolation).unwrap();
        let params = uniform(1, grid.params_len(), -1.0, 1.0);
        let (x, x_dot, bar) = ([0.41, 0.23, 0.68], [0.3, -0.8, 0.5], [1.0, -0.5, 0.25]);
        let mut x_bar = [0.0; 3];
        grid.tangent_backward_x(Simd::best(), &params, &x, &x_dot, &bar, &mut x_bar).unwrap();
        for a in 0..3 {
            let at = |s: f32| {
                let mut x = x;
                x[a] += s;
                let mut out = [0.0; 3];
                grid.tangent(Simd::best(), &params, &x, &x_dot, &mut out).unwrap();
                out.iter().zip(&bar).map(|(o, b)| f64::from(*o) * f64::from(*b)).sum::<f64>()
            };
            // Quadratic at most inside the cell, so a wide step is exact to rounding.
            let want = (at(0.01) - at(-0.01)) / 0.02;
            assert!((f64::from(x_bar[a]) - want).abs() < 2e-3 * (1.0 + want.abs()), "{} {want}", x_bar[a]);
        }
    }
}

// ---- embedding

#[test]
fn embedding_gathers_and_adds_back_in_order() {
    let embedding = Embedding::new(4, 2);
    let table = [0.0, 1.0, 10.0, 11.0, 20.0, 21.0, 30.0, 31.0];
    let index = [3, 0, 3];
    let mut out = [0.0; 6];
    embedding.encode(&table, &index, &mut out).unwrap();
    assert_eq!(out, [30.0, 0.0, 30.0, 31.0, 1.0, 31.0]);
    let mut grad = [1.0; 8];
    embedding.encode_backward(&index, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], &mut grad).unwrap();
    assert_eq!(grad, [3.0, 6.0, 1.0, 1.0, 1.0, 1.0, 5.0, 11.0]);
    let mut mean = [0.0; 2];
    embedding.mean(&table, &mut mean).unwrap();
    assert_eq!(mean, [15.0, 16.0]);
    let error = embedding.encode(&table, &[0, 4], &mut [0.0; 4]).unwrap_err();
    assert_eq!(error.to_string(), "`index[1]` is 4, but there are only 4 entries");
    assert_eq!(Embedding::new(0, 3).encode(&[], &[], &mut []), Ok(()));
}

#[test]
fn embedding_gradient_matches_differences() {
    let embedding = Embedding::new(5, 3);
    let index = [1, 4, 1, 0];
    let table: Vec<f64> = cotangent(15, 8);
    check_pair(
        &table,
        &cotangent(12, 9),
        |table, out| {
            for c in 0..3 {
                (0..4).for_each(|i| out[c * 4 + i] = table[index[i] as usize * 3 + c]);
            }
        },
        |_, out_bar, grad| {
            // The function under test; these cotangents are exact in f32.
            let mut grad32 = f32s(grad);
            embedding.encode_backward(&index, &f32s(out_bar), &mut grad32).unwrap();
            grad.iter_mut().zip(&grad32).for_each(|(g, g32)| *g = f64::from(*g32));
        },
        Tolerance::TWIN,
    )
    .unwrap();
}

// ---- properties

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// A batch is its samples one by one, at every length and level.
    #[test]
    fn batches_equal_single_samples(n in 0..40_usize, seed in 0..1000_u64) {
        let encoding = Frequency::new(3, 4, Base::One, Identity::Include).unwrap();
        let basis = SphericalHarmonics::new(4, Directions::Any).unwrap();
        let grid = DenseGrid::new([5, 4, 3], 3, Interpolation::Linear).unwrap();
        let params = uniform(seed + 1, grid.params_len(), -1.0, 1.0);
        let x = uniform(seed, 3 * n, 0.01, 1.0);
        for simd in Simd::available() {
            let rows = [encoding.out_rows(), basis.out_rows(), 3];
            let run = |x: &[f32]| {
                let n = x.len() / 3;
                let mut out = rows.map(|r| vec![f32::NAN; r * n]);
                encoding.encode(simd, x, None, &mut out[0]).unwrap();
                basis.encode(simd, x, &mut out[1]).unwrap();
                grid.encode(simd, &params, x, &mut out[2]).unwrap();
                out
            };
            let batch = run(&x);
            for i in 0..n {
                let single = run(&[x[i], x[n + i], x[2 * n + i]]);
                for (batch, single) in batch.iter().zip(&single) {
                    for (r, y) in single.iter().enumerate() {
                        prop_assert_eq!(y.to_bits(), batch[r * n + i].to_bits());
                    }
                }
            }
        }
    }

    /// `sin^2 + cos^2 = 1`, and with the base pi a shift by 2 changes nothing.
    #[test]
    fn frequency_lies_on_circles_and_is_periodic(x in -64..64_i32, fraction in 0..1024_i32) {
        let encoding = Frequency::new(1, 8, Base::Pi, Identity::Omit).unwrap();
        let x = x as f32 + fraction as f32 / 1024.0;
        let (mut out, mut shifted) = ([0.0; 16], [0.0; 16]);
        encoding.encode(Simd::best(), &[x], None, &mut out).unwrap();
        encoding.encode(Simd::best(), &[x + 2.0], None, &mut shifted).unwrap();
        prop_assert_eq!(out, shifted);
        for pair in out.chunks(2) {
            prop_assert!((pair[0] * pair[0] + pair[1] * pair[1] - 1.0).abs() < 1e-6);
        }
    }

    /// The energy of a band does not depend on the direction: `(2 l + 1) / (4 pi)`.
    #[test]
    fn bands_have_the_same_energy_in_every_direction(d in testkit::strategies::any_unit_vector()) {
        let basis = SphericalHarmonics::new(5, Directions::Any).unwrap();
        let mut y = [0.0; 25];
        basis.encode(Simd::best(), &d.map(|x| x as f32), &mut y).unwrap();
        for l in 0..5_usize {
            let energy: f32 = y[l * l..(l + 1) * (l + 1)].iter().map(|y| y * y).sum();
            let want = (2 * l + 1) as f32 / (4.0 * std::f32::consts::PI);
            prop_assert!((energy - want).abs() < 1e-5, "band {}: {} against {}", l, energy, want);
        }
    }

    /// Gradients through the normalisation are tangent to the sphere: moving along the direction changes nothing.
    #[test]
    fn direction_gradients_are_tangent(d in testkit::strategies::any_unit_vector(), seed in 0..100_u64) {
        let basis = SphericalHarmonics::new(4, Directions::Any).unwrap();
        let d = d.map(|x| 3.0 * x as f32);
        let mut d_bar = [0.0; 3];
        basis.encode_backward(Simd::best(), &d, &uniform(seed, 16, -1.0, 1.0), &mut d_bar).unwrap();
        let along: f32 = (0..3).map(|a| d[a] * d_bar[a]).sum();
        prop_assert!(along.abs() < 1e-5 * (1.0 + d_bar.iter().map(|g| g.abs()).sum::<f32>()), "{}", along);
    }
}
