//! Errors, empty tiles, shared memory, repeated passes, custom operations.

use crate::tape_twin::{self, close, narrow, numbers};
use field_core::tape::{Arena, BackwardArgs, Bar, CustomOp, Demand, Node, Shape, Tape, TapeError, View};

/// Optical depths along rays of equal length to weights: `w_i = exp(-sum_{j<i} tau_j) (1 - exp(-tau_i))`, with the sums
/// kept for the backward pass. Samples of a ray lie one after another.
struct Weights {
    per_ray: usize,
}

impl CustomOp for Weights {
    fn name(&self) -> &'static str {
        "weights"
    }

    fn shape(&self, inputs: &[Shape]) -> Result<Shape, TapeError> {
        match inputs {
            [tau] if tau.rows == 1 && tau.cols % self.per_ray == 0 => Ok(*tau),
            _ => Err(TapeError::Custom { op: self.name(), reason: "one row of whole rays expected" }),
        }
    }

    fn saved_len(&self, inputs: &[Shape]) -> usize {
        inputs[0].cols
    }

    fn forward(&self, inputs: &[View<'_>], out: &mut [f32], saved: &mut [f32]) -> Result<(), TapeError> {
        let tau = inputs[0].data;
        for ray in 0..tau.len() / self.per_ray {
            let mut sum = 0.0;
            for i in ray * self.per_ray..(ray + 1) * self.per_ray {
                saved[i] = sum;
                out[i] = -(-sum).exp() * (-tau[i]).exp_m1();
                sum += tau[i];
            }
        }
        Ok(())
    }

    fn backward(&self, args: BackwardArgs<'_>, _scratch: &mut [f32], bars: &mut [Bar<'_>]) -> Result<(), TapeError> {
        let BackwardArgs { inputs, out, saved, out_bar } = args;
        let tau = inputs[0].data;
        for ray in 0..tau.len() / self.per_ray {
            let mut behind = 0.0;
            for i in (ray * self.per_ray..(ray + 1) * self.per_ray).rev() {
                bars[0].data[i] += (-saved[i] - tau[i]).exp() * out_bar[i] - behind;
                behind += out[i] * out_bar[i];
            }
        }
        Ok(())
    }
}

#[test]
fn a_custom_pair_composites_along_rays() {
    let (per_ray, rays) = (6, 3);
    let tau = numbers(1, per_ray * rays, 0.0, 1.5);
    let colour = numbers(2, per_ray * rays, 0.0, 1.0);
    let render = |tau: &[f64]| -> f64 {
        let mut total = 0.0;
        for ray in 0..rays {
            let mut trans = 1.0;
            for i in ray * per_ray..(ray + 1) * per_ray {
                total += trans * (1.0 - (-tau[i]).exp()) * colour[i] * colour[i];
                trans *= (-tau[i]).exp();
            }
        }
        total
    };
    let want = tape_twin::differences(std::slice::from_ref(&tau), &|at| render(&at[0]));
    let op = Weights { per_ray };
    let mut arena = Arena::new();
    let mut tape = Tape::new(&mut arena, &[]);
    let x = tape.input(1, tau.len(), &narrow(&tau)).unwrap();
    let w = tape.custom(&op, &[x]).unwrap();
    let c = tape.constant(1, tau.len(), &narrow(&colour)).unwrap();
    let c2 = tape.square(c).unwrap();
    let loss = tape.weighted_sum(c2, w).unwrap();
    close("rendered", tape.value(loss).unwrap().data, &[render(&tau)], 1e-6);
    tape.backward_from(loss, &mut []).unwrap();
    close("gradient", tape.gradient(x).unwrap(), &want[0], 1e-5);

    // No tangent rule: refused by name. Elsewhere the tape goes on.
    let one = tape.fill(1, tau.len(), 1.0);
    assert_eq!(tape.jvp([loss], &[(x, one)]), Err(TapeError::NoTangent { op: "weights" }));
    let [still] = tape.jvp([loss], &[(c, one)]).unwrap();
    assert!(tape.value(still).unwrap().data[0] > 0.0);
    let ragged = tape.fill(1, 7, 0.0);
    assert!(matches!(tape.custom(&op, &[ragged]), Err(TapeError::Custom { op: "weights", .. })));
}

