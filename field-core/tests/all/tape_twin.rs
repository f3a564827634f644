//! The specification of the tape: every operation in `f64`, slow and obvious, over plain and over dual numbers; and the
//! check that compares a tape with it: values, gradients, tangents, and gradients through tangents.

use field_core::tape::{Arena, Node, Shape, Tape, TapeError};

/// A number with a derivative along one direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Dual {
    pub(crate) v: f64,
    pub(crate) d: f64,
}

impl Dual {
    pub(crate) const ZERO: Self = Self { v: 0.0, d: 0.0 };

    fn add(self, b: Self) -> Self {
        Self { v: self.v + b.v, d: self.d + b.d }
    }

    fn mul(self, b: Self) -> Self {
        Self { v: self.v * b.v, d: self.d * b.v + self.v * b.d }
    }
}

/// `[rows][cols]`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Matrix {
    pub(crate) rows: usize,
    pub(crate) cols: usize,
    pub(crate) data: Vec<Dual>,
}

impl Matrix {
    pub(crate) fn new(rows: usize, cols: usize, values: &[f64]) -> Self {
        assert_eq!(values.len(), rows * cols);
        Self { rows, cols, data: values.iter().map(|&v| Dual { v, d: 0.0 }).collect() }
    }

    fn from_fn(rows: usize, cols: usize, f: impl Fn(usize, usize) -> Dual) -> Self {
        let data = (0..rows).flat_map(|r| (0..cols).map(move |c| (r, c))).map(|(r, c)| f(r, c)).collect();
        Self { rows, cols, data }
    }

