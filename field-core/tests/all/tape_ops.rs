//! Every operation of the tape: value, gradient, tangent, gradient of the tangent, against the f64 twin.

use crate::tape_twin::{self, Program, Step, TIGHT, Tolerance, Unary, check, numbers};

/// One step over leaves of the given shapes, at random points in `[low, high)`.
#[track_caller]
fn check_step(leaves: &[(usize, usize)], step: Step, low: f64, high: f64) {
    let program = Program::new(leaves, vec![step]);
    for seed in 0..3 {
        let draw = |salt: u64, low: f64, high: f64| {
            leaves
                .iter()
                .zip(10..)
                .map(|(&(r, c), i)| numbers(seed * 100 + salt + i, r * c, low, high))
                .collect::<Vec<_>>()
        };
        check(&program, &draw(0, low, high), &draw(50, -1.0, 1.0), TIGHT);
    }
}

#[test]
fn unary_functions_match_the_twin() {
    use Unary::*;
    // Widths on both sides of a vector of 16.
    for cols in [1, 5, 16, 19] {
        for f in [
            Affine(1.5, -0.5),
            Affine(-2.0, 0.0),
            Neg,
            Square,
            Exp,
            TruncExp,
            Sin,
            Cos,
            Relu,
            Max0,
            LeakyRelu(0.1),
            Softplus(0.0),
            Softplus(-1.0),
            Logistic,
            LogisticDerivative,
            Tanh,
            Abs,
            Pow(2.0),
            Pow(3.0),
            Pow(0.0),
            Pow(1.0),
            Clamp(-0.5, 0.75),
            Sign,
            Inside(-0.5, 0.75),
        ] {
            check_step(&[(2, cols)], Step::Unary(f, 0), -2.0, 2.0);
        }
        for f in [Sqrt, Rsqrt, Recip, Log, Pow(0.5), Pow(-0.5), Pow(1.7)] {
            check_step(&[(2, cols)], Step::Unary(f, 0), 0.3, 3.0);
        }
        check_step(&[(2, cols)], Step::Unary(Recip, 0), -3.0, -0.4);
        // Small angles, angles around pi, past the series; imaginary ones.
        for k in 0..=5 {
            for (low, high) in [(0.0, 0.1), (0.0, 10.0), (9.0, 11.0), (15.0, 40.0), (-12.0, 0.0)] {
                check_step(&[(2, cols)], Step::Unary(Stumpff(k), 0), low, high);
            }
        }
    }
}

#[test]
fn binary_functions_match_the_twin() {
    for cols in [1, 5, 16, 19] {
        let two = [(3, cols), (3, cols)];
        for step in [Step::Add(0, 1), Step::Sub(0, 1), Step::Mul(0, 1), Step::Gate(0, 1, 0.0), Step::Gate(0, 1, 0.2)] {
            check_step(&two, step, -2.0, 2.0);
        }
        check_step(&two, Step::Div(0, 1), 0.5, 2.0);
        // One node twice: gradients add up.
        for step in [Step::Add(0, 0), Step::Sub(0, 0), Step::Mul(0, 0)] {
            check_step(&two[..1], step, -2.0, 2.0);
        }
        check_step(&two[..1], Step::Div(0, 0), 0.5, 2.0);
    }
}