/// `a * b + c`, with scratch, a tangent rule, and a look at what it is asked for.
struct MulAdd {
    demands: std::sync::Mutex<Vec<Demand>>,
}

impl CustomOp for MulAdd {
    fn name(&self) -> &'static str {
        "mul_add"
    }

    fn shape(&self, inputs: &[Shape]) -> Result<Shape, TapeError> {
        Ok(inputs[0])
    }

    fn scratch_len(&self, inputs: &[Shape]) -> usize {
        inputs[0].len()
    }

    fn forward(&self, inputs: &[View<'_>], out: &mut [f32], _saved: &mut [f32]) -> Result<(), TapeError> {
        assert!(out.iter().all(|&x| x == 0.0), "out starts as zeros");
        for (i, out) in out.iter_mut().enumerate() {
            *out = inputs[0].data[i] * inputs[1].data[i] + inputs[2].data[i];
        }
        Ok(())
    }

    fn backward(&self, args: BackwardArgs<'_>, scratch: &mut [f32], bars: &mut [Bar<'_>]) -> Result<(), TapeError> {
        let BackwardArgs { inputs, out_bar, .. } = args;
        scratch.copy_from_slice(out_bar);
        for (i, g) in scratch.iter().enumerate() {
            bars[0].data[i] += g * inputs[1].data[i];
            bars[1].data[i] += g * inputs[0].data[i];
            bars[2].data[i] += g;
        }
        *self.demands.lock().unwrap() = bars.iter().map(|bar| bar.demand).collect();
        Ok(())
    }

    fn tangent<'a>(
        &'a self,
        tape: &mut Tape<'a>,
        inputs: &[Node],
        input_tangents: &[Option<Node>],
        output: Node,
    ) -> Result<Node, TapeError> {
        let shape = tape.shape(output)?;
        let zero = tape.fill(shape.rows, shape.cols, 0.0);
        let dot = |i: usize| input_tangents[i].unwrap_or(zero);
        // a_dot b + (a b_dot + c_dot), by itself.
        let inner = tape.custom(self, &[inputs[0], dot(1), dot(2)])?;
        tape.custom(self, &[dot(0), inputs[1], inner])
    }
}

#[test]
fn a_custom_operation_may_get_one_node_twice_and_slices_of_one_node() {
    let op = MulAdd { demands: Default::default() };
    let mut arena = Arena::new();
    let params = [0.5_f32, -2.0, 3.0, 1.5];
    let mut tape = Tape::new(&mut arena, &params);
    let p = tape.param(0, 2, 2).unwrap();
    let top = tape.slice(p, 0..1).unwrap();
    let x = tape.input(1, 2, &[4.0, 5.0]).unwrap();
    let k = tape.constant(1, 2, &[0.1, 0.2]).unwrap();
    let mut grad = [0.0; 4];
    // x * x + p[0]: x' = 2 x, p' = 1.
    let y = tape.custom(&op, &[x, x, top]).unwrap();
    tape.backward(&[(y, &[1.0, 1.0])], &mut grad).unwrap();
    assert_eq!(tape.gradient(x).unwrap(), [8.0, 10.0]);
    assert_eq!(grad, [1.0, 1.0, 0.0, 0.0]);
    // Overlapping slices of a parameter, and a constant nobody asks for.
    let grad = &mut [0.0; 4];
    let y = tape.custom(&op, &[top, k, top]).unwrap();
    tape.backward(&[(y, &[1.0, 1.0])], grad).unwrap();
    assert_eq!(*grad, [1.1, 1.2, 0.0, 0.0]);
    assert_eq!(*op.demands.lock().unwrap(), [Demand::Wanted, Demand::Ignored, Demand::Wanted]);
    // Its tangent, made of itself, and reverse mode through that: d/dx of (2 x x_dot) is 2 x_dot.
    let y = tape.custom(&op, &[x, x, top]).unwrap();
    let x_dot = tape.constant(1, 2, &[1.0, 10.0]).unwrap();
    let [y_dot] = tape.jvp([y], &[(x, x_dot)]).unwrap();
    assert_eq!(tape.value(y_dot).unwrap().data, [8.0, 100.0]);
    tape.backward(&[(y_dot, &[1.0, 1.0])], grad).unwrap();
    assert_eq!(tape.gradient(x).unwrap(), [2.0, 20.0]);
}