    fn at(&self, r: usize, c: usize) -> Dual {
        self.data[r * self.cols + c]
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Unary {
    Affine(f32, f32),
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
    Max0,
    LeakyRelu(f32),
    Softplus(f32),
    Logistic,
    LogisticDerivative,
    Tanh,
    Abs,
    Pow(f32),
    Clamp(f32, f32),
    Sign,
    Inside(f32, f32),
    Stumpff(u32),
}

impl Unary {
    /// Value and derivative.
    pub(crate) fn twin(self, x: f64) -> (f64, f64) {
        let logistic = |x: f64| 1.0 / (1.0 + (-x).exp());
        let slope = |x: f64| logistic(x) * logistic(-x);
        let inside = |low: f32, high: f32| x >= f64::from(low) && x <= f64::from(high);
        match self {
            Self::Affine(a, b) => (f64::from(a) * x + f64::from(b), f64::from(a)),
            Self::Neg => (-x, -1.0),
            Self::Square => (x * x, 2.0 * x),
            Self::Sqrt => (x.sqrt(), if x > 0.0 { 0.5 / x.sqrt() } else { 0.0 }),
            Self::Rsqrt if x <= 0.0 => (0.0, 0.0),
            Self::Rsqrt => (1.0 / x.sqrt(), -0.5 / (x * x.sqrt())),
            Self::Recip => (1.0 / x, -1.0 / (x * x)),
            Self::Exp => (x.exp(), x.exp()),
            Self::TruncExp => (x.exp(), x.clamp(-15.0, 15.0).exp()),
            Self::Log => (x.ln(), 1.0 / x),
            Self::Sin => (x.sin(), x.cos()),
            Self::Cos => (x.cos(), -x.sin()),
            Self::Relu | Self::Max0 => (x.max(0.0), f64::from(u8::from(x > 0.0))),
            Self::LeakyRelu(a) if x <= 0.0 => (f64::from(a) * x, f64::from(a)),
            Self::LeakyRelu(_) => (x, 1.0),
            Self::Softplus(shift) => {
                let x = x + f64::from(shift);
                (x.max(0.0) + (-x.abs()).exp().ln_1p(), logistic(x))
            }
            Self::Logistic => (logistic(x), slope(x)),
            Self::LogisticDerivative => (slope(x), slope(x) * (1.0 - 2.0 * logistic(x))),
            Self::Tanh => (x.tanh(), 1.0 / x.cosh().powi(2)),
            Self::Abs => (x.abs(), if x == 0.0 { 0.0 } else { x.signum() }),
            Self::Pow(p) => {
                (x.powf(f64::from(p)), if p == 0.0 { 0.0 } else { f64::from(p) * x.powf(f64::from(p) - 1.0) })
            }
            Self::Clamp(low, high) => (x.clamp(low.into(), high.into()), f64::from(u8::from(inside(low, high)))),
            Self::Sign => (if x == 0.0 { 0.0 } else { x.signum() }, 0.0),
            Self::Inside(low, high) => (f64::from(u8::from(inside(low, high))), 0.0),
            Self::Stumpff(k) => {
                // By definition, term by term: (-x)^j / (k + 2 j)!.
                let mut term = 1.0 / (1..=k).map(f64::from).product::<f64>();
                let (mut value, mut slope) = (term, 0.0);
                for j in 1..60 {
                    let n = f64::from(k + 2 * j);
                    slope -= term * f64::from(j) / (n * (n - 1.0));
                    term *= -x / (n * (n - 1.0));
                    value += term;
                }
                (value, slope)
            }
        }
    }

    pub(crate) fn tape(self, tape: &mut Tape, x: Node) -> Result<Node, TapeError> {
        match self {
            Self::Affine(a, 0.0) => tape.scale(x, a),
            Self::Affine(a, b) => tape.affine(x, a, b),
            Self::Neg => tape.neg(x),
            Self::Square => tape.square(x),
            Self::Sqrt => tape.sqrt(x),
            Self::Rsqrt => tape.rsqrt(x),
            Self::Recip => tape.recip(x),
            Self::Exp => tape.exp(x),
            Self::TruncExp => tape.trunc_exp(x),
            Self::Log => tape.log(x),
            Self::Sin => tape.sin(x),
            Self::Cos => tape.cos(x),
            Self::Relu => tape.relu(x),
            Self::Max0 => tape.max0(x),
            Self::LeakyRelu(a) => tape.leaky_relu(x, a),
            Self::Softplus(shift) => tape.softplus(x, shift),
            Self::Logistic => tape.logistic(x),
            Self::LogisticDerivative => tape.logistic_derivative(x),
            Self::Tanh => tape.tanh(x),
            Self::Abs => tape.abs(x),
            Self::Pow(p) => tape.pow(x, p),
            Self::Clamp(low, high) => tape.clamp(x, low, high),
            Self::Sign => tape.sign(x),
            Self::Inside(low, high) => tape.inside(x, low, high),
            Self::Stumpff(k) => tape.stumpff(x, k),
        }
    }
}

/// One operation on earlier results, by index: leaves first, then steps.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Step {
    Unary(Unary, usize),
    Add(usize, usize),
    Sub(usize, usize),
    Mul(usize, usize),
    Div(usize, usize),
    Gate(usize, usize, f32),
    MulRow(usize, usize),
    Linear(usize, Option<usize>, usize),
    Concat(Vec<usize>),
    Slice(usize, usize, usize),
    BroadcastFeatures(usize, usize),
    BroadcastSamples(usize, usize),
    SumFeatures(usize),
    SumSamples(usize),
    MeanSamples(usize),
    WeightedSum(usize, usize),
    Sum(usize),
    Dot(usize, usize),
    Cross(usize, usize),
    Normalise(usize),
    MatVec(usize, usize),
}

impl Step {
    pub(crate) fn twin(&self, m: &[Matrix]) -> Matrix {
        let zip = |a: usize, b: usize, f: &dyn Fn(Dual, Dual) -> Dual| {
            Matrix::from_fn(m[a].rows, m[a].cols, |r, c| f(m[a].at(r, c), m[b].at(r, c)))
        };
        let unary = |f: Unary, x: Dual| {
            let (v, d) = f.twin(x.v);
            Dual { v, d: d * x.d }
        };
        let total = |items: &mut dyn Iterator<Item = Dual>| items.fold(Dual::ZERO, Dual::add);
        let number = |v: f64| Dual { v, d: 0.0 };
        match *self {
            Self::Unary(f, x) => Matrix::from_fn(m[x].rows, m[x].cols, |r, c| unary(f, m[x].at(r, c))),
            Self::Add(a, b) => zip(a, b, &Dual::add),
            Self::Sub(a, b) => zip(a, b, &|a, b| a.add(b.mul(number(-1.0)))),
            Self::Mul(a, b) => zip(a, b, &Dual::mul),
            Self::Div(a, b) => zip(a, b, &|a, b| a.mul(unary(Unary::Recip, b))),
            Self::Gate(a, b, slope) => zip(a, b, &|a, b| if a.v > 0.0 { b } else { b.mul(number(f64::from(slope))) }),
            Self::MulRow(x, w) => Matrix::from_fn(m[x].rows, m[x].cols, |r, c| m[x].at(r, c).mul(m[w].at(0, c))),
            Self::Linear(w, b, x) => Matrix::from_fn(m[w].rows, m[x].cols, |r, c| {
                let bias = b.map_or(Dual::ZERO, |b| m[b].at(r, 0));
                total(&mut (0..m[x].rows).map(|i| m[w].at(r, i).mul(m[x].at(i, c)))).add(bias)
            }),
            Self::Concat(ref parts) => Matrix {
                rows: parts.iter().map(|&p| m[p].rows).sum(),
                cols: m[parts[0]].cols,
                data: parts.iter().flat_map(|&p| m[p].data.clone()).collect(),
            },
            Self::Slice(x, start, end) => Matrix::from_fn(end - start, m[x].cols, |r, c| m[x].at(start + r, c)),
            Self::BroadcastFeatures(x, rows) => Matrix::from_fn(rows, m[x].cols, |_, c| m[x].at(0, c)),
            Self::BroadcastSamples(x, cols) => Matrix::from_fn(m[x].rows, cols, |r, _| m[x].at(r, 0)),
            Self::SumFeatures(x) => {
                Matrix::from_fn(1, m[x].cols, |_, c| total(&mut (0..m[x].rows).map(|r| m[x].at(r, c))))
            }
            Self::SumSamples(x) => {
                Matrix::from_fn(m[x].rows, 1, |r, _| total(&mut (0..m[x].cols).map(|c| m[x].at(r, c))))
            }
            Self::MeanSamples(x) => Matrix::from_fn(m[x].rows, 1, |r, _| {
                total(&mut (0..m[x].cols).map(|c| m[x].at(r, c))).mul(number(1.0 / m[x].cols.max(1) as f64))
            }),
            Self::WeightedSum(x, w) => Matrix::from_fn(m[x].rows, 1, |r, _| {
                total(&mut (0..m[x].cols).map(|c| m[x].at(r, c).mul(m[w].at(0, c))))
            }),
            Self::Sum(x) => Matrix::from_fn(1, 1, |_, _| total(&mut m[x].data.iter().copied())),
            Self::Dot(a, b) => Matrix::from_fn(1, m[a].cols, |_, c| {
                total(&mut (0..m[a].rows).map(|r| m[a].at(r, c).mul(m[b].at(r, c))))
            }),
            Self::Cross(a, b) => Matrix::from_fn(3, m[a].cols, |r, c| {
                let product = |i: usize, j: usize| m[a].at(i % 3, c).mul(m[b].at(j % 3, c));
                product(r + 1, r + 2).add(product(r + 2, r + 1).mul(number(-1.0)))
            }),
            Self::Normalise(x) => Matrix::from_fn(m[x].rows, m[x].cols, |r, c| {
                let squared = total(&mut (0..m[x].rows).map(|r| m[x].at(r, c).mul(m[x].at(r, c))));
                m[x].at(r, c).mul(unary(Unary::Rsqrt, squared))
            }),
            Self::MatVec(a, v) => Matrix::from_fn(m[a].rows / m[v].rows, m[v].cols, |r, c| {
                total(&mut (0..m[v].rows).map(|i| m[a].at(r * m[v].rows + i, c).mul(m[v].at(i, c))))
            }),
        }
    }

