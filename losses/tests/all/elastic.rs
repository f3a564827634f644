//! Elastic energy: against its definition, gradients, invariances, and Jacobians that break decompositions.

use losses::LossError;
use losses::elastic::{
    SCALE, elastic, elastic_backward, energy, energy_backward, energy_gradient_of, energy_of, orientation_flips,
};
use proptest::prelude::*;
use testkit::gradient::{PairTolerances, Tolerance, central_difference, check_f32_pair};

type Matrix = [[f64; 3]; 3];

fn product(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

fn transpose(a: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

fn diagonal(d: [f64; 3]) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| if i == j { d[i] } else { 0.0 }))
}

fn inverse(a: &Matrix) -> Matrix {
    let minor = |i: usize, j: usize| {
        let (r, s, c, d) = ((i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3);
        a[r][c] * a[s][d] - a[r][d] * a[s][c]
    };
    let det: f64 = (0..3).map(|j| a[0][j] * minor(0, j)).sum();
    std::array::from_fn(|i| std::array::from_fn(|j| minor(j, i) / det))
}

/// Rotation of a (not normalised) quaternion.
fn rotation(q: [f64; 4]) -> Matrix {
    let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    let [w, x, y, z] = if length > 1e-3 { q.map(|x| x / length) } else { [1.0, 0.0, 0.0, 0.0] };
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// `1/4 |log(J^T J)|^2` by definition: the matrix logarithm by repeated square roots (Denman and Beavers) and a series.
fn naive(j: &Matrix) -> f64 {
    let mut c = product(&transpose(j), j);
    let mut halvings = 0;
    loop {
        let x: Matrix = std::array::from_fn(|i| std::array::from_fn(|k| c[i][k] - f64::from(u8::from(i == k))));
        let size = x.as_flattened().iter().map(|x| x * x).sum::<f64>().sqrt();
        if size < 1e-2 {
            let mut power = x;
            let mut log = [[0.0; 3]; 3];
            for k in 1..12 {
                let factor = if k % 2 == 1 { 1.0 } else { -1.0 } / f64::from(k);
                for (log, power) in log.iter_mut().flatten().zip(power.iter().flatten()) {
                    *log += factor * power;
                }
                power = product(&power, &x);
            }
            let scale = f64::powi(4.0, halvings);
            return 0.25 * scale * log.as_flattened().iter().map(|x| x * x).sum::<f64>();
        }
        let (mut root, mut back) = (c, diagonal([1.0; 3]));
        for _ in 0..12 {
            let (a, b) = (inverse(&root), inverse(&back));
            let next = std::array::from_fn(|i| std::array::from_fn(|k| 0.5 * (root[i][k] + b[i][k])));
            back = std::array::from_fn(|i| std::array::from_fn(|k| 0.5 * (back[i][k] + a[i][k])));
            root = next;
        }
        c = root;
        halvings += 1;
    }
}

fn quaternion() -> impl Strategy<Value = [f64; 4]> {
    prop::array::uniform4(-1.0..1.0)
}

/// Singular values mixing ordinary, equal and nearly equal ones.
fn stretches(low: f64, high: f64) -> impl Strategy<Value = [f64; 3]> {
    let one = move || low..high;
    prop_oneof![
        prop::array::uniform3(one()),
        one().prop_map(|s| [s; 3]),
        (one(), one()).prop_map(|(s, t)| [s, s, t]),
        one().prop_map(|s| [s, s * (1.0 + 1e-9), s * (1.0 - 1e-14)]),
    ]
}

fn matrices(low: f64, high: f64) -> impl Strategy<Value = Matrix> {
    (quaternion(), stretches(low, high), quaternion())
        .prop_map(|(q, s, r)| product(&rotation(q), &product(&diagonal(s), &rotation(r))))
}

fn wide(x: &[f32]) -> Vec<f64> {
    x.iter().map(|&x| f64::from(x)).collect()
}

fn of_slice(j: &[f64]) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|k| j[3 * i + k]))
}