#[test]
fn wrong_shapes_are_named() {
    let params = [0.0; 10];
    let mut arena = Arena::new();
    let mut tape = Tape::new(&mut arena, &params);
    let x = tape.input(3, 4, &[1.0; 12]).unwrap();
    let row = tape.fill(1, 4, 2.0);
    let w = tape.param(0, 2, 5).unwrap();
    let before = tape.len();
    let shape = |op, what, want: (usize, usize), got: (usize, usize)| {
        Err(TapeError::Shape { op, what, want: Shape::new(want.0, want.1), got: Shape::new(got.0, got.1) })
    };
    assert_eq!(tape.add(x, row), shape("add", "b", (3, 4), (1, 4)));
    assert_eq!(tape.linear(w, None, x), shape("linear", "x", (5, 4), (3, 4)));
    let five = tape.fill(5, 4, 0.0);
    assert_eq!(tape.linear(w, Some(row), five), shape("linear", "b", (2, 1), (1, 4)));
    assert_eq!(tape.mul_row(x, x), shape("mul_row", "w", (1, 4), (3, 4)));
    assert_eq!(tape.concat(&[x, w]), shape("concat", "parts", (2, 4), (2, 5)));
    assert_eq!(tape.broadcast_features(x, 2), shape("broadcast_features", "x", (1, 4), (3, 4)));
    assert_eq!(tape.broadcast_samples(x, 2), shape("broadcast_samples", "x", (3, 1), (3, 4)));
    assert_eq!(tape.dot(x, row), shape("dot", "b", (3, 4), (1, 4)));
    assert_eq!(tape.mat_vec(five, x), shape("mat_vec", "m", (3, 4), (5, 4)));
    assert_eq!(tape.jvp([x], &[(x, row)]), shape("jvp", "seed", (3, 4), (1, 4)).map(|n: Node| [n]));
    assert_eq!(tape.slice(x, 2..4), Err(TapeError::Rows { start: 2, end: 4, rows: 3 }));
    #[expect(clippy::reversed_empty_ranges, reason = "refused")]
    let reversed = tape.slice(x, 2..1);
    assert_eq!(reversed, Err(TapeError::Rows { start: 2, end: 1, rows: 3 }));
    assert_eq!(tape.unit_row(3, 4, 3), Err(TapeError::Rows { start: 3, end: 4, rows: 3 }));
    assert_eq!(tape.param(4, 7, 1), Err(TapeError::Parameters { start: 4, len: 7, available: 10 }));
    assert!(tape.param(0, usize::MAX, 2).is_err());
    assert_eq!(tape.concat(&[]), Err(TapeError::Length { op: "concat", what: "parts", want: 1, got: 0 }));
    assert_eq!(tape.input(2, 2, &[0.0; 3]), Err(TapeError::Length { op: "input", what: "data", want: 4, got: 3 }));
    assert_eq!(tape.custom(&Weights { per_ray: 1 }, &[]), Err(TapeError::Inputs { op: "weights", got: 0 }));
    assert_eq!(
        tape.backward(&[(x, &[1.0])], &mut [0.0; 10]),
        Err(TapeError::Length { op: "backward", what: "seed", want: 12, got: 1 })
    );
    assert_eq!(
        tape.backward(&[], &mut [0.0; 9]),
        Err(TapeError::Length { op: "backward", what: "grad", want: 10, got: 9 })
    );
    // Only `five` was recorded meanwhile.
    assert_eq!(tape.len(), before + 1);
    assert_eq!(tape.add(x, row).unwrap_err().to_string(), "add: `b` is [1 x 4], expected [3 x 4]");
    assert_eq!(tape.param(4, 7, 1).unwrap_err().to_string(), "parameter: 7 values from 4, but there are only 10");
}

