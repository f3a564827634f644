//! Networks on the tape against golden vectors: `golden/mlp.json`. Values, gradients, Jacobians, and gradients of a loss on
//! the Jacobian (second order).

use field_core::tape::{Arena, Node, Tape, TapeError};
use testkit::golden::{Golden, Kind, Record, assert_close};

/// Layers of every network of the file.
const LAYERS: usize = 3;

fn golden() -> Golden {
    Golden::read(concat!(env!("CARGO_MANIFEST_DIR"), "/golden/mlp.json").as_ref()).unwrap()
}

fn activate(tape: &mut Tape, name: &str, x: Node) -> Result<Node, TapeError> {
    match name {
        "none" => Ok(x),
        "relu" => tape.relu(x),
        "softplus" => tape.softplus(x, 0.0),
        "sigmoid" => tape.logistic(x),
        "exp" => tape.exp(x),
        "trunc_exp" => tape.trunc_exp(x),
        other => panic!("no activation `{other}`"),
    }
}

/// Rows and columns exchanged: files are batch first, the tape is feature-major.
fn transposed<T: Copy>(data: &[T], rows: usize, cols: usize) -> Vec<T> {
    (0..cols).flat_map(|c| (0..rows).map(move |r| data[r * cols + c])).collect()
}

/// One network of the file.
struct Case<'r> {
    record: &'r Record,
    sizes: Vec<usize>,
    /// Weights and biases of all layers.
    params: Vec<f32>,
}

impl<'r> Case<'r> {
    fn new(record: &'r Record) -> Self {
        assert!(record.f32_inputs_exact, "{}", record.label());
        let mut params = Vec::new();
        for layer in 1..=LAYERS {
            params.extend(record.input(&format!("W{layer}")).f32());
            params.extend(record.input(&format!("b{layer}")).f32());
        }
        let mut sizes: Vec<usize> = (1..=LAYERS).map(|l| record.input(&format!("W{l}")).shape[1]).collect();
        sizes.push(record.input("W3").shape[0]);
        Self { record, sizes, params }
    }

    fn network(&self, tape: &mut Tape, x: Node) -> Result<Node, TapeError> {
        let (mut h, mut at) = (x, 0);
        for (layer, size) in self.sizes.windows(2).enumerate() {
            let w = tape.param(at, size[1], size[0])?;
            let b = tape.param(at + size[0] * size[1], size[1], 1)?;
            at += (size[0] + 1) * size[1];
            h = tape.linear(w, Some(b), h)?;
            let name = if layer + 1 == LAYERS { "output" } else { "hidden" };
            h = activate(tape, self.record.param(name).str(), h)?;
        }
        Ok(h)
    }

    /// Compare every parameter's gradient with a section of the record.
    fn check_params(&self, section: &str, grad: &[f32]) {
        let mut at = 0;
        for layer in 1..=LAYERS {
            for name in [format!("W{layer}"), format!("b{layer}")] {
                let want = self.want(section, &name);
                self.close(section, &name, &grad[at..at + want.len()], want);
                at += want.len();
            }
        }
        assert_eq!(at, grad.len());
    }

    fn want(&self, section: &str, name: &str) -> &'r [f64] {
        let found = self.record.get(section, name);
        &found.unwrap_or_else(|| panic!("{}: no `{name}` among `{section}`", self.record.label())).data
    }

    /// The tolerances of the README.
    fn close(&self, section: &str, name: &str, got: &[f32], want: &[f64]) {
        let what = format!("{}, {section}, {name}", self.record.label());
        let (rtol, atol) = match (self.record.kind, section) {
            (Kind::Random, "outputs") => (2e-6, 1e-6),
            (Kind::Random, _) => (5e-5, 1e-5),
            (_, "outputs") => (1e-4, 0.0),
            (_, _) => (1e-3, 0.0),
        };
        assert_close(&what, got, want, rtol, atol);
    }
}

/// `run(case, samples, tape, x)` for every network, `x` being the record's batch.
fn for_each_case(mut run: impl FnMut(&Case, usize, &mut Tape, Node)) {
    let golden = golden();
    let mut arena = Arena::new();
    let mut cases = 0;
    for record in golden.op("mlp") {
        let case = Case::new(record);
        let (samples, inputs) = (record.input("x").shape[0], case.sizes[0]);
        let mut tape = Tape::new(&mut arena, &case.params);
        let x = tape.input(inputs, samples, &transposed(&record.input("x").f32(), samples, inputs)).unwrap();
        run(&case, samples, &mut tape, x);
        cases += 1;
    }
    assert_eq!(cases, 22);
}

#[test]
fn values_and_gradients_match_golden() {
    for_each_case(|case, samples, tape, x| {
        let (inputs, outputs) = (case.sizes[0], case.sizes[LAYERS]);
        let y = case.network(tape, x).unwrap();
        let got = transposed(tape.value(y).unwrap().data, outputs, samples);
        case.close("outputs", "y", &got, case.want("outputs", "y"));
        let cotangent = transposed(&case.record.cotangent("y").f32(), samples, outputs);
        let mut grad = vec![0.0; case.params.len()];
        tape.backward(&[(y, &cotangent)], &mut grad).unwrap();
        case.check_params("grads", &grad);
        let x_bar = transposed(tape.gradient(x).unwrap(), inputs, samples);
        case.close("grads", "x", &x_bar, case.want("grads", "x"));
    });
}

#[test]
fn jacobians_and_gradients_through_them_match_golden() {
    let mut second_order = 0;
    for_each_case(|case, samples, tape, x| {
        let (inputs, outputs) = (case.sizes[0], case.sizes[LAYERS]);
        // The first row of the batch alone.
        let first: Vec<f32> = tape.value(x).unwrap().data.iter().copied().step_by(samples).collect();
        let x0 = tape.input(inputs, 1, &first).unwrap();
        let y0 = case.network(tape, x0).unwrap();
        let jacobian = tape.jacobian(y0, x0).unwrap();
        let value = tape.value(jacobian).unwrap().data;
        let want = case.want("outputs", "jacobian_x0");
        if case.record.kind == Kind::Random {
            // A derivative: the tolerance of gradients.
            assert_close(&format!("{}, jacobian", case.record.label()), value, want, 5e-5, 1e-5);
        } else {
            assert_close(&format!("{}, jacobian", case.record.label()), value, want, 1e-3, 0.0);
        }
        let Some(cotangent) = case.record.get("jacobian_cotangent", "jacobian_cotangent") else { return };
        second_order += 1;
        assert_eq!(cotangent.shape, [outputs, inputs]);
        let mut grad = vec![0.0; case.params.len()];
        tape.backward(&[(jacobian, &cotangent.f32())], &mut grad).unwrap();
        case.check_params("jacobian_loss_grads", &grad);
        let x_bar = tape.gradient(x0).unwrap();
        case.close("jacobian_loss_grads", "x0", x_bar, case.want("jacobian_loss_grads", "x0"));
    });
    assert_eq!(second_order, 17);
}
