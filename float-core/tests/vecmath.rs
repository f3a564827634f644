//! The errors that `vecmath` states, measured; which levels give the same bits; the edges.

use float_core::vecmath::{Function, sin_cos};
use float_core::{Simd, SimdLevel, Task, Vector};

/// Every 6151st bit pattern: a prime, so that no pattern of the bits is missed. All of them: see `examples/vecmath_table.rs`.
fn arguments() -> Vec<f32> {
    (0..=u32::MAX).step_by(6151).map(f32::from_bits).collect()
}

const EDGES: [f32; 16] = [
    0.0,
    -0.0,
    1e-45,
    -1e-45,
    f32::MIN_POSITIVE,
    -f32::MIN_POSITIVE,
    1.0,
    -1.0,
    -104.5,
    1e5,
    33_554_432.0,
    -33_554_430.0,
    f32::MAX,
    f32::MIN,
    f32::INFINITY,
    f32::NEG_INFINITY,
];

fn mapped(function: Function, simd: Simd, x: &[f32]) -> Vec<f32> {
    let mut y = vec![7.0; x.len()];
    function.map(simd, x, &mut y);
    y
}

fn bits(x: &[f32]) -> Vec<u32> {
    // NaN is NaN, whatever its payload.
    x.iter().map(|x| if x.is_nan() { f32::NAN.to_bits() } else { x.to_bits() }).collect()
}

#[test]
fn functions_keep_their_stated_errors_over_all_arguments() {
    let x = arguments();
    for function in Function::ALL {
        let exact: Vec<f64> = x.iter().map(|&x| function.exact(f64::from(x))).collect();
        for simd in Simd::available() {
            let (worst, bound) = (function.worst(simd, &x, &exact), function.bound(simd.level()));
            println!("{} {:?}: {:.3} ulp at {:e}, states {bound}", function.name(), simd.level(), worst.ulp, worst.at);
            assert!(worst.ulp <= bound, "{} {:?}: {worst:?}, states {bound}", function.name(), simd.level());
            // A bound far above what happens says nothing.
            assert!(worst.ulp >= 0.7 * bound, "{} {:?}: {worst:?}, states {bound}", function.name(), simd.level());
        }
    }
}

#[test]
fn functions_keep_their_stated_errors_at_the_edges() {
    for function in Function::ALL {
        let x = if function == Function::ExpNeg { EDGES.map(f32::abs) } else { EDGES };
        let exact = x.map(|x| function.exact(f64::from(x)));
        for simd in Simd::available() {
            let worst = function.worst(simd, &x, &exact);
            assert!(worst.ulp <= function.bound(simd.level()), "{} {:?}: {worst:?}", function.name(), simd.level());
        }
    }
}

#[test]
fn nan_stays_nan_except_where_stated() {
    for simd in Simd::available() {
        for function in Function::ALL {
            let y = mapped(function, simd, &[f32::NAN; 17]);
            let stated = match function {
                Function::ExpNeg => Some(0.0),
                Function::ExpM1 => Some(mapped(function, simd, &[88.0])[0]),
                _ => None,
            };
            let holds = |y: &f32| stated.map_or(y.is_nan(), |s| *y == s);
            assert!(y.iter().all(holds), "{} {:?}: {y:?}", function.name(), simd.level());
        }
    }
}

#[test]
fn fused_levels_agree_and_circular_functions_agree_at_every_level() {
    let x: Vec<f32> = arguments().into_iter().step_by(7).chain(EDGES).collect();
    for function in Function::ALL {
        let circular = matches!(function, Function::Sin | Function::Cos | Function::SinPi | Function::CosPi);
        let mut seen: Option<Vec<u32>> = None;
        for simd in Simd::available().filter(|s| circular || s.level() != SimdLevel::Scalar) {
            let y = bits(&mapped(function, simd, &x));
            let first = seen.get_or_insert_with(|| y.clone());
            for ((a, b), x) in first.iter().zip(&y).zip(&x) {
                assert_eq!(a, b, "{} {:?} at {x:e}", function.name(), simd.level());
            }
        }
    }
}