#[test]
fn nodes_of_an_earlier_tile_are_refused() {
    let mut arena = Arena::new();
    let old = {
        let mut tape = Tape::new(&mut arena, &[]);
        tape.fill(1, 1, 1.0)
    };
    let mut tape = Tape::new(&mut arena, &[]);
    let new = tape.fill(1, 1, 1.0);
    assert_eq!(tape.add(new, old), Err(TapeError::ForeignNode { op: "add" }));
    assert_eq!(tape.value(old), Err(TapeError::ForeignNode { op: "value" }));
    assert_eq!(tape.backward(&[(old, &[1.0])], &mut []), Err(TapeError::ForeignNode { op: "backward" }));
}

#[test]
fn gradients_exist_for_inputs_and_for_what_the_loss_depends_on() {
    let mut arena = Arena::new();
    let mut tape = Tape::new(&mut arena, &[1.0]);
    let x = tape.input(1, 2, &[1.0, 2.0]).unwrap();
    let ignored = tape.input(1, 2, &[1.0, 2.0]).unwrap();
    let p = tape.param(0, 1, 1).unwrap();
    let k = tape.fill(1, 2, 3.0);
    let y = tape.mul(x, k).unwrap();
    let aside = tape.square(x).unwrap();
    let stopped = tape.detach(y).unwrap();
    let z = tape.mul(y, stopped).unwrap();
    tape.backward(&[(z, &[1.0, 1.0])], &mut [0.0]).unwrap();
    // z = y * const(y), y = 3 x: dz/dx = 3 * 3 x.
    assert_eq!(tape.gradient(x).unwrap(), [9.0, 18.0]);
    assert_eq!(tape.gradient(y).unwrap(), [3.0, 6.0]);
    assert_eq!(tape.gradient(ignored).unwrap(), [0.0, 0.0]);
    for none in [p, k, aside, stopped] {
        assert_eq!(tape.gradient(none), Err(TapeError::NoGradient));
    }
    // Tangents stop there too.
    let one = tape.fill(1, 2, 1.0);
    let [z_dot] = tape.jvp([z], &[(x, one)]).unwrap();
    assert_eq!(tape.value(z_dot).unwrap().data, [9.0, 18.0]);
    let [none] = tape.jvp([stopped], &[(x, one)]).unwrap();
    assert_eq!(tape.value(none).unwrap().data, [0.0, 0.0]);
}

#[test]
fn slices_share_values_and_gradients_with_the_whole() {
    let mut arena = Arena::new();
    let mut tape = Tape::new(&mut arena, &[]);
    let x = tape.input(4, 2, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]).unwrap();
    let middle = tape.slice(x, 1..3).unwrap();
    let inner = tape.slice(middle, 1..2).unwrap();
    assert_eq!(tape.value(inner).unwrap().data, [5.0, 6.0]);
    assert_eq!(tape.value(middle).unwrap().row(0), [3.0, 4.0]);
    tape.backward(&[(inner, &[1.0, 1.0]), (middle, &[10.0; 4]), (x, &[100.0; 8])], &mut []).unwrap();
    assert_eq!(tape.gradient(x).unwrap(), [100.0, 100.0, 110.0, 110.0, 111.0, 111.0, 100.0, 100.0]);
    assert_eq!(tape.gradient(inner).unwrap(), [111.0, 111.0]);
    // A tangent passes through a slice of a slice.
    let seed = tape.constant(4, 2, &[1.0, 1.0, 2.0, 2.0, 3.0, 4.0, 5.0, 5.0]).unwrap();
    let [dot] = tape.jvp([inner], &[(x, seed)]).unwrap();
    assert_eq!(tape.value(dot).unwrap().data, [3.0, 4.0]);
    let nothing = tape.slice(x, 2..2).unwrap();
    assert!(tape.value(nothing).unwrap().data.is_empty());
}

