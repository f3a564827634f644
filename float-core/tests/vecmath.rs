//! The errors that `vecmath` states, measured.

use float_core::{Simd, Task, Vector, vecmath};

struct Map<'a>(Function, &'a mut [f32]);

#[derive(Clone, Copy, Debug)]
enum Function {
    Exp,
    ExpM1,
    ExpNeg,
}

impl Task for Map<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        for x in self.1.chunks_exact_mut(V::LANES) {
            let v = V::load(x);
            match self.0 {
                Function::Exp => vecmath::exp(v),
                Function::ExpM1 => vecmath::exp_m1(v),
                Function::ExpNeg => vecmath::exp_neg(v),
            }
            .store(x);
        }
    }
}

/// Distance in units of the last place of `want`.
fn ulps(got: f32, want: f64) -> f64 {
    let ulp = f64::from((want as f32).abs().max(f32::MIN_POSITIVE).next_up())
        - f64::from((want as f32).abs().max(f32::MIN_POSITIVE));
    (f64::from(got) - want).abs() / ulp
}

/// Worst error of a function over the arguments, and where.
fn worst(simd: Simd, function: Function, x: &[f32], exact: impl Fn(f64) -> f64) -> (f64, f32) {
    let mut y = x.to_vec();
    y.resize(x.len().next_multiple_of(16), 0.0);
    simd.run(Map(function, &mut y));
    x.iter()
        .zip(&y)
        .map(|(&x, &y)| (ulps(y, exact(f64::from(x))), x))
        .fold((0.0, 0.0), |a, b| if b.0 > a.0 { b } else { a })
}

/// Every 613th number of each sign up to `max`, subnormals too: a prime, so that no pattern of the bits is missed.
fn arguments(max: f32) -> Vec<f32> {
    let to = max.to_bits();
    (0..to).step_by(613).flat_map(|bits| [f32::from_bits(bits), -f32::from_bits(bits)]).collect()
}

#[test]
fn exponentials_keep_their_stated_errors() {
    let x = arguments(87.0);
    let positive: Vec<f32> = x.iter().map(|x| x.abs()).collect();
    for simd in Simd::available() {
        let exp = worst(simd, Function::Exp, &x, f64::exp);
        let exp_m1 = worst(simd, Function::ExpM1, &x, f64::exp_m1);
        let exp_neg = worst(simd, Function::ExpNeg, &positive, |x| (-x).exp());
        println!("{simd:?}: exp {exp:?}, exp_m1 {exp_m1:?}, exp_neg {exp_neg:?}");
        assert!(exp.0 <= 2.0 && exp_m1.0 <= 2.0 && exp_neg.0 <= 2.0, "{simd:?}: {exp:?} {exp_m1:?} {exp_neg:?}");
    }
}

#[test]
fn exponentials_at_the_edges() {
    for simd in Simd::available() {
        let x = [0.0, -0.0, 1e-45, -1e-45, -1e-38, -88.0, -1e30, f32::NEG_INFINITY];
        let mut y = [x, x].concat();
        simd.run(Map(Function::ExpM1, &mut y));
        assert_eq!(y[..8], [0.0, 0.0, 1e-45, -1e-45, -1e-38, -1.0, -1.0, -1.0], "{simd:?}");
        let mut y = [0.0, 87.0, 87.1, 1e38, f32::INFINITY, f32::NAN, 1e-45, 86.99].repeat(2);
        simd.run(Map(Function::ExpNeg, &mut y));
        assert_eq!(y[..7], [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], "{simd:?}");
        assert!(y[7] > 0.0);
    }
}