#[test]
fn a_value_does_not_depend_on_its_neighbours() {
    // Large arguments send their vector through `f64` functions; the others in it keep their bits.
    let x: Vec<f32> = (0..70).map(|i| if i % 5 == 3 { 1e9 + 1e7 * i as f32 } else { 0.37 * i as f32 - 9.0 }).collect();
    for function in Function::ALL {
        for simd in Simd::available() {
            let together = mapped(function, simd, &x);
            for n in 0..x.len() {
                assert_eq!(bits(&mapped(function, simd, &x[..n])), bits(&together[..n]));
            }
            let alone: Vec<f32> = x.iter().flat_map(|&x| mapped(function, simd, &[x])).collect();
            assert_eq!(bits(&alone), bits(&together), "{} {:?}", function.name(), simd.level());
        }
    }
}

#[test]
fn large_arguments_are_rounded_f64_sines() {
    let x: Vec<f32> = (0..64).map(|i| 33_554_432.0 * 1.3_f32.powi(i)).flat_map(|x| [x, -x]).collect();
    for simd in Simd::available() {
        for (x, y) in x.iter().zip(mapped(Function::Sin, simd, &x)) {
            assert!((f64::from(y) - f64::from(*x).sin()).abs() < 3.1e-8, "{simd:?} {x:e}");
        }
    }
}

#[test]
fn sine_and_cosine_come_together_as_alone() {
    struct Both<'a>(&'a [f32], &'a mut [f32], &'a mut [f32]);
    impl Task for Both<'_> {
        type Output = ();
        #[inline(always)]
        fn run<V: Vector>(self) {
            let out = self.1.chunks_exact_mut(V::LANES).zip(self.2.chunks_exact_mut(V::LANES));
            for (x, (s, c)) in self.0.chunks_exact(V::LANES).zip(out) {
                let (sin, cos) = sin_cos(V::load(x));
                sin.store(s);
                cos.store(c);
            }
        }
    }
    let x: Vec<f32> = (0..256).map(|i| 1.37 * i as f32 - 170.0).collect();
    for simd in Simd::available() {
        let (mut s, mut c) = (vec![0.0; 256], vec![0.0; 256]);
        simd.run(Both(&x, &mut s, &mut c));
        assert_eq!((s, c), (mapped(Function::Sin, simd, &x), mapped(Function::Cos, simd, &x)));
    }
}

#[test]
fn known_values() {
    for simd in Simd::available() {
        let at = |f: Function, x: f32| mapped(f, simd, &[x])[0];
        assert_eq!(at(Function::ExpM1, -1e-38), -1e-38);
        assert_eq!(at(Function::ExpM1, f32::NEG_INFINITY), -1.0);
        assert_eq!(
            (at(Function::ExpNeg, 0.0), at(Function::ExpNeg, 87.0), at(Function::ExpNeg, 1e38)),
            (1.0, 0.0, 0.0)
        );
        assert!(at(Function::ExpNeg, 86.99) > 0.0 && at(Function::Exp, f32::INFINITY).is_finite());
        assert_eq!((at(Function::Ln, 1.0), at(Function::Ln, 0.0)), (0.0, f32::NEG_INFINITY));
        assert_eq!(
            (at(Function::Ln, f32::INFINITY), at(Function::Softplus, f32::INFINITY)),
            (f32::INFINITY, f32::INFINITY)
        );
        // e^-103 is the smallest number but one.
        assert_eq!((at(Function::Softplus, -103.0), at(Function::Logistic, -103.0)), (1e-45, 1e-45));
        assert_eq!((at(Function::Logistic, 0.0), at(Function::Logistic, 200.0)), (0.5, 1.0));
        assert_eq!((at(Function::Tanh, 1e-30), at(Function::Tanh, -50.0)), (1e-30, -1.0));
        assert_eq!((at(Function::SinPi, 3.0), at(Function::CosPi, 3.0)), (0.0, -1.0));
        assert_eq!((at(Function::SinPi, -0.5), at(Function::CosPi, -0.5)), (-1.0, 0.0));
        assert_eq!((at(Function::SinPi, f32::MAX), at(Function::CosPi, f32::MAX)), (0.0, 1.0));
        assert!(mapped(Function::Sin, simd, &[]).is_empty());
    }
}