#[test]
fn backward_adds_to_the_gradient_and_may_be_repeated() {
    let params = [2.0, 3.0];
    let mut arena = Arena::new();
    let mut tape = Tape::new(&mut arena, &params);
    let w = tape.param(0, 1, 2).unwrap();
    let x = tape.input(2, 1, &[5.0, 7.0]).unwrap();
    let y = tape.linear(w, None, x).unwrap();
    let mut grad = [1.0, 1.0];
    tape.backward_from(y, &mut grad).unwrap();
    assert_eq!(grad, [6.0, 8.0]);
    tape.backward(&[(y, &[2.0])], &mut grad).unwrap();
    assert_eq!(grad, [16.0, 22.0]);
    assert_eq!(tape.gradient(x).unwrap(), [4.0, 6.0]);
    // A parameter can itself be a seed.
    tape.backward(&[(w, &[1.0, 1.0])], &mut grad).unwrap();
    assert_eq!(grad, [17.0, 23.0]);
    assert_eq!(tape.gradient(x).unwrap(), [0.0, 0.0]);
}

#[test]
fn empty_tiles_go_all_the_way() {
    let params = [1.0_f32; 12];
    let op = Weights { per_ray: 4 };
    let mut arena = Arena::new();
    let mut tape = Tape::new(&mut arena, &params);
    let x = tape.input(3, 0, &[]).unwrap();
    let (w, b) = (tape.param(0, 3, 3).unwrap(), tape.param(9, 3, 1).unwrap());
    let h = tape.linear(w, Some(b), x).unwrap();
    let h = tape.relu(h).unwrap();
    let n = tape.normalise(h).unwrap();
    let both = tape.concat(&[n, h, x]).unwrap();
    let m = tape.mat_vec(both, x).unwrap();
    let weights = tape.sum_features(m).unwrap();
    let weights = tape.custom(&op, &[weights]).unwrap();
    let spread = tape.broadcast_features(weights, 3).unwrap();
    let y = tape.mul(spread, x).unwrap();
    let y = tape.mul_row(y, weights).unwrap();
    let slope = tape.jacobian(h, x).unwrap();
    assert_eq!(tape.shape(slope).unwrap(), Shape::new(9, 0));
    let total = tape.dot(y, y).unwrap();
    let total = tape.mean_samples(total).unwrap();
    assert_eq!(tape.value(total).unwrap().data, [0.0]);
    let mut grad = [0.5; 12];
    tape.backward_from(total, &mut grad).unwrap();
    assert_eq!(grad, [0.5; 12]);
    assert!(tape.gradient(x).unwrap().is_empty());
    let code = tape.broadcast_samples(b, 0).unwrap();
    assert_eq!(tape.shape(code).unwrap(), Shape::new(3, 0));
    tape.backward(&[(code, &[])], &mut grad).unwrap();
    assert_eq!(grad, [0.5; 12]);

    // No row is legal as well.
    let none = tape.input(0, 5, &[]).unwrap();
    let sum = tape.sum_features(none).unwrap();
    assert_eq!(tape.value(sum).unwrap().data, [0.0; 5]);
    tape.backward(&[(sum, &[1.0; 5])], &mut grad).unwrap();
}

#[test]
fn the_same_tile_gives_the_same_bits() {
    let params = narrow(&numbers(1, 400, -0.5, 0.5));
    let x = narrow(&numbers(2, 3 * 77, -1.0, 1.0));
    let mut arena = Arena::new();
    let mut run = |samples: usize| {
        let mut tape = Tape::new(&mut arena, &params);
        let data: Vec<f32> = (0..3).flat_map(|r| x[r * 77..r * 77 + samples].to_vec()).collect();
        let node = tape.input(3, samples, &data).unwrap();
        let (w, v) = (tape.param(0, 16, 3).unwrap(), tape.param(48, 1, 16).unwrap());
        let h = tape.linear(w, None, node).unwrap();
        let h = tape.softplus(h, 0.0).unwrap();
        let y = tape.linear(v, None, h).unwrap();
        let slope = tape.jacobian(y, node).unwrap();
        let loss = tape.dot(slope, slope).unwrap();
        let loss = tape.mean_samples(loss).unwrap();
        let mut grad = vec![0.0; 400];
        tape.backward_from(loss, &mut grad).unwrap();
        grad.iter().map(|g| g.to_bits()).collect::<Vec<_>>()
    };
    let first = run(77);
    // A smaller tile in between leaves old numbers behind.
    let _ = run(13);
    assert_eq!(run(77), first);
}