#[test]
fn row_operations_match_the_twin() {
    for n in [1, 3, 16, 21] {
        check_step(&[(3, n), (1, n)], Step::MulRow(0, 1), -1.0, 1.0);
        check_step(&[(1, n)], Step::MulRow(0, 0), -1.0, 1.0);
        check_step(&[(2, n), (1, n), (3, n)], Step::Concat(vec![0, 1, 2, 1]), -1.0, 1.0);
        check_step(&[(5, n)], Step::Slice(0, 1, 4), -1.0, 1.0);
        check_step(&[(1, n)], Step::BroadcastFeatures(0, 4), -1.0, 1.0);
        check_step(&[(3, 1)], Step::BroadcastSamples(0, n), -1.0, 1.0);
        check_step(&[(3, n)], Step::SumFeatures(0), -1.0, 1.0);
        check_step(&[(3, n)], Step::SumSamples(0), -1.0, 1.0);
        check_step(&[(3, n)], Step::MeanSamples(0), -1.0, 1.0);
        check_step(&[(3, n), (1, n)], Step::WeightedSum(0, 1), -1.0, 1.0);
        check_step(&[(3, n)], Step::Sum(0), -1.0, 1.0);
        check_step(&[(3, n), (3, n)], Step::Dot(0, 1), -1.0, 1.0);
        check_step(&[(3, n)], Step::Dot(0, 0), -1.0, 1.0);
        check_step(&[(3, n), (3, n)], Step::Cross(0, 1), -1.0, 1.0);
        check_step(&[(3, n)], Step::Cross(0, 0), -1.0, 1.0);
        check_step(&[(3, n)], Step::Normalise(0), 0.3, 1.0);
        check_step(&[(9, n), (3, n)], Step::MatVec(0, 1), -1.0, 1.0);
        check_step(&[(6, n), (3, n)], Step::MatVec(0, 1), -1.0, 1.0);
    }
}

#[test]
fn linear_layers_match_the_twin() {
    for n in [1, 3, 16, 37, 70] {
        for (out, inputs) in [(1, 1), (4, 3), (5, 7)] {
            check_step(&[(out, inputs), (inputs, n)], Step::Linear(0, None, 1), -1.0, 1.0);
            check_step(&[(out, inputs), (out, 1), (inputs, n)], Step::Linear(0, Some(1), 2), -1.0, 1.0);
        }
    }
}

#[test]
fn the_derivatives_of_the_twin_are_those_of_its_values() {
    // The twin's own derivatives, which the tangents are compared with: 1e-7 in f64.
    use Unary::*;
    for f in [
        Affine(1.5, -0.5),
        Neg,
        Square,
        Sqrt,
        Rsqrt,
        Recip,
        Exp,
        TruncExp,
        Log,
        Sin,
        Cos,
        Relu,
        LeakyRelu(0.1),
        Softplus(-1.0),
        Logistic,
        LogisticDerivative,
        Tanh,
        Abs,
        Pow(1.7),
        Clamp(0.4, 0.9),
        Stumpff(1),
        Stumpff(4),
    ] {
        for x in [0.35, 0.71, 1.3] {
            let h = 1e-6;
            let want = (f.twin(x + h).0 - f.twin(x - h).0) / (2.0 * h);
            assert!((f.twin(x).1 - want).abs() < 1e-7 * want.abs().max(1.0), "{f:?} at {x}");
        }
    }
}

#[test]
fn saturated_functions_keep_the_digits_of_small_derivatives() {
    use Unary::*;
    // Derivatives down to 1e-12, compared with their own size.
    for f in [Logistic, LogisticDerivative, Softplus(0.0), Tanh, Exp, TruncExp] {
        for x in [-12.0_f32, -9.0, 9.0, 12.0] {
            let mut arena = field_core::tape::Arena::new();
            let mut tape = field_core::tape::Tape::new(&mut arena, &[]);
            let node = tape.input(1, 1, &[x]).unwrap();
            let y = f.tape(&mut tape, node).unwrap();
            tape.backward(&[(y, &[1.0])], &mut []).unwrap();
            let (got, want) = (f64::from(tape.gradient(node).unwrap()[0]), f.twin(x.into()).1);
            assert!((got - want).abs() <= 2e-6 * want.abs(), "{f:?} at {x}: {got:e} should be {want:e}");
        }
    }
}