    pub(crate) fn tape(&self, tape: &mut Tape, n: &[Node]) -> Result<Node, TapeError> {
        match *self {
            Self::Unary(f, x) => f.tape(tape, n[x]),
            Self::Add(a, b) => tape.add(n[a], n[b]),
            Self::Sub(a, b) => tape.sub(n[a], n[b]),
            Self::Mul(a, b) => tape.mul(n[a], n[b]),
            Self::Div(a, b) => tape.div(n[a], n[b]),
            Self::Gate(a, b, slope) => tape.gate(n[a], n[b], slope),
            Self::MulRow(x, w) => tape.mul_row(n[x], n[w]),
            Self::Linear(w, b, x) => tape.linear(n[w], b.map(|b| n[b]), n[x]),
            Self::Concat(ref parts) => tape.concat(&parts.iter().map(|&p| n[p]).collect::<Vec<_>>()),
            Self::Slice(x, start, end) => tape.slice(n[x], start..end),
            Self::BroadcastFeatures(x, rows) => tape.broadcast_features(n[x], rows),
            Self::BroadcastSamples(x, cols) => tape.broadcast_samples(n[x], cols),
            Self::SumFeatures(x) => tape.sum_features(n[x]),
            Self::SumSamples(x) => tape.sum_samples(n[x]),
            Self::MeanSamples(x) => tape.mean_samples(n[x]),
            Self::WeightedSum(x, w) => tape.weighted_sum(n[x], n[w]),
            Self::Sum(x) => tape.sum(n[x]),
            Self::Dot(a, b) => tape.dot(n[a], n[b]),
            Self::Cross(a, b) => tape.cross(n[a], n[b]),
            Self::Normalise(x) => tape.normalise(n[x]),
            Self::MatVec(m, v) => tape.mat_vec(n[m], n[v]),
        }
    }
}

/// Leaves and the steps over them; the last step is the output.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Program {
    /// Shapes.
    pub(crate) leaves: Vec<Shape>,
    pub(crate) steps: Vec<Step>,
}

