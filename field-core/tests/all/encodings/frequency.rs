//! Frequency encoding, with windows and without.

use super::{f32s, uniform};
use field_core::encoding::frequency::{Base, Frequency, Identity};
use field_core::encoding::window;
use float_core::Simd;
use testkit::gradient::{PairTolerances, Tolerance, check_f32_pair, check_tangent, compare, cotangent};

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