#[test]
fn trunc_exp_clamps_the_derivative_and_not_the_value() {
    let program = Program::new(&[(1, 4)], vec![Step::Unary(Unary::TruncExp, 0)]);
    let x = vec![vec![-20.0, -14.0, 14.0, 20.0]];
    let (value, slope) = program.output(&x, &[vec![1.0; 4]]);
    let mut arena = field_core::tape::Arena::new();
    let mut tape = field_core::tape::Tape::new(&mut arena, &[]);
    let node = tape.input(1, 4, &tape_twin::narrow(&x[0])).unwrap();
    let seed = tape.fill(1, 4, 1.0);
    let y = tape.trunc_exp(node).unwrap();
    let [y_dot] = tape.jvp([y], &[(node, seed)]).unwrap();
    tape.backward(&[(y, &[1.0; 4])], &mut []).unwrap();
    for i in 0..4 {
        let relative = |got: f32, want: f64| (f64::from(got) / want - 1.0).abs();
        assert!(relative(tape.value(y).unwrap().data[i], value[i]) < 1e-6);
        assert!(relative(tape.value(y_dot).unwrap().data[i], slope[i]) < 1e-6);
        assert!(relative(tape.gradient(node).unwrap()[i], slope[i]) < 1e-6);
    }
    // Past the clamp the slope is flat: the second derivative is 0.
    tape.backward(&[(y_dot, &[1.0; 4])], &mut []).unwrap();
    let second = tape.gradient(node).unwrap();
    assert_eq!((second[0], second[3]), (0.0, 0.0));
    assert!(
        (f64::from(second[1]) / slope[1] - 1.0).abs() < 1e-6 && (f64::from(second[2]) / slope[2] - 1.0).abs() < 1e-6
    );
}

#[test]
fn kinks_have_the_documented_derivative() {
    for (f, want) in [
        (Unary::Relu, 0.0),
        (Unary::LeakyRelu(0.25), 0.25),
        (Unary::Abs, 0.0),
        (Unary::Sqrt, 0.0),
        (Unary::Rsqrt, 0.0),
        (Unary::Clamp(0.0, 1.0), 1.0),
        (Unary::Clamp(-1.0, 0.0), 1.0),
    ] {
        let mut arena = field_core::tape::Arena::new();
        let mut tape = field_core::tape::Tape::new(&mut arena, &[]);
        let x = tape.input(1, 1, &[0.0]).unwrap();
        let one = tape.fill(1, 1, 1.0);
        let y = f.tape(&mut tape, x).unwrap();
        let [y_dot] = tape.jvp([y], &[(x, one)]).unwrap();
        tape.backward_from(y, &mut []).unwrap();
        assert_eq!(tape.gradient(x).unwrap(), [want], "{f:?}");
        assert_eq!(tape.value(y_dot).unwrap().data, [want], "{f:?}");
    }
}

#[test]
fn extreme_values_stay_finite_and_nan_is_passed_on() {
    use Unary::*;
    let extremes = [-1e30_f32, -1e4, -88.0, -1e-30, 0.0, -0.0, 1e-40, 1e-30, 88.0, 1e4, 1e30];
    for f in [
        Exp,
        TruncExp,
        Softplus(0.0),
        Softplus(-1.0),
        Logistic,
        LogisticDerivative,
        Tanh,
        Relu,
        LeakyRelu(0.1),
        Sin,
        Cos,
        Abs,
        Clamp(0.0, 1.0),
        Stumpff(0),
        Stumpff(1),
        Stumpff(5),
    ] {
        let mut arena = field_core::tape::Arena::new();
        let mut tape = field_core::tape::Tape::new(&mut arena, &[]);
        let x = tape.input(1, extremes.len(), &extremes).unwrap();
        let y = f.tape(&mut tape, x).unwrap();
        tape.backward(&[(y, &[1.0; 11])], &mut []).unwrap();
        assert!(tape.value(y).unwrap().data.iter().all(|y| y.is_finite()), "{f:?}: {:?}", tape.value(y));
        assert!(tape.gradient(x).unwrap().iter().all(|y| y.is_finite()), "{f:?}");
    }
    for f in [
        Affine(1.0, 0.0),
        Square,
        Sqrt,
        Rsqrt,
        Recip,
        Exp,
        TruncExp,
        Log,
        Sin,
        Cos,
        Relu,
        LeakyRelu(0.1),
        Softplus(0.0),
        Logistic,
        LogisticDerivative,
        Tanh,
        Abs,
        Pow(2.0),
        Clamp(0.0, 1.0),
        Stumpff(2),
    ] {
        let mut arena = field_core::tape::Arena::new();
        let mut tape = field_core::tape::Tape::new(&mut arena, &[]);
        let x = tape.input(1, 1, &[f32::NAN]).unwrap();
        let y = f.tape(&mut tape, x).unwrap();
        assert!(tape.value(y).unwrap().data[0].is_nan(), "{f:?} hides NaN");
    }
}