/// What a comparison may miss, as a share of the largest number of the tensor (at least 1).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tolerance {
    pub(crate) value: f64,
    pub(crate) gradient: f64,
    pub(crate) second: f64,
}

/// f32 rounding of values near 1, and of a handful of them multiplied.
pub(crate) const TIGHT: Tolerance = Tolerance { value: 2e-6, gradient: 1e-4, second: 2e-4 };

impl Program {
    pub(crate) fn new(leaves: &[(usize, usize)], steps: Vec<Step>) -> Self {
        Self { leaves: leaves.iter().map(|&(rows, cols)| Shape::new(rows, cols)).collect(), steps }
    }

    /// All results, leaves first.
    pub(crate) fn twin(&self, leaves: &[Vec<f64>], tangents: &[Vec<f64>]) -> Vec<Matrix> {
        let mut all: Vec<Matrix> = Vec::new();
        for ((shape, values), tangent) in self.leaves.iter().zip(leaves).zip(tangents) {
            let mut matrix = Matrix::new(shape.rows, shape.cols, values);
            matrix.data.iter_mut().zip(tangent).for_each(|(x, &d)| x.d = d);
            all.push(matrix);
        }
        for step in &self.steps {
            let next = step.twin(&all);
            all.push(next);
        }
        all
    }

    /// Output value and tangent.
    pub(crate) fn output(&self, leaves: &[Vec<f64>], tangents: &[Vec<f64>]) -> (Vec<f64>, Vec<f64>) {
        let all = self.twin(leaves, tangents);
        let out = &all[all.len() - 1];
        (out.data.iter().map(|x| x.v).collect(), out.data.iter().map(|x| x.d).collect())
    }

    pub(crate) fn record(&self, tape: &mut Tape, leaves: &[Node]) -> Result<Vec<Node>, TapeError> {
        let mut all = leaves.to_vec();
        for step in &self.steps {
            let next = step.tape(tape, &all)?;
            all.push(next);
        }
        Ok(all)
    }
}

