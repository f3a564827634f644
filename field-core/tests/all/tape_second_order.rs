//! Gradients through derivatives of fields: normals and Jacobians.

use crate::tape_twin::{Program, Step, TIGHT, Unary, check, close, differences, narrow, numbers};
use field_core::tape::{Arena, Tape};

const HIDDEN: usize = 12;
const OCTAVES: usize = 3;
const ENCODED: usize = 3 * (1 + 2 * OCTAVES);

/// Frequency-encoded position, softplus network, softplus density: leaves are the parameters, then the position.
fn density(samples: usize) -> Program {
    use Step::*;
    let leaves = [(HIDDEN, ENCODED), (HIDDEN, 1), (HIDDEN, HIDDEN), (HIDDEN, 1), (1, HIDDEN), (1, 1), (3, samples)];
    let mut steps = Vec::new();
    let mut parts = vec![6];
    let mut next = leaves.len();
    let mut push = |step: Step| {
        steps.push(step);
        next += 1;
        next - 1
    };
    for octave in 0..OCTAVES {
        let scaled = push(Unary(self::Unary::Affine(f32::from(1_u8 << octave), 0.0), 6));
        parts.push(push(Unary(self::Unary::Sin, scaled)));
        parts.push(push(Unary(self::Unary::Cos, scaled)));
    }
    let encoded = push(Concat(parts));
    let raw = push(Linear(0, Some(1), encoded));
    let hidden = push(Unary(self::Unary::Softplus(0.0), raw));
    let raw = push(Linear(2, Some(3), hidden));
    let hidden = push(Unary(self::Unary::Softplus(0.0), raw));
    let raw = push(Linear(4, Some(5), hidden));
    push(Unary(self::Unary::Softplus(-1.0), raw));
    Program::new(&leaves, steps)
}

fn draw(program: &Program, seed: u64) -> Vec<Vec<f64>> {
    program.leaves.iter().zip(0..).map(|(s, i)| numbers(seed + i, s.len(), -0.7, 0.7)).collect()
}

#[test]
fn a_density_network_matches_the_twin() {
    let program = density(5);
    check(&program, &draw(&program, 1), &draw(&program, 50), TIGHT);
}

/// `d output / d leaf row` of the twin, one list for each row: dual numbers along each coordinate.
fn twin_jacobian(program: &Program, leaves: &[Vec<f64>], leaf: usize) -> Vec<Vec<f64>> {
    let shape = program.leaves[leaf];
    (0..shape.rows)
        .map(|row| {
            let mut tangents: Vec<Vec<f64>> = leaves.iter().map(|l| vec![0.0; l.len()]).collect();
            tangents[leaf][row * shape.cols..(row + 1) * shape.cols].fill(1.0);
            program.output(leaves, &tangents).1
        })
        .collect()
}

/// Record `program` over one flat parameter vector made of all leaves but the last, which is the input.
fn with_tape(
    program: &Program,
    leaves: &[Vec<f64>],
    f: impl FnOnce(&mut Tape, field_core::tape::Node, field_core::tape::Node, &mut [f32]),
) {
    let (input, weights) = leaves.split_last().unwrap();
    let params = narrow(&weights.concat());
    let mut arena = Arena::new();
    let mut tape = Tape::new(&mut arena, &params);
    let (mut nodes, mut at) = (Vec::new(), 0);
    for shape in &program.leaves[..weights.len()] {
        nodes.push(tape.param(at, shape.rows, shape.cols).unwrap());
        at += shape.len();
    }
    let shape = program.leaves[weights.len()];
    let x = tape.input(shape.rows, shape.cols, &narrow(input)).unwrap();
    nodes.push(x);
    let all = program.record(&mut tape, &nodes).unwrap();
    let mut grad = vec![0.0; params.len()];
    f(&mut tape, x, all[all.len() - 1], &mut grad);
}

#[test]
fn the_gradient_of_a_loss_on_normals_matches_differences() {
    let (samples, program) = (4, density(4));
    let leaves = draw(&program, 7);
    let target = numbers(3, 3 * samples, -1.0, 1.0);
    // sum over samples of |n - target|^2, n = -grad / |grad|: what relighting asks for.
    let loss = |at: &[Vec<f64>]| -> f64 {
        let rows = twin_jacobian(&program, at, 6);
        (0..samples)
            .map(|s| {
                let length = rows.iter().map(|r| r[s] * r[s]).sum::<f64>().sqrt();
                (0..3).map(|i| (-rows[i][s] / length - target[i * samples + s]).powi(2)).sum::<f64>()
            })
            .sum()
    };
    let want = differences(&leaves, &loss);
    with_tape(&program, &leaves, |tape, x, sigma, grad| {
        let slope = tape.jacobian(sigma, x).unwrap();
        let down = tape.neg(slope).unwrap();
        let normal = tape.normalise(down).unwrap();
        let target = tape.constant(3, samples, &narrow(&target)).unwrap();
        let off = tape.sub(normal, target).unwrap();
        let squared = tape.dot(off, off).unwrap();
        let value = tape.sum_samples(squared).unwrap();
        close("loss", tape.value(value).unwrap().data, &[loss(&leaves)], 1e-5);
        tape.backward_from(value, grad).unwrap();
        close("parameters", grad, &want[..6].concat(), 2e-4);
        close("positions", tape.gradient(x).unwrap(), &want[6], 2e-4);
    });
}