proptest! {
    #![proptest_config(testkit::property::cases(256))]

    #[test]
    fn energy_matches_the_definition(j in matrices(0.2, 5.0)) {
        let (got, want) = (energy_of(&j), naive(&j));
        prop_assert!((got - want).abs() <= 1e-10 * want.max(1e-4), "{got} {want}");
        prop_assert_eq!(energy_gradient_of(&j).0, got);
    }

    #[test]
    fn gradient_matches_central_differences(j in matrices(0.2, 5.0)) {
        let (_, gradient) = energy_gradient_of(&j);
        let want = central_difference(j.as_flattened(), |j| energy_of(&of_slice(j)));
        for (got, want) in gradient.as_flattened().iter().zip(&want) {
            prop_assert!((got - want).abs() < 1e-7, "{gradient:?} {want:?}");
        }
    }

    #[test]
    fn rotations_cost_nothing_and_pull_nowhere(q in quaternion()) {
        let (energy, gradient) = energy_gradient_of(&rotation(q));
        prop_assert!(energy <= 1e-12, "{energy}");
        prop_assert!(gradient.as_flattened().iter().all(|g| g.abs() <= 1e-12), "{gradient:?}");
    }

    #[test]
    fn rotating_before_or_after_changes_nothing(j in matrices(1e-3, 50.0), q in quaternion()) {
        let want = energy_of(&j);
        for turned in [product(&rotation(q), &j), product(&j, &rotation(q))] {
            let got = energy_of(&turned);
            prop_assert!((got - want).abs() <= 1e-9 * want.max(1e-6), "{got} {want}");
        }
    }

    #[test]
    fn stretching_costs_what_squeezing_costs(j in matrices(0.05, 20.0)) {
        let (got, want) = (energy_of(&inverse(&j)), energy_of(&j));
        prop_assert!((got - want).abs() <= 1e-9 * want.max(1e-6), "{got} {want}");
    }

    #[test]
    fn scaling_by_a_factor_costs_three_squared_logarithms(q in quaternion(), s in -12.0_f64..12.0) {
        let scaled = rotation(q).map(|row| row.map(|x| x * s.exp()));
        prop_assert!((energy_of(&scaled) - 3.0 * s * s).abs() <= 1e-12 * (1.0 + s * s));
    }

    #[test]
    fn the_robust_loss_grows_with_the_stretch_up_to_two(s in 0.0_f32..8.0, step in 0.01_f32..2.0) {
        let at = |s: f32| {
            let e = s.exp();
            elastic(&[e, 0.0, 0.0, 0.0, e, 0.0, 0.0, 0.0, e], &[1.0], SCALE).unwrap()
        };
        let (below, above) = (at(s), at(s + step));
        prop_assert!(below < above && above <= 2.0, "{below} {above}");
    }

    #[test]
    fn every_finite_jacobian_gives_finite_numbers(
        j in prop::array::uniform9(prop_oneof![
            Just(0.0_f32), Just(-0.0), Just(1.0), Just(-1.0), Just(1e-45), Just(1e-30), Just(1e-6), Just(1e6), Just(1e30),
            Just(f32::MAX), Just(f32::MIN), -2.0_f32..2.0
        ]),
    ) {
        let (mut e, mut bar) = ([f32::NAN], [0.0; 9]);
        energy(&j, &mut e).unwrap();
        prop_assert!(e[0].is_finite() && e[0] >= 0.0);
        energy_backward(&j, &[1.0], &mut bar).unwrap();
        prop_assert!(bar.iter().all(|x| x.is_finite()), "{bar:?}");
        let loss = elastic_backward(&j, &[1.0], SCALE, 1.0, &mut bar).unwrap();
        prop_assert!((0.0..=2.0).contains(&loss) && bar.iter().all(|x| x.is_finite()));
    }

    #[test]
    fn pairs_match_their_twins(js in prop::collection::vec(matrices(0.3, 3.0), 1..6), c in 0.03_f32..3.0) {
        let n = js.len();
        let j: Vec<f32> = (0..9 * n).map(|i| js[i % n].as_flattened()[i / n] as f32).collect();
        let matrix = |j: &[f64], s: usize| -> Matrix { std::array::from_fn(|i| std::array::from_fn(|k| j[(3 * i + k) * n + s])) };
        let bars: Vec<f32> = (0..n).map(|s| 0.5 + s as f32).collect();
        let spread = |gradients: &[Matrix], bar: &mut [f64]| {
            for (i, bar) in bar.iter_mut().enumerate() {
                *bar += gradients[i % n].as_flattened()[i / n];
            }
        };
        let tolerances = PairTolerances {
            values: Tolerance::new(1e-5, 1e-7), twin: Tolerance::new(1e-5, 1e-5), gradients: Tolerance::new(1e-5, 1e-6)
        };
        // Roots of roots lose digits, and differences of them more: 1e-5.
        // The twin is the definition; its backward takes the gradient checked against differences of the definition here.
        let scaled = |factor: f64, m: Matrix| m.map(|row| row.map(|x| factor * x));
        check_f32_pair(
            &j, &bars,
            (
                |j: &[f32], out: &mut [f32]| energy(j, out).unwrap(),
                |j: &[f32], bar: &[f32], j_bar: &mut [f32]| energy_backward(j, bar, j_bar).unwrap(),
            ),
            (
                |j: &[f64], out: &mut [f64]| (0..n).for_each(|s| out[s] = naive(&matrix(j, s))),
                |j: &[f64], bar: &[f64], j_bar: &mut [f64]| {
                    let all: Vec<Matrix> = (0..n).map(|s| scaled(bar[s], energy_gradient_of(&matrix(j, s)).1)).collect();
                    spread(&all, j_bar);
                },
            ),
            tolerances,
        ).unwrap();
        let c2 = f64::from(c) * f64::from(c);
        let w = &bars;
        check_f32_pair(
            &j, &[1.5],
            (
                |j: &[f32], out: &mut [f32]| out[0] = elastic(j, w, c).unwrap() as f32,
                |j: &[f32], bar: &[f32], j_bar: &mut [f32]| {
                    elastic_backward(j, w, c, bar[0].into(), j_bar).unwrap();
                },
            ),
            (
                |j: &[f64], out: &mut [f64]| {
                    let one = |s: usize| {
                        let z = naive(&matrix(j, s)) / c2;
                        f64::from(w[s]) * 2.0 * z / (z + 4.0)
                    };
                    out[0] = (0..n).map(one).sum();
                },
                |j: &[f64], bar: &[f64], j_bar: &mut [f64]| {
                    let one = |s: usize| {
                        let (energy, gradient) = energy_gradient_of(&matrix(j, s));
                        let z = energy / c2;
                        scaled(bar[0] * f64::from(w[s]) * 8.0 / ((z + 4.0) * (z + 4.0) * c2), gradient)
                    };
                    let all: Vec<Matrix> = (0..n).map(one).collect();
                    spread(&all, j_bar);
                },
            ),
            // Differences of steep robust slopes: c down to 0.03.
            PairTolerances { twin: Tolerance::new(1e-5, 1e-5), ..tolerances },
        ).unwrap();
    }
}