#[test]
fn stumpff_keeps_its_stated_error_through_three_derivatives() {
    use field_core::stumpff::stumpff_derivative;
    let simds: Vec<_> = float_core::Simd::available().collect();
    for simd in simds {
        for k in 0..=5 {
            // 37 beside 1e4 and the like: a value does not depend on its neighbours.
            let grid: Vec<f32> = (-300..3000).map(|i| i as f32 * 0.043).collect();
            let mut arena = field_core::tape::Arena::with_simd(simd);
            let mut tape = field_core::tape::Tape::new(&mut arena, &[]);
            let u = tape.input(1, grid.len(), &grid).unwrap();
            let one = tape.fill(1, grid.len(), 1.0);
            let mut node = tape.stumpff(u, k).unwrap();
            for order in 0..4 {
                let value = tape.value(node).unwrap().data.to_vec();
                let top = stumpff_derivative(k, order, 0.0).abs();
                for (&u, &got) in grid.iter().zip(&value) {
                    let want = stumpff_derivative(k, order, f64::from(u));
                    let off = (f64::from(got) - want).abs() / want.abs().max(top);
                    assert!(off <= 4e-7, "c_{k} derivative {order} at {u}: {got:e} should be {want:e}, off by {off:e}");
                }
                tape.backward(&[(node, &vec![1.0; grid.len()])], &mut []).unwrap();
                for (&u, &got) in grid.iter().zip(tape.gradient(u).unwrap()) {
                    let want = stumpff_derivative(k, order + 1, f64::from(u));
                    let top = stumpff_derivative(k, order + 1, 0.0).abs();
                    let off = (f64::from(got) - want).abs() / want.abs().max(top);
                    assert!(off <= 4e-7, "c_{k} gradient {order} at {u}: {got:e} should be {want:e}, off by {off:e}");
                }
                [node] = tape.jvp([node], &[(u, one)]).unwrap();
            }
        }
    }
}

#[test]
fn all_simd_levels_agree() {
    let program = Program::new(
        &[(7, 5), (7, 1), (5, 37)],
        vec![
            Step::Linear(0, Some(1), 2),
            Step::Unary(Unary::Softplus(0.0), 3),
            Step::Unary(Unary::Logistic, 4),
            Step::Dot(5, 4),
            Step::Sum(6),
        ],
    );
    let leaves: Vec<Vec<f32>> =
        [35, 7, 185].iter().zip(1..).map(|(&len, s)| tape_twin::narrow(&numbers(s, len, -1.0, 1.0))).collect();
    let mut results: Vec<Vec<f32>> = Vec::new();
    for level in float_core::Simd::available() {
        let mut arena = field_core::tape::Arena::with_simd(level);
        let mut tape = field_core::tape::Tape::new(&mut arena, &leaves[0]);
        let w = tape.param(0, 7, 5).unwrap();
        let b = tape.input(7, 1, &leaves[1]).unwrap();
        let x = tape.input(5, 37, &leaves[2]).unwrap();
        let all = program.record(&mut tape, &[w, b, x]).unwrap();
        let mut grad = vec![0.0; 35];
        tape.backward_from(all[all.len() - 1], &mut grad).unwrap();
        grad.extend(tape.gradient(x).unwrap());
        grad.extend(tape.value(all[all.len() - 1]).unwrap().data);
        results.push(grad);
    }
    for other in &results[1..] {
        let want: Vec<f64> = results[0].iter().map(|&x| x.into()).collect();
        // Fused rounding of sums over 37 samples.
        tape_twin::close("level", other, &want, Tolerance { value: 1e-6, ..TIGHT }.value);
    }
}