#[test]
fn the_gradient_of_a_loss_on_the_jacobian_of_a_deformation_matches_differences() {
    use Step::*;
    let samples = 6;
    // x + w2 tanh(w1 x + b1): a deformation; the loss is |J|^2 - 3 and its square.
    let program = Program::new(
        &[(8, 3), (8, 1), (3, 8), (3, samples)],
        vec![Linear(0, Some(1), 3), Unary(self::Unary::Tanh, 4), Linear(2, None, 5), Add(6, 3)],
    );
    let leaves = draw(&program, 21);
    let loss = |at: &[Vec<f64>]| -> f64 {
        let columns = twin_jacobian(&program, at, 3);
        (0..samples)
            .map(|s| {
                let norm: f64 = columns.iter().map(|c| (0..3).map(|i| c[i * samples + s].powi(2)).sum::<f64>()).sum();
                (norm - 3.0).powi(2)
            })
            .sum::<f64>()
            / samples as f64
    };
    let want = differences(&leaves, &loss);
    with_tape(&program, &leaves, |tape, x, y, grad| {
        let jacobian = tape.jacobian(y, x).unwrap();
        // Rows are (output, input) pairs, outputs first.
        let columns = twin_jacobian(&program, &leaves, 3);
        let expected: Vec<f64> =
            (0..9).flat_map(|k| columns[k % 3][k / 3 * samples..(k / 3 + 1) * samples].to_vec()).collect();
        close("jacobian", tape.value(jacobian).unwrap().data, &expected, 1e-5);
        let norm = tape.dot(jacobian, jacobian).unwrap();
        let off = tape.affine(norm, 1.0, -3.0).unwrap();
        let squared = tape.square(off).unwrap();
        let value = tape.mean_samples(squared).unwrap();
        close("loss", tape.value(value).unwrap().data, &[loss(&leaves)], 1e-5);
        tape.backward_from(value, grad).unwrap();
        close("parameters", grad, &want[..3].concat(), 2e-4);
        close("positions", tape.gradient(x).unwrap(), &want[3], 2e-4);
    });
}

#[test]
fn density_deformed_and_differentiated_follows_the_chain_rule() {
    // d sigma(x')/dx = J^T d sigma/dx', whether the tape differentiates through the deformation or a seed sits at x'.
    let samples = 5;
    let params = narrow(&numbers(5, 200, -0.6, 0.6));
    let mut arena = Arena::new();
    let mut tape = Tape::new(&mut arena, &params);
    let x = tape.input(3, samples, &narrow(&numbers(6, 15, -1.0, 1.0))).unwrap();
    let (w1, w2) = (tape.param(0, 3, 3).unwrap(), tape.param(9, 8, 3).unwrap());
    let w3 = tape.param(40, 1, 8).unwrap();
    let h = tape.linear(w1, None, x).unwrap();
    let h = tape.sin(h).unwrap();
    let moved = tape.add(h, x).unwrap();
    let h = tape.linear(w2, None, moved).unwrap();
    let h = tape.softplus(h, 0.0).unwrap();
    let sigma = tape.linear(w3, None, h).unwrap();
    let whole = tape.jacobian(sigma, x).unwrap();
    let inner_slope = tape.jacobian(sigma, moved).unwrap();
    let jacobian = tape.jacobian(moved, x).unwrap();
    for j in 0..3 {
        // Column j of J against the inner slope.
        let parts: Vec<_> = (0..3).map(|i| tape.slice(jacobian, i * 3 + j..i * 3 + j + 1).unwrap()).collect();
        let column = tape.concat(&parts).unwrap();
        let product = tape.dot(column, inner_slope).unwrap();
        let want: Vec<f64> = tape.value(whole).unwrap().row(j).iter().map(|&x| x.into()).collect();
        close("chain rule", tape.value(product).unwrap().data, &want, 1e-6);
    }
    // Reverse mode gives the same slope.
    tape.backward(&[(sigma, &[1.0; 5])], &mut [0.0; 200]).unwrap();
    let got: Vec<f64> = tape.gradient(x).unwrap().iter().map(|&x| x.into()).collect();
    close("reverse", tape.value(whole).unwrap().data, &got, 1e-6);
}

#[test]
fn tangents_of_tangents_are_second_derivatives() {
    // y = sin(x)^3: y'' and, by reverse mode through it, y'''.
    let x0 = [0.3_f32, 0.9, -1.4];
    let mut arena = Arena::new();
    let mut tape = Tape::new(&mut arena, &[]);
    let x = tape.input(1, 3, &x0).unwrap();
    let one = tape.fill(1, 3, 1.0);
    let sin = tape.sin(x).unwrap();
    let y = tape.pow(sin, 3.0).unwrap();
    let [first] = tape.jvp([y], &[(x, one)]).unwrap();
    let [second] = tape.jvp([first], &[(x, one)]).unwrap();
    tape.backward(&[(second, &[1.0; 3])], &mut []).unwrap();
    let at = |f: &dyn Fn(f64, f64) -> f64| x0.map(|x| f(f64::from(x).sin(), f64::from(x).cos()));
    close("first", tape.value(first).unwrap().data, &at(&|s, c| 3.0 * s * s * c), 1e-5);
    close("second", tape.value(second).unwrap().data, &at(&|s, c| 6.0 * s * c * c - 3.0 * s.powi(3)), 1e-5);
    close("third", tape.gradient(x).unwrap(), &at(&|s, c| 6.0 * c.powi(3) - 21.0 * s * s * c), 1e-5);
}
