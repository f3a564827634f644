//! Random expression graphs: value, gradient, tangent and gradient of the tangent against the f64 twin.

use crate::tape_twin::{Program, Step, Tolerance, Unary, check, numbers};
use proptest::prelude::*;

/// Rounding of up to ten chained operations on numbers of order 1.
const CHAINED: Tolerance = Tolerance { value: 1e-5, gradient: 3e-4, second: 1e-3 };

/// Functions whose values and first three derivatives stay of order 1 on bounded arguments.
const SMOOTH: [Unary; 9] = [
    Unary::Affine(0.7, -0.2),
    Unary::Neg,
    Unary::Sin,
    Unary::Cos,
    Unary::Softplus(0.0),
    Unary::Logistic,
    Unary::Tanh,
    Unary::Relu,
    Unary::LeakyRelu(0.3),
];

/// Grow a program from raw choices: every choice picks an operation that fits shapes already there.
fn grow(samples: usize, choices: &[(u8, u8, u8)]) -> Program {
    let mut shapes = vec![(3, 3), (3, 1), (3, samples), (2, samples)];
    let mut steps = Vec::new();
    for &(kind, a, b) in choices {
        let all = shapes.len();
        let wide = |pick: u8| {
            let fitting: Vec<usize> = (2..all).filter(|&i| shapes[i].1 == samples).collect();
            fitting[pick as usize % fitting.len()]
        };
        let like = |node: usize, pick: u8| {
            let fitting: Vec<usize> = (0..all).filter(|&i| shapes[i] == shapes[node]).collect();
            fitting[pick as usize % fitting.len()]
        };
        let x = wide(a);
        let (rows, y) = (shapes[x].0, like(x, b));
        let (step, shape) = match kind % 12 {
            0..=2 => (Step::Unary(SMOOTH[b as usize % SMOOTH.len()], x), shapes[x]),
            3 => (Step::Add(x, y), shapes[x]),
            4 => (Step::Sub(x, y), shapes[x]),
            5 => (Step::Mul(x, y), shapes[x]),
            6 if rows == 3 => (Step::Linear(0, Some(1), x), (3, samples)),
            6 => (Step::SumFeatures(x), (1, samples)),
            7 if rows > 1 => (Step::Slice(x, 1, rows), (rows - 1, samples)),
            7 => (Step::BroadcastFeatures(x, 3), (3, samples)),
            8 => (Step::Dot(x, y), (1, samples)),
            9 if rows + shapes[wide(b)].0 <= 6 => {
                let other = wide(b);
                (Step::Concat(vec![x, other]), (rows + shapes[other].0, samples))
            }
            10 if rows == 1 => {
                let other = wide(b);
                (Step::MulRow(other, x), shapes[other])
            }
            // Keeps numbers bounded.
            _ => (Step::Unary(Unary::Tanh, x), shapes[x]),
        };
        shapes.push(shape);
        steps.push(step);
    }
    let last = shapes.len() - 1;
    steps.push(Step::SumSamples(last));
    Program::new(&[(3, 3), (3, 1), (3, samples), (2, samples)], steps)
}

/// Distance of a number from the kink of a ReLU, below which f32 and f64 may disagree on the side.
const KINK: f64 = 1e-4;

/// Whether no ReLU of the program sits on its kink. An exact zero in both precisions is no disagreement, but sums of
/// rounded numbers rarely cancel exactly.
fn smooth_at(program: &Program, leaves: &[Vec<f64>], tangents: &[Vec<f64>]) -> bool {
    let all = program.twin(leaves, tangents);
    let bounded = all.iter().all(|m| m.data.iter().all(|x| x.v.abs() < 30.0 && x.d.abs() < 300.0));
    let off_kink = program.steps.iter().all(|step| match *step {
        Step::Unary(Unary::Relu | Unary::LeakyRelu(_), x) => all[x].data.iter().all(|x| x.v.abs() > KINK),
        _ => true,
    });
    bounded && off_kink
}

proptest! {
    #![proptest_config(testkit::property::cases_rejecting(96, 208))]

    #[test]
    fn random_graphs_match_the_twin(
        samples in 1_usize..20,
        seed in 0_u64..1 << 32,
        choices in prop::collection::vec(any::<(u8, u8, u8)>(), 1..11),
    ) {
        let program = grow(samples, &choices);
        let draw = |salt: u64| -> Vec<Vec<f64>> {
            program.leaves.iter().zip(0..).map(|(s, i)| numbers(seed + salt + i, s.len(), -1.0, 1.0)).collect()
        };
        let (leaves, tangents) = (draw(0), draw(1 << 40));
        prop_assume!(smooth_at(&program, &leaves, &tangents));
        check(&program, &leaves, &tangents, CHAINED);
    }
}