#[test]
fn mirrors_cost_nothing_and_are_counted() {
    let mirror = [-1.0_f32, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    assert_eq!(elastic(&mirror, &[1.0], SCALE).unwrap(), 0.0);
    // Mirror, identity, singular, one with NaN: only the mirror folds space.
    let columns = [mirror, [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], [1.0; 9], [f32::NAN; 9]];
    let j: Vec<f32> = (0..9).flat_map(|r| columns.map(|c| c[r])).collect();
    assert_eq!(orientation_flips(&j).unwrap(), 1);
    assert_eq!(orientation_flips(&[]).unwrap(), 0);
    assert_eq!(orientation_flips(&[0.0; 10]), Err(LossError::Shape { what: "j", want: 9, got: 10 }));
}

#[test]
fn clamped_singular_values_cost_their_clamp_and_pull_nowhere() {
    let at = |s: f64| energy_gradient_of(&diagonal([1.0, 0.5, s]));
    let (energy, gradient) = at(1e-9);
    let want = 0.5_f64.ln().powi(2) + 1e-6_f64.ln().powi(2);
    assert!((energy - want).abs() < 1e-12 * want);
    assert_eq!(gradient[2][2], 0.0);
    assert!(at(1.1e-6).1[2][2] < -1e6, "just above the clamp the pull is back");
    assert_eq!(energy_gradient_of(&[[0.0; 3]; 3]).1, [[0.0; 3]; 3]);
}

#[test]
fn no_samples_weights_of_zero_nan_and_wrong_shapes() {
    assert_eq!(elastic(&[], &[], SCALE).unwrap(), 0.0);
    assert_eq!(elastic_backward(&[], &[], SCALE, 1.0, &mut []).unwrap(), 0.0);
    energy(&[], &mut []).unwrap();
    // A sample of weight 0 is not looked at, whatever it holds; with a weight NaN stays NaN.
    let mut bar = [0.0; 9];
    assert_eq!(elastic_backward(&[f32::NAN; 9], &[0.0], SCALE, 1.0, &mut bar).unwrap(), 0.0);
    assert_eq!(bar, [0.0; 9]);
    assert!(elastic(&[f32::NAN; 9], &[1.0], SCALE).unwrap().is_nan());
    assert!(!energy_of(&[[f64::INFINITY; 3]; 3]).is_finite());
    let shape = |what, want, got| LossError::Shape { what, want, got };
    assert_eq!(energy(&[0.0; 9], &mut [0.0; 2]), Err(shape("j", 18, 9)));
    assert_eq!(elastic(&[0.0; 8], &[0.0], SCALE), Err(shape("j", 9, 8)));
    assert_eq!(elastic_backward(&[0.0; 9], &[0.0], SCALE, 1.0, &mut [0.0; 8]), Err(shape("j_bar", 9, 8)));
    assert_eq!(energy_backward(&[0.0; 9], &[0.0], &mut [0.0; 8]), Err(shape("j_bar", 9, 8)));
    for c in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        assert!(matches!(elastic(&[0.0; 9], &[1.0], c), Err(LossError::Parameter { .. })), "{c}");
    }
}

#[test]
fn f32_rotations_cost_less_than_their_rounding() {
    let j: Vec<f32> = rotation([0.3, -0.5, 0.2, 0.7]).as_flattened().iter().map(|&x| x as f32).collect();
    let mut e = [f32::NAN];
    energy(&j, &mut e).unwrap();
    assert!(e[0] <= 1e-12, "{e:?}");
    assert_eq!(wide(&e).len(), 1);
}