/// Central difference of a sum over outputs with respect to every number of every leaf.
pub(crate) fn differences(leaves: &[Vec<f64>], f: &dyn Fn(&[Vec<f64>]) -> f64) -> Vec<Vec<f64>> {
    let mut at = leaves.to_vec();
    let mut out = Vec::new();
    for l in 0..leaves.len() {
        let mut bar = Vec::new();
        for i in 0..leaves[l].len() {
            let x = leaves[l][i];
            let h = 1e-6 * x.abs().max(1.0);
            at[l][i] = x + h;
            let above = f(&at);
            at[l][i] = x - h;
            let below = f(&at);
            at[l][i] = x;
            bar.push((above - below) / (2.0 * h));
        }
        out.push(bar);
    }
    out
}

#[track_caller]
pub(crate) fn close(what: &str, got: &[f32], want: &[f64], tolerance: f64) {
    assert_eq!(got.len(), want.len(), "{what}: length");
    let scale = want.iter().fold(1.0_f64, |m, x| m.max(x.abs()));
    for (i, (&g, &w)) in got.iter().zip(want).enumerate() {
        let off = (f64::from(g) - w).abs();
        assert!(
            off <= tolerance * scale,
            "{what}[{i}]: {g} should be {w}: off by {off:e}, allowed {:e}",
            tolerance * scale
        );
    }
}

/// `sum(a * b)`.
pub(crate) fn inner(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

pub(crate) fn narrow(x: &[f64]) -> Vec<f32> {
    x.iter().map(|&x| x as f32).collect()
}

/// Numbers that are exactly f32, uniform in `[low, high)`.
pub(crate) fn numbers(seed: u64, len: usize, low: f64, high: f64) -> Vec<f64> {
    let rng = field_core::rng::Rng::new(seed, 77);
    (0..len as u64).map(|i| f64::from((low + (high - low) * f64::from(rng.uniform_at(i))) as f32)).collect()
}

/// Compare tape and twin at a point: value, gradient of `<c, y>`, tangent along the leaf tangents, and gradient of
/// `<c, y_dot>`. Gradients of the twin are central differences. The first leaf is a parameter, the others are inputs.
#[track_caller]
pub(crate) fn check(program: &Program, leaves: &[Vec<f64>], tangents: &[Vec<f64>], tolerance: Tolerance) {
    let still: Vec<Vec<f64>> = leaves.iter().map(|l| vec![0.0; l.len()]).collect();
    let (value, tangent) = program.output(leaves, tangents);
    let c = numbers(99, value.len(), -1.0, 1.0);

    let mut arena = Arena::new();
    let params = narrow(&leaves[0]);
    let mut tape = Tape::new(&mut arena, &params);
    let (mut nodes, mut seeds) = (Vec::new(), Vec::new());
    for (i, (shape, data)) in program.leaves.iter().zip(leaves).enumerate() {
        let node = if i == 0 {
            tape.param(0, shape.rows, shape.cols)
        } else {
            tape.input(shape.rows, shape.cols, &narrow(data))
        };
        nodes.push(node.unwrap());
        seeds.push((nodes[i], tape.constant(shape.rows, shape.cols, &narrow(&tangents[i])).unwrap()));
    }
    let all = program.record(&mut tape, &nodes).unwrap();
    let out = all[all.len() - 1];
    close("value", tape.value(out).unwrap().data, &value, tolerance.value);

    let compare = |tape: &mut Tape, name: &str, node: Node, want: &[Vec<f64>], tolerance: f64| {
        let mut grad = vec![0.0; params.len()];
        tape.backward(&[(node, &narrow(&c))], &mut grad).unwrap();
        for (i, want) in want.iter().enumerate() {
            let got = if i == 0 { &grad[..] } else { tape.gradient(nodes[i]).unwrap() };
            close(&format!("{name} of leaf {i}"), got, want, tolerance);
        }
    };
    let want = differences(leaves, &|at| inner(&c, &program.output(at, &still).0));
    compare(&mut tape, "gradient", out, &want, tolerance.gradient);

    let [y_dot] = tape.jvp([out], &seeds).unwrap();
    close("tangent", tape.value(y_dot).unwrap().data, &tangent, tolerance.gradient);
    let want = differences(leaves, &|at| inner(&c, &program.output(at, tangents).1));
    compare(&mut tape, "gradient of the tangent", y_dot, &want, tolerance.second);
}
